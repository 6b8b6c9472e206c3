"""Short trainings for tests."""

from dataclasses import replace

from agents import load_setup
from agents.setups import Training
from agents.train.ppo import Run

TINY = Training(
    steps=4096, envs=16, rollout=16, batch=64, width=16, simulation_threads=1,
    validate_every=1536, validation_scenarios=20, checkpoint_every=1024, imitation_steps=4096, rtol=1e-4,
)  # fmt: skip
ALL_PARTS = "[environment]\ntool_mass = [0.1, 0.2]\n[evaluation.nominal]\ntool_mass = 0.125\n"


def tiny(setup="linear-blind", **changes):
    """Return a training that takes at most a second."""
    return Run(load_setup(setup), replace(TINY, **changes))
