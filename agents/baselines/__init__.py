"""Controllers that are not learned, with stable-baselines3's method `action, state = predict(observation)`.

A module of this folder with a subclass of `Rule` is all that a new baseline needs; for C also a part of `rule.h.jinja`.
"""

from importlib import import_module
from pkgutil import iter_modules

from agents.baselines.constant import ConstantSpeed, LocalBrake, OperatorAlone, PaperTrapezoid, RandomActions
from agents.baselines.detector import DetectorProfile, DetectorRanged
from agents.baselines.filtered import FilteredProfile, FirstReadingProfile, SelfCalibratingProfile
from agents.baselines.profile import BlindProfile, Clairvoyant, ConstantDeceleration, Ranged, RangedProfile
from agents.baselines.rule import FIXED, RULES, Rule, tuned_rule

__all__ = [
    "FIXED", "RULES", "BlindProfile", "Clairvoyant", "ConstantDeceleration", "ConstantSpeed", "DetectorProfile",
    "DetectorRanged", "FilteredProfile", "FirstReadingProfile", "LocalBrake", "OperatorAlone", "PaperTrapezoid",
    "RandomActions", "Ranged", "RangedProfile", "Rule", "SelfCalibratingProfile", "tuned_rule",
]  # fmt: skip

for module in iter_modules(__path__):  # each enters its baselines into RULES and FIXED
    import_module(f"{__name__}.{module.name}")
