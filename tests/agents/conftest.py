import pytest
import torch

MINE = """
title = "A slow arm"
[environment]
tool_mass = [0.3, 0.5]
coupling = { type = "SpringDamper", stiffness = [200.0, 400.0], damping_ratio = 0.7 }
robot = { type = "Robot", mass = 8.0, stiffness = [5e4, 2e5], damping = 80.0 }
range_noise = [0.005, 0.02]
velocity_range = [-0.2, 0.6]
acceleration_range = [0.5, 4.0]
[environment.scenario]
object_mass = [0.2, 1.0]
distance = [0.1, 0.3]
[training]
steps = 2000
envs = 16
batch = 64
validation_scenarios = 10
seeds = 2
rollout = 16
[baselines]
budget = 16
"""


@pytest.fixture
def mine(tmp_path):
    """A set-up of one's own, in a file."""
    path = tmp_path / "mine.toml"
    path.write_text(MINE)
    return path


@pytest.fixture
def one_thread():
    """As a training has it."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
