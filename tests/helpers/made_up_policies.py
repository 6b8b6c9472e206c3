"""Policies with random weights."""

import itertools

import numpy as np

from agents import Policy
from agents.policies.networks import Affine, Network
from impact_gym.task import ObservationSpec, Task


def made_up_policy(seed=0, environment=None, activation="tanh", log_std=-1.0, sizes=(16, 12)):
    rng = np.random.default_rng(seed)

    def affine(name, outputs, inputs):
        weight = rng.normal(size=(outputs, inputs)) / (1.0 if name == "hidden_0" else np.sqrt(inputs))
        return Affine(name, weight.astype(np.float32), rng.normal(size=outputs).astype(np.float32) * np.float32(0.3))

    task = Task(**(environment or {}))
    outputs, widths = len(task.action), [len(ObservationSpec(task)), *sizes]
    hidden = [affine(f"hidden_{k}", n, m) for k, (m, n) in enumerate(itertools.pairwise(widths))]
    noise = Affine("log_std", np.zeros((outputs, widths[-1]), np.float32), np.full(outputs, log_std, np.float32))
    network = Network(tuple(hidden), affine("mean", outputs, widths[-1]), noise, activation)
    return Policy(network, task, {"command": "by hand", "settings": {"seed": seed}})


KINDS = {
    "tanh": {}, "relu": {"activation": "relu", "sizes": (24,)}, "ranged": {"environment": {"range_noise": 0.01}},
    "linear": {"sizes": ()},
}  # fmt: skip


def observations(policy, count=5000, seed=1):
    """Return observations drawn uniformly from the observation space of a policy, a rule or a teacher."""
    low = policy.spec.scaled_low
    return np.random.default_rng(seed).uniform(low, 1.0, (count, len(low))).astype(np.float32)
