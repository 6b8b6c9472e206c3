"""Controllers that are not learned, with stable-baselines3's method `action, state = predict(observation)`."""

from agents.baselines.constant import ConstantSpeed, LocalBrake, OperatorAlone, PaperTrapezoid, RandomActions
from agents.baselines.detector import DetectorProfile, DetectorRanged
from agents.baselines.filtered import FilteredProfile, FirstReadingProfile
from agents.baselines.profile import BlindProfile, Clairvoyant, ConstantDeceleration, Ranged, RangedProfile
from agents.baselines.rule import Rule
from agents.baselines.tuned import load_baseline

__all__ = [
    "BlindProfile", "Clairvoyant", "ConstantDeceleration", "ConstantSpeed", "DetectorProfile", "DetectorRanged",
    "FilteredProfile", "FirstReadingProfile", "LocalBrake", "OperatorAlone", "PaperTrapezoid",
    "RandomActions", "Ranged", "RangedProfile", "Rule", "load_baseline",
]  # fmt: skip
