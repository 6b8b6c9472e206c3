"""Set-ups: an arm, its training, baselines and evaluation in one file.

A set-up is a TOML file. `[environment]` are the arguments of the environment, in which every physical number may be a
pair (low, high), drawn per episode; `[training]` what differs from the defaults of `agents.setups.training`;
`[baselines]` the rules that are tuned for it and those it is compared with; `[evaluation]` at which time weights, on
which scenarios, and what is varied to see whether policies hold. Those in this folder are known by name.
"""

from agents.setups.setup import (
    FIXED,
    README,
    RULES,
    TUNED,
    Setup,
    Tuned,
    load_setup,
    owner,
    same_environment,
    shipped,
    shipped_baselines,
)  # fmt: skip
from agents.setups.training import Training

__all__ = [
    "FIXED", "README", "RULES", "TUNED", "Setup", "Training", "Tuned", "load_setup", "owner", "same_environment",
    "shipped", "shipped_baselines",
]  # fmt: skip
