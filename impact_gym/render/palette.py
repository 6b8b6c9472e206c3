"""The colours of pictures, films, pages, charts and docs, after Okabe and Ito (2008)."""

COLOURS = {
    "rule": ("#BB4F00", "#FF8A3D"), "policy": ("#0072B2", "#56A8E6"), "profile": ("#007B59", "#35C79A"),
    "person": ("#A8457F", "#DD8BBB"), "object": ("#7D6A58", "#B39D87"), "tool": ("#2E2E2C", "#DADAD6"),
    "flange": ("#6B6B68", "#9C9C98"), "force": ("#7A4FB0", "#B794E8"), "warning": ("#8F6200", "#E69F00"),
    "alarm": ("#C1121F", "#FF7B7B"), "bg": ("#FFFFFF", "#16181B"), "panel": ("#F5F4F0", "#1F2226"),
    "grid": ("#DCDCD8", "#383B3F"), "muted": ("#5A5A57", "#ACACA8"), "fg": ("#1D1D1B", "#E9E9E6"),
    "link": ("#0B5CAD", "#7DB8F0"),
}  # fmt: skip
"""For each name, the colours on a light page and on a dark page."""
LIGHT = {name: light for name, (light, _) in COLOURS.items()}
RULE, POLICY, PROFILE, PERSON = (LIGHT[name] for name in ("rule", "policy", "profile", "person"))
OBJECT, TOOL, FLANGE, FORCE = (LIGHT[name] for name in ("object", "tool", "flange", "force"))
WARNING, ALARM = LIGHT["warning"], LIGHT["alarm"]
PAPER, PANEL, GRID, FAINT, INK = (LIGHT[name] for name in ("bg", "panel", "grid", "muted", "fg"))
