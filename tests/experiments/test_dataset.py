"""Datasets of Minari: as its contract says, whole or not there, and played again to the bit."""

import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
from episodes import assert_identical

from agents.baselines import PaperTrapezoid
from agents.evaluate import ScenarioBatch
from agents.setups import load_setup

minari = pytest.importorskip("minari")
dataset = pytest.importorskip("experiments.dataset")
COUNT = 12


def refused(*said):
    """What is expected of bad input: one line that says all of this."""
    return pytest.raises(ValueError, match=".*".join(map(re.escape, said)))


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv(dataset.ROOT, str(tmp_path / "datasets"))
    return tmp_path / "datasets"


def make(source="linear-blind", **options):
    dataset.work(dataset.DatasetOptions(source, **{"episodes": COUNT, **options}))


def test_of_a_set_up_each_player_has_one_that_plays_again(capsys):
    make()
    for who in dataset.PLAYERS:
        loaded = minari.load_dataset(name := f"impact/linear-blind/{who}-v0")
        assert loaded.total_episodes == COUNT
        assert dataset.check(name) == COUNT
        about = loaded.storage.metadata
        assert {*about} >= {"author", "code_permalink", "requirements", "algorithm_name", "description", "env_spec"}
        env = loaded.recover_environment()
        begun = loaded.storage.get_episode_metadata(range(COUNT))
        for episode, at in zip(loaded, begun, strict=True):
            observation, _ = env.reset(seed=at["seed"], options=at["options"])
            assert all(map(loaded.observation_space.contains, episode.observations))
            assert all(map(loaded.action_space.contains, episode.actions))
            for step, action in enumerate(episode.actions):
                assert_identical(observation, episode.observations[step])
                observation, reward, ended, _, info = env.step(action)
                assert (reward, ended) == (episode.rewards[step], episode.terminations[step])
                assert env.unwrapped.sensors()["position"] == episode.infos["position"][step + 1]
            assert info["object_velocity"] == episode.infos["object_velocity"][-1]
            assert info["record"] == at["options"]["record"]
    said = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in said] == [f"impact/linear-blind/{who}-v0" for who in dataset.PLAYERS]


def test_example_of_the_page_begins_an_episode_again():
    make(who=("profile",))
    example = Path(__file__).parents[2] / "docs" / "examples" / "minari_again.py"
    command = [sys.executable, str(example), "impact/linear-blind/profile-v0"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "begins as recorded: True\n"


def test_the_rule_is_what_the_batch_plays():
    make(who=("rule",))
    loaded, setup = minari.load_dataset("impact/linear-blind/rule-v0"), load_setup("linear-blind")
    weights = [at["options"]["record"]["time_weight"] for at in loaded.storage.get_episode_metadata(range(COUNT))]
    batch = ScenarioBatch(dataset.SEED, COUNT, **{"scenario": "train", **setup.environment})
    judged = batch.play(PaperTrapezoid())
    assert np.ptp(weights) > 1.0
    assert_identical(np.array([episode.infos["object_velocity"][-1] for episode in loaded]), judged.object_velocity)


def test_nothing_is_left_of_one_that_failed_and_nothing_is_overwritten(root, monkeypatch):
    played = dataset.recorded

    def fails_once(env, seed, *rest):
        if seed == dataset.SEED + 2:
            raise KeyboardInterrupt
        return played(env, seed, *rest)

    with monkeypatch.context() as failing:
        failing.setattr(dataset, "recorded", fails_once)
        with pytest.raises(KeyboardInterrupt):
            make(who=("rule",))
    assert not minari.list_local_datasets()
    assert not list(root.rglob("*.hdf5"))
    make(who=("rule",))
    with refused("there is a dataset impact/linear-blind/rule-v0 already", "another --version"):
        make(who=("rule",))
    make(who=("rule",), version=1)
    assert {*minari.list_local_datasets()} == {f"impact/linear-blind/rule-v{version}" for version in (0, 1)}


def test_one_of_another_version_is_refused_in_a_line(tmp_path):
    with refused("there is no dataset 'impact/no-v0'", "which has: none"):
        dataset.check("impact/no-v0")
    make(who=("rule",))
    file = next(tmp_path.rglob("main_data.hdf5"))
    with h5py.File(file, "a") as content:
        content["episode_3/rewards"][5] += 1e-16 + abs(content["episode_3/rewards"][5]) * 1e-15
    with refused("rewards of episode 3 are others when played again", "it was made with impact-gym=="):
        dataset.check("impact/linear-blind/rule-v0")
    about = next(tmp_path.rglob("metadata.json"))
    about.write_text(about.read_text().replace("time_weight", "weight_of_time"))  # an argument that is none here
    with refused("has an environment that is none here", "weight_of_time"):
        dataset.check("impact/linear-blind/rule-v0")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"who": ("nobody",)}, ("who must be of rule, profile, policy", "'nobody'")),
        ({"who": ("json:nothing",)}, ("no controller 'json:nothing'",)),
        ({"episodes": 0}, ("episodes must be", "at least 1", "got 0")),
        ({"namespace": "../.."}, ("Malformed dataset ID",)),
        ({"source": "no-such"}, ("no set-up 'no-such'",)),
    ],
)
def test_bad_input(options, said):
    with refused(*said):
        make(**{"source": "linear-blind", "who": ("rule",), **options})


def test_a_set_up_of_ones_own_without_a_policy_says_so(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(tomli_w.dumps({"environment": {"coupling": {"type": "SpringDamper", "stiffness": 80.0}}}))
    with refused("mine"):
        make(str(path), who=("policy",))
    make(str(path), who=("rule",))
    assert dataset.check("impact/mine/rule-v0") == COUNT
