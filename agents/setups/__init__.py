"""Set-ups: an arm, its training, baselines and evaluation in one TOML file.

`[environment]` holds the arguments of the environment. `[training]` holds the settings of `agents.setups.training` that
differ from the defaults. `[baselines]` names the rules to tune, and the baselines to compare with the policies.
`[evaluation]` holds the time weights, the scenarios, and the arguments that are varied to test robustness.
"""

from agents.setups.setup import README, TUNED, Setup, load_setup, setup_tuning, shipped, shipped_baselines, trained
from agents.setups.training import Training
from agents.setups.tuned import load_baseline

__all__ = [
    "README", "TUNED", "Setup", "Training", "load_baseline", "load_setup", "setup_tuning", "shipped",
    "shipped_baselines", "trained",
]  # fmt: skip
