"""Contact stiffness of two bodies from their materials, and a small table of materials of pads and surfaces.

Literature values scatter, so the table has ranges. Restitution belongs to a pair of bodies, their shapes and their
speed; there is one only where like bodies of a material were measured. For any other pair measure a blow and
`impact_gym.identify` it.
"""

import math
from dataclasses import dataclass
from itertools import product

from impact_gym.validation import number

Range = tuple[float, float]


def hertz(
    radius: float, young_tool: float, poisson_tool: float, young_object: float, poisson_object: float
) -> float:  # fmt: skip
    """Contact stiffness k_c of a sphere and a plane, N/m^1.5: F = k_c delta^1.5, k_c = 4/3 E* sqrt(R).

    1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2 (H. Hertz, J. reine angew. Math. 92 (1882) 156-171; K. L. Johnson,
    Contact Mechanics, eq. 4.23). For small strains of bodies thick beside the contact: a thin pad on a hard tool is
    stiffer.

    Args:
        radius: of the sphere, m; of two spheres 1 / (1/R_1 + 1/R_2).
        young_tool: Young's modulus of the tool's surface, Pa.
        poisson_tool: its Poisson's ratio.
        young_object: of the object, Pa.
        poisson_object: likewise.

    Raises:
        ValueError: one of these is out of range; names it.
    """
    radius = number("radius", radius, "m", above=0)
    compliance = 0.0
    for name, young, poisson in (("tool", young_tool, poisson_tool), ("object", young_object, poisson_object)):
        nu = number(f"poisson_{name}", poisson, "(no unit)", above=-1, at_most=0.5)
        compliance += (1.0 - nu**2) / number(f"young_{name}", young, "Pa", above=0)
    return 4.0 / 3.0 * math.sqrt(radius) / compliance


@dataclass(frozen=True)
class Material:
    """What is published of a material."""

    young: Range  # Pa
    poisson: Range
    source: str
    restitution: Range | None = None  # of two bodies of it


def rubber(shore: float) -> Material:
    """Return a rubber by its hardness, Shore A; the modulus by Gent's relation, given a fifth to either side."""
    shore = number("shore", shore, "(Shore A)", at_least=20, at_most=80)
    young = 1e6 * 0.0981 * (56.0 + 7.62336 * shore) / (0.137505 * (254.0 - 2.54 * shore))
    return Material((young / 1.2, young * 1.2), (0.45, 0.5), GENT)


GENT = "A. N. Gent, Rubber Chem. Technol. 31 (1958) 896-906"
MECHANICS = "J. M. Gere, B. J. Goodno, Mechanics of Materials, appendix of properties (also web.mst.edu, lesson 2211)"
WOOD = "USDA Forest Products Laboratory, Wood Handbook (FPL-GTR), tables of elastic ratios and moduli, Douglas-fir"
FOERSTER = (
    "S. F. Foerster, M. Y. Louge, H. Chang, K. Allia, Phys. Fluids 6 (1994) 1108-1115 (restitution, 3 mm spheres)"
)

MATERIALS = {
    "rubber, Shore A 30": rubber(30.0),
    "rubber, Shore A 50": rubber(50.0),
    "rubber, Shore A 70": rubber(70.0),
    "polyethylene": Material((0.7e9, 1.4e9), (0.4, 0.46), MECHANICS),
    "nylon": Material((2.1e9, 3.4e9), (0.39, 0.4), MECHANICS),
    "wood, across the grain": Material((0.6e9, 1.1e9), (0.29, 0.45), WOOD),
    "concrete": Material((17e9, 31e9), (0.1, 0.2), MECHANICS),
    "granite": Material((41e9, 97e9), (0.2, 0.3), MECHANICS),
    "glass": Material((48e9, 83e9), (0.17, 0.27), f"{MECHANICS}; {FOERSTER}", (0.96, 0.98)),
    "aluminium": Material((69e9, 79e9), (0.33, 0.33), MECHANICS),
    "steel": Material((193e9, 207e9), (0.27, 0.30), MECHANICS),
}
"""By name; those of rubber are for slow loading, a blow finds it stiffer."""


def material_ranges(radius: Range, tool: str | Material, target: str | Material) -> dict[str, list[float]]:
    """Return what two materials say of a set-up's `[environment.scenario]`: contact_stiffness, maybe restitution.

    Args:
        radius: least and largest radius of the curved body, m.
        tool: material of the tool's surface, by its name in MATERIALS or as a record.
        target: likewise of the object's.

    Raises:
        ValueError: no such material, or a radius that is not above 0.
    """
    pair = [_material(name, given) for name, given in (("tool", tool), ("target", target))]
    values = [
        hertz(r, *first, *second)
        for r in radius
        for first, second in product(*(product(one.young, one.poisson) for one in pair))
    ]
    found = {"contact_stiffness": [min(values), max(values)]}
    if pair[0] == pair[1] and pair[0].restitution is not None:
        found["restitution"] = list(pair[0].restitution)
    return found


def _material(field: str, given: str | Material) -> Material:
    if isinstance(given, Material):
        return given
    if given not in MATERIALS:
        raise ValueError(f"{field} must be one of {list(MATERIALS)} or a Material, got {given!r}")
    return MATERIALS[given]
