"""The colours of pictures, films, pages, charts and docs: after Okabe and Ito (2008), darker where they are text.

Each colour has a partner for a dark page. `css` makes custom properties of them, so that a page has no colours of its
own; `adaptive` lets a drawing follow them.
"""

import re

COLOURS = {
    "rule": ("#BB4F00", "#FF8A3D"), "policy": ("#0072B2", "#56A8E6"), "profile": ("#007B59", "#35C79A"),
    "person": ("#A8457F", "#DD8BBB"), "object": ("#7D6A58", "#B39D87"), "tool": ("#2E2E2C", "#DADAD6"),
    "flange": ("#6B6B68", "#9C9C98"), "force": ("#7A4FB0", "#B794E8"), "warning": ("#8F6200", "#E69F00"),
    "alarm": ("#C1121F", "#FF7B7B"), "bg": ("#FFFFFF", "#16181B"), "panel": ("#F5F4F0", "#1F2226"),
    "grid": ("#DCDCD8", "#383B3F"), "muted": ("#5A5A57", "#ACACA8"), "fg": ("#1D1D1B", "#E9E9E6"),
    "link": ("#0B5CAD", "#7DB8F0"),
}  # fmt: skip
"""By name: on a light and on a dark page. A contestant has one colour everywhere: rule, policy, profile or person."""
SERIES = "rule", "policy", "profile", "person", "object", "tool", "flange", "force", "warning"
LIGHT = {name: light for name, (light, _) in COLOURS.items()}
RULE, POLICY, PROFILE, PERSON = (LIGHT[name] for name in ("rule", "policy", "profile", "person"))
OBJECT, TOOL, FLANGE, FORCE = (LIGHT[name] for name in ("object", "tool", "flange", "force"))
WARNING, ALARM = LIGHT["warning"], LIGHT["alarm"]
PAPER, PANEL, GRID, FAINT, INK = (LIGHT[name] for name in ("bg", "panel", "grid", "muted", "fg"))


def css() -> str:
    """Return the colours as custom properties `--NAME` of a page that is light or dark, as the reader or a button says.

    Drawings in the page that have colours of the light palette as attributes follow.
    """
    block = ":root:not([data-theme=light])"
    dark = f"@media screen and (prefers-color-scheme: dark) {{ {_block(block, 1)} }}"
    button = f"@media screen {{ {_block(':root[data-theme=dark]', 1)} }}"
    parts = [(name, part) for name in SERIES for part in ("stroke", "fill")]
    drawn = [f'svg [{part}="{LIGHT[name]}" i] {{ {part}: var(--{name}); }}' for name, part in parts]
    return "\n".join([_block(":root", 0), dark, button, *drawn])


def adaptive(drawing: str) -> str:
    """Return an SVG drawing in colours of the light palette that is light or dark as the page around it."""
    names = {light.lower(): name for name, light in LIGHT.items()}
    pattern = re.compile("|".join(names), re.IGNORECASE)
    drawing = pattern.sub(lambda found: f"var(--{names[found[0].lower()]}, {found[0]})", drawing)
    dark = f"@media (prefers-color-scheme: dark) {{ {_block(':root', 1)} }}"
    return re.sub(r"(<svg\b[^>]*>)", lambda found: f"{found[0]}<style>{dark}</style>", drawing, count=1)


def _block(selector: str, scheme: int) -> str:
    values = " ".join(f"--{name}: {colours[scheme].lower()};" for name, colours in COLOURS.items())
    return f"{selector} {{ {values} color-scheme: {('light', 'dark')[scheme]}; }}"
