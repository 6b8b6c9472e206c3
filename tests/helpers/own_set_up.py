"""A user's set-up with its own arm, a short training and a short report."""

TEXT = """
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
[evaluation]
weights = [1.0, 4.0]
curve = [1.0, 4.0]
scenarios = 30
varied = { tool_mass = [0.4] }
"""


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
