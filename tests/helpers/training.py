"""Short trainings for tests, of each algorithm."""

from dataclasses import replace

from agents.train import callback
from agents.train.settings import OffPolicy, OnPolicy, Settings

TINY = Settings(
    steps=4096,
    envs=16,
    batch=64,
    width=16,
    simulation_threads=1,
    validate_every=1500,
    validation_scenarios=20,
    checkpoint_every=1000,
    on_policy=OnPolicy(rollout=16, lstm=8),
    off_policy=OffPolicy(buffer=3000, warm_up=200, gradient_steps=1),
)
ALGORITHMS = ("ppo", "recurrent_ppo", "sac", "tqc")
OBJECTIVES = callback.OBJECTIVES


def tiny(algo="ppo", **changes):
    return replace(TINY, algo=algo, **changes)
