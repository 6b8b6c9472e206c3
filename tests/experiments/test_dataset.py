"""Datasets of Minari: their contract, atomic writes, bit-exact replay; an operator made of attempts."""

import json
import os
import runpy
import sys
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
from play_client import pushed
from refusal import refused

from agents.baselines import PaperTrapezoid
from agents.policies import load_policy
from agents.setups import load_baseline, load_setup
from experiments.play import attempts
from impact_gym.support.files import UNFINISHED
from impact_gym.support.sources import compiled_from

minari = pytest.importorskip("minari")
dataset = pytest.importorskip("experiments.dataset")
COUNT, SEED = 5, 123
NAME = "impact/linear-blind/rule-v0"
EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "minari_again.py"


@pytest.fixture(autouse=True)
def root(tmp_path, monkeypatch):
    monkeypatch.setenv(dataset.ROOT, str(tmp_path / "datasets"))
    return tmp_path / "datasets"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Attempts of persons who push beyond the touch, with several delays and assistances; one is marked."""
    path = tmp_path_factory.mktemp("attempts")
    for seed, assist in enumerate(("none", "brake", "policy", "limit", "none")):
        options = {"assist": assist, "seed": seed, "delay": 0.1 * seed}
        this = pushed(lambda time, seed=seed: 0.1 + 0.3 * np.sin(3.0 * time + seed) ** 2, **options)
        this.marks.extend(["interrupted: a test"] * (seed == 4))
        attempts.write(path / f"{seed}.json", this)
    return path


def make(source="linear-blind", **options):
    dataset.work(dataset.DatasetOptions(str(source), **{"episodes": COUNT, "seed": SEED, **options}))


@pytest.fixture
def rule(root):
    """The folder of the dataset NAME."""
    make(who=("rule",))
    return root / NAME / "data"


def test_episodes_are_those_of_the_environment_in_order(capsys, monkeypatch):
    make()
    printed, setup = capsys.readouterr().out.splitlines(), load_setup("linear-blind")
    env, rule, policy = setup.make(time_weight=setup.training.time_weight), PaperTrapezoid(), load_policy(setup.name)
    for who, line in zip(dataset.PLAYERS, printed, strict=True):
        name, returns, steps = f"impact/linear-blind/{who}-v0", [], 0
        for seed, episode in enumerate(minari.load_dataset(name), start=SEED):
            profile = load_baseline(setup.against[0], episode.infos["time_weight"][0]).for_task(setup.task)
            player = {"rule": rule, "profile": profile, "policy": policy}[who]
            actions = player.predict(episode.observations[:-1], deterministic=True)[0]
            observation, _ = env.reset(seed=seed)
            observations, rewards, ended, _, _ = zip(*map(env.step, actions), strict=True)
            assert np.array_equal(episode.actions, actions)
            assert np.array_equal(episode.observations, [observation, *observations])
            assert np.array_equal([episode.rewards, episode.terminations], [rewards, ended])
            last = {name: values[-1] for name, values in episode.infos.items()}
            loss = last["object_velocity"] + last["time_weight"] * last["approach_time"]
            assert -sum(rewards) == pytest.approx(loss, rel=1e-12)
            returns, steps = [*returns, episode.rewards.sum()], steps + len(episode.rewards)
        assert line == f"{name}: {COUNT} episodes, {steps} steps, mean return {np.mean(returns):.4f} m/s"
        about = json.loads((dataset.get_dataset_path(name) / "data" / "metadata.json").read_text())
        assert [about[key] for key in ("total_steps", "algorithm_name", "solver")] == [steps, who, compiled_from()]
    monkeypatch.setattr(sys, "argv", ["", "impact/linear-blind/profile-v0"])
    runpy.run_path(str(EXAMPLE))
    assert capsys.readouterr().out == "begins as recorded: True\n"


def test_failed_write_leaves_nothing_and_none_is_replaced(rule, root):
    before = os.stat(rule).st_ino
    make(who=("rule",))  # the same again, as after an interruption
    refused(lambda: make(who=("rule",), seed=SEED + 1), f"there is another dataset {NAME} already", "another --version")
    assert os.stat(rule).st_ino == before
    setup = load_setup("linear-blind")

    def stopped():
        yield dataset.recorded(setup.make(), 1, {}, dataset.players("rule", setup))
        raise KeyboardInterrupt

    (left := root / f".a.{10**9}{UNFINISHED}" / "a").mkdir(parents=True)  # by a killed process
    options = dataset.DatasetOptions("linear-blind"), "rule", ""
    with pytest.raises(KeyboardInterrupt):
        dataset.write("impact/linear-blind/rule-v1", setup.make(), stopped(), *options)
    assert [*minari.list_local_datasets()] == [NAME]
    assert not left.parent.exists()
    assert [*root.rglob("*.hdf5")] == [rule / "main_data.hdf5"]


@pytest.mark.parametrize("what", ["observations", "rewards", "terminations", "truncations"])
def test_check_refuses_an_episode_that_differs_in_one_bit(rule, what, capsys):
    make(NAME, check=True)
    assert capsys.readouterr().out == f"{NAME}: {COUNT} episodes replay exactly\n"
    with h5py.File(rule / "main_data.hdf5", "a") as content:
        column = content[f"episode_{COUNT - 1}/{what}"]
        column[5] = ~column[5] if column.dtype == bool else np.nextafter(column[5], np.inf, dtype=column.dtype)
    said = f"{what} of episode {COUNT - 1} differ when replayed", "the dataset was made with impact-gym=="
    refused(lambda: make(NAME, check=True), *said)


RUN = "subprocess:check_output"
HOSTILE = {  # the named field, and a hostile value in a dataset's metadata
    "entry_point": {"entry_point": RUN, "kwargs": {"args": ["touch", "evil"]}},
    "vector_entry_point": {"vector_entry_point": RUN},
    "additional_wrappers": {"additional_wrappers": [{"name": "x", "entry_point": RUN, "kwargs": {}}]},
    "id must be one of ImpactApproach-v0": {"id": "subprocess:Evil-v0"},
    "uplink.trace": {"kwargs": {"uplink": {"trace": "trace.csv"}}},
}


SPOILED = {  # words of the refusal, and what changed metadata or data
    "it has 5 episodes, but its metadata say 1000000000": lambda about, _: about.update(total_episodes=10**9),
    "total_episodes must be a whole number of at least 1, got -1": lambda about, _: about.update(total_episodes=-1),
    "steps, but its metadata say -5": lambda about, _: about.update(total_steps=-5),
    "cannot be loaded (AssertionError): the dataset was made with a b": lambda about, _: about.update(
        minari_version=3, requirements=["a\nb" + 9999 * "c"]),
    "it has no 'total_episodes'": lambda about, _: about.pop("total_episodes"),
    "its data must be in HDF5": lambda about, _: about.update(data_format="arrow"),
    "its observation_space is not": lambda about, _: about.update(observation_space=about["action_space"]),
    "it has 4 episodes, but its metadata say 5": lambda _, data: data.pop("episode_4"),
    "'episode_1/a' is a link": lambda _, data: data["episode_1"].update({"a": h5py.SoftLink("/episode_0")}),
    "'episode_2/a' is a link": lambda _, data: data["episode_2"].update({"a": h5py.ExternalLink("a.hdf5", "/a")}),
    "but the file only": lambda _, data: data.create_dataset("episode_1/a", (10**12,), "f8", chunks=(1000,)),
    "stored in other files": lambda _, data: data.create_dataset("episode_1/a", (3,), "f8", external="a.bin"),
    "episode 1 cannot be replayed": lambda _, data: data["episode_1"].attrs.update({"options": "text"}),
    "episode 2 cannot be replayed": lambda _, data: data["episode_2"].attrs.update({"seed": "text"}),
    "episode 3 cannot be replayed (it has too few": lambda _, data: data["episode_3/actions"].resize(3, 0),
    "actions of episode 4 differ": lambda _, data: data["episode_4/actions"].resize(999, 0),
}  # fmt: skip


@pytest.mark.parametrize("words", SPOILED)
def test_check_refuses_a_spoiled_dataset_in_one_line(rule, words):
    about = json.loads((rule / "metadata.json").read_text())
    with h5py.File(rule / "main_data.hdf5", "a") as data:
        SPOILED[words](about, data)
    (rule / "metadata.json").write_text(json.dumps(about))
    refused(lambda: dataset.check(NAME), NAME, words)
    (rule / "metadata.json").write_text("[]")
    refused(lambda: dataset.check(NAME), NAME, "must be an object, got []")


@pytest.mark.parametrize("field", HOSTILE)
def test_check_imports_nothing_that_a_dataset_names(rule, tmp_path, monkeypatch, field):
    monkeypatch.chdir(tmp_path)
    Path("trace.csv").write_text("0,0.01\n0.016,0.02\n")
    about = json.loads((rule / "metadata.json").read_text())
    about["env_spec"] = json.dumps(json.loads(about["env_spec"]) | HOSTILE[field])
    for _ in range(2):  # the second time without spaces, for which Minari makes the environment
        (rule / "metadata.json").write_text(json.dumps(about))
        refused(lambda: dataset.check(NAME), "cannot be loaded", field)
        about.pop("observation_space", None)
    assert not Path("evil").exists()


def test_bad_options_are_refused_and_own_set_ups_played(tmp_path):
    refused(lambda: make(who=("nobody",)), "who must be one of rule, profile, policy")
    path = tmp_path / "mine.toml"
    path.write_text(tomli_w.dumps({"environment": {"coupling": {"type": "SpringDamper", "stiffness": 80.0}}}))
    refused(lambda: make(path, who=("policy",)), "mine")
    make(path, who=("rule",), episodes=2)
    make("teleop-spring", who=("random",), episodes=2)
    assert [dataset.check(f"impact/{name}-v0") for name in ("mine/rule", "teleop-spring/random")] == [2, 2]


def test_tries_of_persons_play_again_to_the_bit(folder):
    refused(lambda: make(folder.parent), "has no try of a person to use")
    make(folder)
    name = "impact/teleop-spring/person-v0"
    assert (dataset.check(name), len(attempts.of_persons(folder, True))) == (4, 5)
    for this, episode in zip(attempts.of_persons(folder), minari.load_dataset(name), strict=True):
        assert np.array_equal(episode.actions, np.array(this.actions, np.float32))
        assert {*episode.infos["command"]} <= {*np.float64(this.operator["velocity"]), 0.0}
        assert episode.infos["done_time"][-1] == this.result["done_time"]
        assert episode.infos["slide"][-1] == pytest.approx(this.result["slide"], abs=1e-9)


def test_operator_draws_every_recording_and_a_set_up_takes_it(folder, tmp_path):
    make(folder, operator=tmp_path / "operator.toml")
    operator = tomllib.loads((tmp_path / "operator.toml").read_text())["environment"]["operator"]
    content = {"environment": load_setup("teleop-spring").environment | {"operator": operator}}
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(content))
    env, drawn = load_setup(tmp_path / "mine.toml").make(), set()
    for seed in range(50):
        env.reset(seed=seed)
        drawn.add(int(env.unwrapped.episode_info()["record"]["operator.recording"]))
    assert drawn == {0, 1, 2, 3}
    for number, this in enumerate(attempts.of_persons(folder)):
        env.reset(seed=1, options={"record": {"operator.recording": number, "uplink.delay": 0.0, "distance": 0.79}})
        sent = {env.step(np.array([1.0, 1.0, -1.0], np.float32))[4]["command"] for _ in range(40)}
        assert (sent <= {*this.operator["velocity"]}, len(sent) > 20) == (True, True)
