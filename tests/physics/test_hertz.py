"""Contact stiffness of two bodies by Hertz's theory, and the table of materials."""

import math
import re

import pytest

import impact_gym as ig
from impact_gym.physics.hertz import GENT, rubber
from impact_gym.task import ScenarioRanges

STEEL = (206e9, 0.3)


def test_hertz_is_his_approach_of_a_sphere_to_a_plane():
    radius, force = 0.02, 50.0
    k = ig.hertz(radius, *STEEL, 3e9, 0.4)
    modulus = 1.0 / ((1 - 0.3**2) / 206e9 + (1 - 0.4**2) / 3e9)
    approach = (9.0 * force**2 / (16.0 * radius * modulus**2)) ** (1 / 3)  # Johnson, Contact Mechanics, eq. 4.23
    assert k * approach**1.5 == pytest.approx(force, rel=1e-12)


def test_hertz_of_a_rigid_tool_leaves_the_object_alone_and_bodies_may_change_places():
    alone = 4.0 / 3.0 * math.sqrt(0.01) * 2e6 / (1 - 0.5**2)
    assert ig.hertz(0.01, 1e30, 0.3, 2e6, 0.5) == pytest.approx(alone, rel=1e-12)
    assert ig.hertz(0.01, *STEEL, 2e6, 0.5) == pytest.approx(ig.hertz(0.01, 2e6, 0.5, *STEEL), rel=1e-14)


def test_materials_have_a_source_that_says_whether_it_was_read_and_numbers_that_a_body_can_have():
    for name, material in ig.MATERIALS.items():
        assert re.search(r"\bread\b|not checked here", material.source), name
        assert 0 < material.young[0] <= material.young[1] < 1e12
        assert material.poisson[0] > 0 or name == "memory-foam"  # whose cells give way sideways
        assert 0 <= material.poisson[0] <= material.poisson[1] <= 0.5
        if GENT not in material.source:  # no source prints more digits of a modulus, nor may we
            assert [float(f"{young:.2g}") for young in material.young] == list(material.young)
        least, most = material.restitution or (0, 1)
        assert 0 <= least <= most <= 1


@pytest.mark.parametrize("shore", [20.0, 40.0, 60.0, 80.0])
def test_rubber_is_the_law_of_a_flat_punch_pressed_in_by_a_durometer(shore):
    """ASTM D2240, type A: a cone blunted to 0.79 mm from 1.27 mm, 0.55 to 8.05 N, and 2.54 mm at hardness 0."""
    radius, force, depth = (0.79e-3 + 1.27e-3) / 4, 0.55 + 0.075 * shore, 2.54e-3 * (1 - shore / 100)
    young = (1 - 0.5**2) * force / (2 * radius * depth)  # Johnson, Contact Mechanics, eq. 3.36, no change of volume
    low, high = rubber(shore).young
    assert math.sqrt(low * high) == pytest.approx(young, rel=0.01)
    assert high / low == pytest.approx(1.2**2)


@pytest.mark.parametrize(("shore", "tabled"), [(40.0, 1.7e6), (60.0, 3.6e6)])
def test_rubber_of_a_hardness_has_the_modulus_that_is_tabled_for_it(shore, tabled):
    assert math.sqrt(math.prod(rubber(shore).young)) == pytest.approx(tabled, rel=0.02)


def test_material_ranges_hold_the_middle_of_a_pair_and_make_a_set_up():
    ranges = ig.material_ranges((0.01, 0.03), "rubber, Shore A 50", "steel")
    low, high = ranges["contact_stiffness"]
    assert low < ig.hertz(0.02, 2.5e6, 0.48, 200e9, 0.29) < high
    assert "restitution" not in ranges
    assert ig.material_ranges((0.01, 0.03), "glass", "glass")["restitution"] == [0.96, 0.98]
    assert ScenarioRanges.of(ranges).contact_stiffness == (low, high)
