"""What the functions of the physics refuse: the field, and where it matters the unit and what is allowed."""

import math

import pytest

import impact_gym as ig
from impact_gym.physics.hertz import rubber
from impact_gym.physics.impact import free_tool, rigid_tool, sliding_distance
from impact_gym.physics.peak import peak_factor, permitted_speed

STEEL = (206e9, 0.3)
REFUSALS = [
    (free_tool, (0.0, 1.0, 1.0, 0.0, 0.5), "tool_mass"), (free_tool, (1.0, [1.0, -1.0], 1.0, 0.0, 0.5), "object_mass"),
    (free_tool, (1.0, 1.0, math.nan, 0.0, 0.5), "tool_velocity"),
    (free_tool, (1.0, 1.0, 1.0, math.inf, 0.5), "object_velocity"),
    (free_tool, (1.0, 1.0, 1.0, 0.0, 1.1), "restitution"), (free_tool, (1.0, 1.0, 1.0, 0.0, -0.1), "restitution"),
    (free_tool, (1.0, 1.0, 1.0, 0.0, 0.5, math.nan), "impulse"),
    *((rigid_tool, (value, 0.0, 0.5), "tool_velocity") for value in ("1", None, [None], True, 1j)),
    (sliding_distance, (1.0, -0.1), r"friction must be finite and at least 0 .*-0\.1"),
    (ig.hertz, (0.0, *STEEL, *STEEL), "radius must be finite and above 0 m"),
    (ig.hertz, (0.01, -1.0, 0.3, *STEEL), "young_tool must be finite and above 0 Pa"),
    (ig.hertz, (0.01, 206e9, 0.6, *STEEL), "poisson_tool must be finite and above -1 and at most 0.5"),
    (ig.hertz, (0.01, *STEEL, math.nan, 0.3), "young_object"),
    (ig.hertz, (0.01, *STEEL, 206e9, -1.0), "poisson_object"),
    *((rubber, (shore,), "shore") for shore in (19.0, 81.0, math.nan)),  # beyond Gent's relation
    (ig.material_ranges, ((0.01, 0.03), "butter", "steel"), "tool must be one of"),
    (permitted_speed, (0.0, 1.0, 1e5, 1.0), "limit must be finite and above 0 N"),
    (permitted_speed, (10.0, 1.0, 1e5, 1.0, 4.0), "limit must be finite and above 10 N"),
    (permitted_speed, (50.0, 0.0, 1e5, 1.0), "mass must be finite and above 0 kg"),
    (permitted_speed, (50.0, 1.0, -1.0, 1.0), r"stiffness must be finite and above 0 N/m\^1.5"),
    (permitted_speed, (50.0, 1.0, 1e5, 1.0, -1.0), "push must be finite and at least 0 N"),
    (peak_factor, (-1.0,), "damping must be finite and at least 0"),
    (ig.effective_restitution, ("hertz", 0.5), "law"),
    *((ig.effective_restitution, ("exact", value), "restitution") for value in (0.0, 1.5, math.nan)),
]  # fmt: skip


@pytest.mark.parametrize(("function", "arguments", "message"), REFUSALS)
def test_function_names_what_it_refuses(function, arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        function(*arguments)
