"""The files in docs/examples: scripts print the numbers of `simulate`, set-ups hold what their texts say."""

import re
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scenes import MOTION, scene

import impact_gym as ig
from agents.setups import feasible, load_setup
from experiments.design.options import DRAWN
from experiments.design.pads import on_pad
from impact_gym.task import ScenarioRanges, Task

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "docs" / "examples"


def printed_by(name, *arguments):
    """The numbers in each line that an example prints; a warning is an error."""
    command = [sys.executable, "-W", "error", str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [[float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", line)] for line in done.stdout.splitlines()]


def paper_rule(seed):
    """Approach time and V_p of the paper's rule by `simulate`, in the scenario that is documented for a seed."""
    mass, stiffness, restitution, share = gym.utils.seeding.np_random(seed)[0].random(7)[:4]
    mass, stiffness = 0.1 * 25.0**mass, 1e3 * 1e3**stiffness
    restitution, distance = 0.1 + 0.9 * restitution, 0.15 + 0.2 * share
    chain = scene(stiffness, restitution, ig.SpringDamper(50.0), m_p=mass, distance=distance)
    outcome = ig.simulate(chain, MOTION, duration=3.0)
    return outcome.contacts[0].start, outcome.object_velocity


DESIGNED = {"designed-mechanism.toml", "designed-foam.toml"}


@pytest.mark.parametrize("name", sorted(DESIGNED))
def test_designed_end_effector_is_a_set_up_with_the_training_of_its_original(name):
    setup = load_setup(EXAMPLES / name)
    sentences = feasible.warnings(Task(**setup.environment))  # its controller stays below that acceleration
    assert [sentence for sentence in sentences if "the front stop holds the tool up to" not in sentence] == []
    assert setup.training.steps == load_setup("linear-blind").training.steps


def test_contact_of_the_padded_design_is_that_of_the_usual_scenarios_behind_its_pad():
    setup, usual = load_setup(EXAMPLES / "designed-foam.toml"), ScenarioRanges()
    corners = np.array([on_pad("memory-foam", k, e) for k in usual.contact_stiffness for e in usual.restitution])
    for name, values in zip(("contact_stiffness", "restitution"), corners.T, strict=True):
        assert setup.environment["scenario"][name] == pytest.approx([values.min(), values.max()])
    assert "on a pad of memory-foam" in setup.about
    assert DRAWN in setup.about


def test_mechanism_is_held_in_every_corner_of_its_ranges():
    task = Task(**load_setup(EXAMPLES / "bistable-robust.toml").environment)
    assert feasible.warnings(task) == []
    assert len([*feasible.corners(task)]) == 64


def test_loops_print_what_simulate_gives():
    lines = printed_by("gymnasium_loop.py")
    ((*means, scenarios),) = printed_by("vector_loop.py")
    expected = np.array([paper_rule(seed) for seed in range(1000)])
    assert [line[0] for line in lines] == list(range(5))
    assert np.array([line[1:3] for line in lines]) == pytest.approx(expected[:5], rel=0, abs=0.51e-4)  # four decimals
    assert means == pytest.approx(expected.mean(axis=0), rel=0, abs=0.51e-4)
    assert scenarios == 1000


def test_stable_baselines3_script_learns():
    (untrained,), (steps, trained) = printed_by("stable_baselines3_ppo.py", "32768")
    assert steps == 32768
    assert untrained + 0.05 < trained < 0.0
