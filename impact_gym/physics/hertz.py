"""Contact stiffness of two bodies from their materials, and a small table of materials.

Published values scatter, so the table has ranges. Each source states whether we read it. Restitution depends on the
materials, shapes and velocities of both bodies. A restitution in the table is for two bodies of the material, or for
one such body and a far stiffer one. For other pairs, identify a restitution from measurements (`impact_gym.identify`).
"""

import math
from dataclasses import dataclass
from itertools import product

from impact_gym.support.validation import Range, interval, number


def hertz(
    radius: float, young_tool: float, poisson_tool: float, young_object: float, poisson_object: float
) -> float:  # fmt: skip
    """Return the contact stiffness k_c of a sphere and a plane, N/m^1.5: F = k_c delta^1.5, k_c = 4/3 E* sqrt(R).

    R is the radius, delta the penetration, and 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2, with Young's moduli E and
    Poisson's ratios nu of both bodies (H. Hertz, J. reine angew. Math. 92 (1882) 156-171; K. L. Johnson, Contact
    Mechanics, eq. 4.23). This holds for small strains, if the bodies are much thicker than the contact's width.

    Args:
        radius: radius of the sphere, m; for two spheres of radii R_1 and R_2: 1 / (1/R_1 + 1/R_2).
        young_tool: Young's modulus of the tool's surface, Pa.
        poisson_tool: Poisson's ratio of the tool's surface.
        young_object: Young's modulus of the object's surface, Pa.
        poisson_object: Poisson's ratio of the object's surface.

    Raises:
        ValueError: an argument is out of range.
    """
    radius = number("radius", radius, "m", above=0)
    compliance = 0.0
    for name, young, poisson in (("tool", young_tool, poisson_tool), ("object", young_object, poisson_object)):
        nu = number(f"poisson_{name}", poisson, "(no unit)", above=-1, at_most=0.5)
        compliance += (1.0 - nu**2) / number(f"young_{name}", young, "Pa", above=0)
    return 4.0 / 3.0 * math.sqrt(radius) / compliance


@dataclass(frozen=True)
class Material:
    """Ranges of a material's values, from publications."""

    young: Range  # Pa
    poisson: Range
    source: str
    restitution: Range | None = None  # between two bodies of this material, or such a body and a far stiffer one


GENT = (
    "modulus: A. N. Gent, Rubber Chem. Technol. 31 (1958) 896-906, not checked here; the relation was read in "
    "public code that cites Gent; Poisson's ratio: Altair Radioss manual, poissons_ratio_definitions_r.htm, read"
)
BALLS = ("hardness (JIS A, used as Shore A) and returned energy: the maker's sheet of two balls at "
         "commons.bcit.ca/physics-resources/physics-demonstration-manual/mechanics/dld20-coefficient-of-restitution, "
         f"read; {GENT}")  # fmt: skip
GERE = (
    "J. M. Gere, Mechanics of Materials, 5th ed., read at ah-engr.com/som/tools/tables/table_1_elastic_constants.htm "
    "and issuhub.com/view/index?id=5272&pageIndex=575"
)
DOWLING = "N. E. Dowling, Mechanical Behavior of Materials, table 5.2, read at digilib.universitaspertamina.ac.id"
WOOD = ("USDA Forest Products Laboratory, Wood Handbook, Douglas-fir of 12 % moisture, radial and tangential. "
        "Smallest values: Interior South, read at engdatabase.com/data/wood-properties/douglas-fir-interior-south. "
        "Largest values: Coast, and a factor of 1.1 on the modulus in bending, not checked here")  # fmt: skip
FOERSTER = ("restitution of 3 mm spheres: S. F. Foerster, M. Y. Louge, H. Chang, K. Allia, Phys. Fluids 6 (1994) "
            "1108-1115, not checked here")  # fmt: skip
FOAM = (
    "modulus, of slow tests: G. Silber, C. Then, Preventive Biomechanics, 2013, table 4.3, 2 (mu_1 + mu_2) = 12.6 kPa "
    "with Poisson's ratios below 0.003, read at "
    "what-when-how.com/Tutorial/topic-5h17j2/Preventive-Biomechanics-173.html; returned energy "
    "(ball rebound below 20 %; some foams absorb 90 % of an impact): Polyurethane Foam Association, "
    "In Touch 11 (1), 2016, read at "
    "fdocuments.in/document/viscoelastic-memory-foam-was-first-commercialized-during-the-mid-60s.html"
)


def rubber(shore: float, source: str = GENT, restitution: Range | None = None) -> Material:
    """Return rubber of hardness `shore` (Shore A); Young's modulus is within a factor of 1.2 of Gent's value.

    Gent treats the durometer's blunt cone as a flat punch: E = (1 - nu^2) F / (2 R delta), with Poisson's ratio nu,
    the spring force F of the durometer, the indentation delta, and the mean radius R of the cone.
    """
    shore = number("shore", shore, "(Shore A)", at_least=20, at_most=80)
    young = 1e6 * 0.0981 * (56.0 + 7.62336 * shore) / (0.137505 * (254.0 - 2.54 * shore))
    return Material((young / 1.2, young * 1.2), (0.48, 0.5), source, restitution)


MATERIALS = {
    "memory-foam": Material((13e3, 13e3), (0.0, 0.0), FOAM, (math.sqrt(0.1), math.sqrt(0.2))),
    "norbornene": rubber(32.0, BALLS, (math.sqrt(0.03), math.sqrt(0.03))),
    "neoprene": rubber(63.0, f"{BALLS}; rebound, seen there, almost 70 %", (math.sqrt(0.53), math.sqrt(0.7))),
    "rubber, Shore A 30": rubber(30.0),
    "rubber, Shore A 50": rubber(50.0),
    "rubber, Shore A 70": rubber(70.0),
    "polyethylene": Material((0.7e9, 1.4e9), (0.4, 0.42), f"{GERE}; {DOWLING}"),
    "nylon": Material((2.1e9, 3.4e9), (0.4, 0.41), f"{GERE}; {DOWLING}"),
    "wood, across the grain": Material((0.57e9, 1.0e9), (0.029, 0.39), WOOD),
    "concrete": Material((17e9, 31e9), (0.1, 0.2), GERE),
    "granite": Material((40e9, 100e9), (0.2, 0.3), f"{GERE}; Poisson's ratio: same book, not checked here"),
    "glass": Material((48e9, 83e9), (0.18, 0.22), f"{GERE}; Poisson's ratio: {DOWLING}; {FOERSTER}", (0.96, 0.98)),
    "aluminium": Material((70e9, 79e9), (0.33, 0.345), f"{GERE}; {DOWLING}"),
    "steel": Material((190e9, 210e9), (0.27, 0.30), GERE),
}
"""Materials by name. Moduli of rubber and foam are for slow loading; in impacts they are larger."""


def material_ranges(radius: float | Range, tool: str | Material, target: str | Material) -> dict[str, list[float]]:
    """Return ranges for `[environment.scenario]`: contact_stiffness and, for equal materials, restitution if known.

    Args:
        radius: radius of the curved body, or its smallest and largest radius, m.
        tool: material of the tool's surface: a name in MATERIALS, or a `Material`.
        target: material of the object's surface, given like `tool`.

    Raises:
        ValueError: a material is unknown, or a number is out of range.
    """
    for field, given in (("tool", tool), ("target", target)):
        if not isinstance(given, Material) and given not in MATERIALS:
            raise ValueError(f"{field} must be one of {list(MATERIALS)} or a Material, got {given!r}")
    pair = [given if isinstance(given, Material) else MATERIALS[given] for given in (tool, target)]
    values = [
        hertz(r, *first, *second)
        for r in interval("radius", radius, "m", above=0)
        for first, second in product(*(product(material.young, material.poisson) for material in pair))
    ]
    ranges = {"contact_stiffness": [min(values), max(values)]}
    if pair[0] == pair[1] and pair[0].restitution is not None:
        ranges["restitution"] = list(pair[0].restitution)
    return ranges
