"""Train an offline learner of d3rlpy on a dataset from `impact-gym dataset`; evaluate the learner in other scenarios.

python docs/examples/offline_d3rlpy.py [STEPS [DATASET ...]]. Written for d3rlpy 2.8.
"""

import sys
from collections.abc import Callable
from typing import Any

import d3rlpy
import gymnasium as gym
import minari
import numpy as np
from impact_gym.agents import baselines, load_policy


def episodes(name: str) -> list[Any]:
    """Return the episodes for d3rlpy, without the observation after the last action."""
    return [d3rlpy.dataset.Episode(each.observations[:-1], each.actions, each.rewards[:, None], terminated=True)
            for each in minari.load_dataset(name)]  # fmt: skip


def score(act: Callable[[Any], Any], count: int = 2000) -> float:
    """Return the mean return (m/s) over `count` test scenarios, at a time weight of 2 m/s per s."""
    envs = gym.make_vec("impact_gym:ImpactApproach-v0", num_envs=count, scenario="test", time_weight=2.0)
    seen, _ = envs.reset(seed=2_000_000)
    total, running = np.zeros(count), np.ones(count, bool)
    while running.any():
        seen, rewards, terminated, _, _ = envs.step(act(seen))
        total += np.where(running, rewards, 0.0)
        running &= ~terminated
    return float(total.mean())


def main(steps: int, names: list[str]) -> None:
    """Train on datasets; print the mean returns of learner, paper's rule, profile and policy."""
    data = [episode for name in names for episode in episodes(name)]
    buffer = d3rlpy.dataset.create_infinite_replay_buffer(data)
    learner = d3rlpy.algos.IQLConfig(gamma=1.0, expectile=0.9, weight_temp=10.0).create(device="cpu")
    learner.fit(
        buffer,
        n_steps=steps,
        n_steps_per_epoch=steps,
        show_progress=False,
        logger_adapter=d3rlpy.logging.NoopAdapterFactory(),
    )
    policy, rule = load_policy("linear-blind"), baselines.PaperTrapezoid()
    profile = baselines.load_baseline("blind-profile", 2.0)
    print(f"{len(data)} episodes of {', '.join(names)}, {steps} steps")
    for name, act in {"IQL": learner.predict, "paper's rule": lambda seen: rule.predict(seen)[0],
                      "tuned profile": lambda seen: profile.predict(seen)[0],
                      "policy": lambda seen: policy.predict(seen)[0]}.items():  # fmt: skip
        print(f"{name}: mean return {score(act):.4f} m/s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50_000, sys.argv[2:] or ["impact/linear-blind/profile-v0"])
