"""Numbers found by an independent solver at rtol 1e-11, none of them printed in the paper (docs/provenance.md)."""

# of an isolated contact, by its restitution: duration in t0, greatest penetration in delta0, peak force in F0
SHAPES = {
    0.01: (29.2211138709, 0.192542571576, 4.4691365186),
    0.1: (7.50224023184, 0.466330490751, 1.8086263584),
    0.5: (3.62402223316, 0.840972185064, 1.0673964185),
    1.0: (3.21806545972, 1.09336207394, 1.1432626298),
}

# under a constant push (restitution, acceleration in v/t0): separation velocity in v, duration in t0
PUSHED = {
    (0.9, -0.05): (0.912051562, 3.177980), (0.9, 0.01): (0.897287332, 3.270730), (0.9, 0.05): (0.886187702, 3.330687),
    (0.9, 0.1): (0.870752491, 3.403510), (0.5, -0.05): (0.541405201, 3.447152), (0.5, 0.01): (0.476020690, 3.662501),
    (0.5, 0.05): (0.425046404, 3.830096), (0.5, 0.1): (0.349003659, 4.083670), (0.1, -0.05): (0.221300177, 4.361513),
    (0.1, 0.01): (0.048880263, 8.324390),
}  # fmt: skip
CRITICAL_PUSH = {0.9: 0.826855, 0.5: 0.201167, 0.1: 0.018308}  # by restitution; above it the contact never ends

OBJECT_VELOCITIES = {  # m/s, by the figure
    "13b": 1.944081, "14a": 1.876451, "14b": 1.555295, "16, before the break": 0.739806, "16, at the break": 0.747012,
    "16, behind the break": 0.757929, "17a": 0.903164, "17b": 0.936088, "19a": 0.872899, "19b": 0.794273,
    "23a": 0.45074, "23b": 0.692859, "25": 0.920628,
}  # fmt: skip
IMPACT_VELOCITY = 0.980305  # m/s, on the robot of Fig. 13b and 14
