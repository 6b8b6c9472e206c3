"""Scenes and motions as plain records: what the slow solver and the naive one read, without the package's classes."""

from types import SimpleNamespace as Record

import numpy as np

RIGID = Record()
BRAKE = Record(threshold=1.0, delay=0.016, deceleration=8.0)
MOTION = Record(speed=1.0, acceleration=8.0, brake=BRAKE)
CRUISE = Record(speed=1.0, acceleration=8.0, brake=None)
ROBOT = Record(mass=5.225, stiffness=1.9e5, damping=50.4)
POSITIONS = np.linspace(0.05, 0.3, 9)
TABLE = Record(
    position=POSITIONS,
    mass=5 + 0.5 * np.sin(6 * POSITIONS),
    stiffness=1.5e5 * (1 + 0.2 * POSITIONS),
    damping=50 + 10 * POSITIONS,
)


def spring(stiffness, damping_ratio=1.0):
    return Record(stiffness=stiffness, damping_ratio=damping_ratio)


def bistable(**changes):
    stops = {"front_stop": 0.0208, "rear_stop": -0.02, "stop_stiffness": 1e5, "stop_damping_ratio": 1.0}
    return Record(**{"stiffness": 50.0, "free_length": 0.07, "height": 0.028} | stops | changes)


def scene(k_c=1e5, e=1.0, coupling=RIGID, robot=None, *, m_t=0.125, m_p=0.25, distance=0.2505, **law):
    contact, target = Record(stiffness=k_c, restitution=e, **law), Record(mass=m_p, distance=distance)
    return Record(tool=Record(mass=m_t), object=target, contact=contact, coupling=coupling, robot=robot)


def law(dissipation, m=1.5, n=1.5):
    return {"dissipation": dissipation, "stiffness_exponent": m, "damping_exponent": n}


CLOSURES = {
    "hu-guo": lambda e: 3 / 2 * (1 - e) / e,
    "hunt-crossley": lambda e: 3 / 2 * (1 - e),
    "lankarani-nikravesh": lambda e: 3 / 4 * (1 - e**2),
    "flores": lambda e: 8 / 5 * (1 - e) / e,
    "gonthier": lambda e: (1 - e**2) / e,
    "herbert-mcwhannell": lambda e: 6 * (1 - e) / ((2 * e - 1) ** 2 + 3),
}
