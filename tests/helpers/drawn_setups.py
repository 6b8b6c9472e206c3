"""Set-ups of which numbers are drawn for each episode."""

from episodes import TABLE

import impact_gym as ig

SPRING = {"type": "SpringDamper", "stiffness": (40.0, 600.0), "damping_ratio": (0.2, 1.5)}
MECHANISM = {
    "type": "Bistable", "stiffness": (40.0, 80.0), "free_length": (0.07, 0.08), "height": (0.02, 0.03),
    "front_stop": (0.001, 0.02), "rear_stop": (-0.03, -0.01), "stop_stiffness": (1e4, 1e5),
    "stop_damping_ratio": (0.5, 1.0),
}  # fmt: skip
ROBOT = {"type": "Robot", "mass": (3.0, 6.0), "stiffness": (5e4, 2e5), "damping": (0.0, 60.0)}
TOOL = {"tool_mass": (0.05, 0.4)}
SENSED = {"alarm_threshold": (0.2, 5.0), "range_noise": (0, 0.02), "force_noise": (0, 2.0), "force_bias": (0.1, 0.5)}
SETUPS = {
    "sensors": {**SENSED, "deflection_sensor": True, "reaction_delay": (0.0, 0.04)},
    "rigid": {"coupling": ig.Rigid(), **TOOL},
    "spring": {"coupling": SPRING, **TOOL, **SENSED},
    "mechanism": {"coupling": MECHANISM, **TOOL},
    "one mass": {"coupling": ig.Rigid(), "robot": ROBOT, **TOOL},
    "spring on a robot": {"coupling": SPRING, "robot": ROBOT, **TOOL},
    "mechanism on a robot": {"coupling": MECHANISM, "robot": ROBOT},
    "spring on a table": {"coupling": SPRING, "robot": TABLE, **TOOL},
}
EVERYTHING = {
    "scenario": {"object_mass": (0.2, 0.9), "distance": 0.18}, "time_weight": (0.5, 8.0), "force_weight": 0.002,
    "reaction_delay": (0.01, 0.04), "range_noise": 0.01, "force_noise": 0.05, "force_bias": 0.1, "privileged": True,
}  # fmt: skip
