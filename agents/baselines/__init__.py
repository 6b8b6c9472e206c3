"""Controllers without learning, called as a policy of stable-baselines3 is: `action, state = predict(observation)`."""

from agents.baselines.constant import ConstantGain, ConstantSpeed, LocalBrake, OperatorAlone, PaperTrapezoid
from agents.baselines.profile import BlindProfile, Clairvoyant, Ranged, RangedProfile
from agents.baselines.random import RandomActions
from agents.baselines.rule import Rule, encode
from agents.baselines.shield import FullSpeed, Shield
from agents.baselines.tuned import load_baseline
from agents.baselines.wary import DetectorProfile, DetectorRanged

__all__ = [
    "BlindProfile", "Clairvoyant", "ConstantGain", "ConstantSpeed", "DetectorProfile", "DetectorRanged", "FullSpeed",
    "LocalBrake", "OperatorAlone", "PaperTrapezoid", "RandomActions", "Ranged", "RangedProfile", "Rule", "Shield",
    "encode", "load_baseline",
]  # fmt: skip
