"""All colours of pages and pictures come from one palette, and text in them can be read."""

import re
from pathlib import Path

import numpy as np
import pytest

from impact_gym.render import palette

ROOT = Path(__file__).parents[2]


def luminance(colour):
    """Return the relative luminance of a colour (WCAG 2.2)."""
    parts = np.array([*bytes.fromhex(colour.removeprefix("#"))]) / 255.0
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_colours_of_text_can_be_read_on_page_and_panel(scheme):
    of = {name: luminance(colours[scheme]) for name, colours in palette.COLOURS.items()}
    for name in ("rule", "policy", "profile", "person", "object", "force", "warning", "alarm", "muted", "fg", "link"):
        for ground in ("bg", "panel"):
            light, dark = sorted([of[name], of[ground]], reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (name, ground)


def test_pages_and_pictures_have_no_colours_of_their_own():
    suffixes, folders = {".py", ".css", ".js", ".jinja"}, ["play", "lab", "report", "design"]
    paths = [ROOT / "impact_gym" / "render", *(ROOT / "experiments" / folder for folder in folders)]
    files = [path for folder in paths for path in folder.rglob("*") if path.suffix in suffixes]
    assert len(files) > 40
    for path in files:
        if path.name != "palette.py":
            assert re.findall(r"#[0-9a-fA-F]{6}\b|#[0-9a-fA-F]{3}\b(?=[;\"'])", path.read_text()) == [], path
