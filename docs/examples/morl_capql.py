"""Train CAPQL of morl-baselines on mo-impact-approach-v0, and compare it with our policy.

pip install morl-baselines moocore, then: python docs/examples/morl_capql.py [STEPS]. Written for morl-baselines 1.3.
"""

import sys
import time
from collections.abc import Callable

import gymnasium as gym
import moocore
import numpy as np
from impact_gym.agents import baselines, load_policy
from morl_baselines.multi_policy.capql.capql import CAPQL

WEIGHTS = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)  # time weights, m/s per s
Act = Callable[[np.ndarray, float], np.ndarray]
REFERENCE, SCENARIOS = (1.2, 2.0), 500  # reference point of the hypervolume (s, m/s); number of test scenarios


def front(act: Act) -> np.ndarray:
    """Return a controller's mean time (s), and mean V_p plus cost of misses (m/s), at each weight."""
    points = []
    for weight in WEIGHTS:
        envs = gym.make_vec("mo-impact-approach-v0", num_envs=SCENARIOS, time_weight=weight)
        seen, _ = envs.reset(seed=2_000_000)
        total, ended = np.zeros((SCENARIOS, 2)), np.zeros(SCENARIOS, bool)
        while not ended.all():
            seen, rewards, terminated, truncated, _ = envs.step(act(seen, weight))
            total[~ended] += rewards[~ended]
            ended |= terminated | truncated
        points.append(-total.mean(axis=0))
    return np.array(points)


def main(steps: int) -> None:
    """Train CAPQL, and print means and hypervolume of each controller."""
    train, watched = (gym.make("mo-impact-approach-v0", disable_env_checker=True) for _ in range(2))
    agent = CAPQL(train, gamma=0.999, alpha=0.002, batch_size=256, log=False, seed=0, device="cpu")
    began = time.time()
    agent.train(steps, watched, ref_point=-np.array(REFERENCE), eval_freq=steps + 1)

    def capql(seen: np.ndarray, weight: float) -> np.ndarray:
        mixed = np.array([weight, 1.0]) / (1.0 + weight)
        fixed = seen.copy()
        fixed[:, -1] = train.reset()[0][-1]  # constant weight, as in training; `mixed` gives CAPQL the true weight
        return np.array([agent.eval(each, mixed) for each in fixed])

    policy, rule = load_policy("linear-blind"), baselines.PaperTrapezoid()
    players = {
        "CAPQL": capql,
        "policy that observes w": lambda seen, _: policy.predict(seen)[0],
        "paper's rule": lambda seen, _: rule.predict(seen)[0],
    }
    print(f"{steps} steps in {time.time() - began:.0f} s")
    for name, act in players.items():
        points = front(act)
        print(name, f"hypervolume {moocore.hypervolume(points, ref=REFERENCE):.4f}", np.round(points, 3).tolist())


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
