"""Range sensors that are sold, as arguments `range_sensor` of the environment; a name, such as "VL53L1X", is also one.

Numbers are from the sources below, except those marked as assumed. A data sheet bounds the error of any specimen. Each
bound is a range here, from which an episode draws. Each sensor is assumed to read in every control period.
"""

from typing import Any

from impact_gym.support.validation import shown

# Time of flight. SparkFun SEN-18993, product page: precision 1 mm, accuracy +-7 mm (white target, indoors), smallest
# distance 1 mm, largest 1300 mm, up to 100 Hz. ST UM2931, table 4: timing budget of 10 ms or more.
VL53L4CD: dict[str, Any] = {
    "noise": 0.001,  # m, the precision
    "bias": (-0.007, 0.007),  # m, the accuracy; assumed constant in an approach
    "resolution": 0.001, "nearest": 0.001, "farthest": 1.3,  # m
    "delay": 0.01,  # s, the shortest timing budget
}  # fmt: skip
# Time of flight. ST, VL53L1X (DocID031281) and guide to STEBCN2V1, page 21: error +-20 mm in the dark, which is the sum
# of accuracy and repeatability; smallest distance 40 mm; 1.3 m in short mode, with a timing budget of 20 ms or more.
VL53L1X: dict[str, Any] = {
    "noise": 0.01, "bias": (-0.01, 0.01),  # m; half of the error each is assumed
    "resolution": 0.001, "nearest": 0.04, "farthest": 1.3,  # m
    "delay": 0.02,  # s, the shortest timing budget
}  # fmt: skip
# Ultrasonic. Omron E4PA-N data sheet, pages 1 and 2: 50 to 500 mm, repeat accuracy 1 mm, temperature +-1 % of full
# scale; Omron FAQ 01368: linearity +-1 % of 440 mm. Response delay 50 ms: Pepperl+Fuchs UB500-18GM75 (30 to 500 mm).
E4PA_LS50: dict[str, Any] = {
    "noise": 0.001,  # m, assumed: the repeat accuracy is one standard deviation
    "bias": (-0.0044, 0.0044),  # m, assumed: the deviation from linearity is constant in an approach
    "scale": (-0.01, 0.01),  # -, assumed: temperature acts by the speed of sound
    "correlation": 0.7,  # -, assumed: the sensor averages over its response time, exp(-16 ms / 50 ms)
    "nearest": 0.05, "farthest": 0.5,  # m
    "delay": 0.05,  # s, assumed: that of the other sensor
}  # fmt: skip
# Triangulating. Sharp GP2Y0A41SK0F, sheet OP13008EN, features: 4 to 30 cm, measuring cycle 16.5 ms; electro-optical
# characteristics: output difference between both distances (2.25 +- 0.3) V. The output goes with 1 / distance.
GP2Y0A41SK0F: dict[str, Any] = {
    "share": 0.02,  # -, assumed: the sheet has no noise
    "scale": (-0.13, 0.13),  # -, 0.3 / 2.25; assumed: without the offset at 30 cm, which is calibrated
    "nearest": 0.04, "farthest": 0.3,  # m
    "delay": 0.0165,  # s, one measuring cycle
}  # fmt: skip
PRESETS = {"VL53L4CD": VL53L4CD, "VL53L1X": VL53L1X, "E4PA_LS50": E4PA_LS50, "GP2Y0A41SK0F": GP2Y0A41SK0F}


def named(name: str) -> dict[str, Any]:
    """Return the sensor with a name, such as "VL53L1X"; ValueError: there is none."""
    if name not in PRESETS:
        wanted = f"range_sensor must be a RangeSensor, a mapping or a name ({', '.join(PRESETS)})"
        raise ValueError(f"{wanted}, got {shown(name)}")
    return dict(PRESETS[name])
