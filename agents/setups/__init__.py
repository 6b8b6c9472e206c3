"""Set-ups: an arm in one file, and all that follows from it.

A set-up is a TOML file. `[environment]` are the arguments of the environment, in which every physical number may be a
pair (low, high), drawn per episode; `[training]` what differs from the defaults of `agents.setups.training`;
`[baselines]` the rules that are tuned for it and those it is compared with; `[evaluation]` at which time weights, on
which scenarios, and what is varied to see whether policies hold. Those in this folder are known by name.
"""

from agents.setups.setup import README, RULES, Setup, Tuned, load_setup, owner, same_environment, shipped
from agents.setups.training import Training

__all__ = ["README", "RULES", "Setup", "Training", "Tuned", "load_setup", "owner", "same_environment", "shipped"]
