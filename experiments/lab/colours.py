"""The colours of the pages as CSS, and SVG drawings that follow the reader's theme, light or dark."""

import re

from impact_gym.render import palette

SERIES = "rule", "policy", "profile", "person", "object", "tool", "flange", "force", "warning"


def css() -> str:
    """Return CSS that sets properties `--NAME` to light or dark colours, and uses them for the SERIES in SVG."""
    block = ":root:not([data-theme=light])"
    dark = f"@media screen and (prefers-color-scheme: dark) {{ {_block(block, 1)} }}"
    button = f"@media screen {{ {_block(':root[data-theme=dark]', 1)} }}"
    parts = [(name, part) for name in SERIES for part in ("stroke", "fill")]
    drawn = [f'svg [{part}="{palette.LIGHT[name]}" i] {{ {part}: var(--{name}); }}' for name, part in parts]
    return "\n".join([_block(":root", 0), dark, button, *drawn])


def adaptive(drawing: str) -> str:
    """Return the SVG text `drawing` with colours that follow the theme of the reader's system, light or dark."""
    names = {light.lower(): name for name, light in palette.LIGHT.items()}
    pattern = re.compile("|".join(names), re.IGNORECASE)
    drawing = pattern.sub(lambda found: f"var(--{names[found[0].lower()]}, {found[0]})", drawing)
    dark = f"@media (prefers-color-scheme: dark) {{ {_block(':root', 1)} }}"
    return re.sub(r"(<svg\b[^>]*>)", lambda found: f"{found[0]}<style>{dark}</style>", drawing, count=1)


def _block(selector: str, scheme: int) -> str:
    values = " ".join(f"--{name}: {colours[scheme].lower()};" for name, colours in palette.COLOURS.items())
    return f"{selector} {{ {values} color-scheme: {('light', 'dark')[scheme]}; }}"
