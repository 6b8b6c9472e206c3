"""Text in the colours of pages and pictures can be read."""

import numpy as np
import pytest

from impact_gym.render import palette


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
