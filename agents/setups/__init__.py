"""Set-ups: an arm, its training, baselines and evaluation in one TOML file.

`[environment]` holds the arguments of the environment; a physical number may be a pair (low, high), from which each
episode draws. `[training]` holds settings that differ from the defaults in `agents.setups.training`. `[baselines]`
names the rules to tune, and the baselines with which policies are compared. `[evaluation]` holds the time weights, the
scenarios, and the arguments that are varied to test robustness. The set-ups in this folder are loaded by name.
"""

from agents.setups.setup import FIXED, README, RULES, TUNED, Setup, load_setup, owner, shipped, shipped_baselines
from agents.setups.training import Training

__all__ = [
    "FIXED", "README", "RULES", "TUNED", "Setup", "Training", "load_setup", "owner", "shipped", "shipped_baselines",
]  # fmt: skip
