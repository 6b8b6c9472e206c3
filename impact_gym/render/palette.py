"""The colours of pictures, films, pages, charts and docs: after Okabe and Ito (2008), darker where they are text.

Each colour has a partner for a dark page. `css` makes custom properties of them, so that a page has no colours of its
own; `with_variables` lets a drawing that was made with the light colours follow them.
"""

import re

COLOURS = {
    "rule": ("#C75300", "#FF8A3D"), "policy": ("#0072B2", "#56A8E6"), "profile": ("#00805D", "#35C79A"),
    "person": ("#A8457F", "#DD8BBB"), "object": ("#8A7663", "#B39D87"), "tool": ("#2E2E2C", "#DADAD6"),
    "flange": ("#6B6B68", "#9C9C98"), "force": ("#7A4FB0", "#B794E8"), "warning": ("#8F6200", "#E69F00"),
    "alarm": ("#C1121F", "#FF7B7B"), "bg": ("#FFFFFF", "#16181B"), "panel": ("#F5F4F0", "#1F2226"),
    "grid": ("#DCDCD8", "#383B3F"), "muted": ("#5A5A57", "#ACACA8"), "fg": ("#1D1D1B", "#E9E9E6"),
    "link": ("#0B5CAD", "#7DB8F0"),
}  # fmt: skip
"""By name: on a light and on a dark page. A contestant has one colour everywhere: rule, policy, profile or person."""
LIGHT = {name: light for name, (light, _) in COLOURS.items()}
RULE, POLICY, PROFILE, PERSON = (LIGHT[name] for name in ("rule", "policy", "profile", "person"))
OBJECT, TOOL, FLANGE, FORCE = (LIGHT[name] for name in ("object", "tool", "flange", "force"))
WARNING, ALARM = LIGHT["warning"], LIGHT["alarm"]
PAPER, PANEL, GRID, FAINT, INK = (LIGHT[name] for name in ("bg", "panel", "grid", "muted", "fg"))


def css() -> str:
    """Return the colours as custom properties `--NAME` of a page that is light or dark, as the reader or a button says."""

    def block(selector: str, scheme: int) -> str:
        values = " ".join(f"--{name}: {colours[scheme].lower()};" for name, colours in COLOURS.items())
        return f"{selector} {{ {values} color-scheme: {('light', 'dark')[scheme]}; }}"

    dark = block(":root:not([data-theme=light])", 1)
    return "\n".join([
        block(":root", 0), f"@media screen and (prefers-color-scheme: dark) {{ {dark} }}",
        f"@media screen {{ {block(':root[data-theme=dark]', 1)} }}",
    ])  # fmt: skip


def with_variables(drawing: str) -> str:
    """Return a drawing or style sheet in which each colour of the light palette is the custom property of its name."""
    names = {light.lower(): name for name, light in LIGHT.items()}
    return re.sub(
        "|".join(names), lambda found: f"var(--{names[found[0].lower()]}, {found[0]})", drawing, flags=re.IGNORECASE
    )
