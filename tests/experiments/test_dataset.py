"""Datasets of Minari: their contract, atomic writes, bit-exact replay; an operator made of tries."""

import json
import runpy
import shutil
import sys
import tomllib
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
from play_client import pushed
from refusal import refused

from agents.baselines import PaperTrapezoid, load_baseline
from agents.policies import load_policy
from agents.setups import load_setup
from experiments.play import try_files
from impact_gym.envs.batch import Batch
from impact_gym.sources import compiled_from
from impact_gym.task import Task

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
    """Tries of persons who push beyond the touch, with several delays and assistances; one is marked."""
    path = tmp_path_factory.mktemp("tries")
    for seed, assist in enumerate(("none", "brake", "policy", "limit", "none")):
        this = pushed(lambda time, seed=seed: 0.1 + 0.3 * np.sin(3.0 * time + seed) ** 2, assist=assist, seed=seed,
                      delay=0.1 * seed)  # fmt: skip
        this.marks.extend(["interrupted: a test"] * (seed == 4))
        try_files.write(path / f"{seed}.json", this)
    return path


def make(source="linear-blind", **options):
    dataset.work(dataset.DatasetOptions(str(source), **{"episodes": COUNT, "seed": SEED, **options}))


rule_of = partial(make, who=("rule",))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the dataset NAME; `rule` copies it."""
    path = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(dataset.ROOT, str(path))
        rule_of()
    return path


@pytest.fixture
def rule(made, root):
    """The folder of a copy of the dataset NAME."""
    return shutil.copytree(made, root) / NAME / "data"


def check_by_hand(env, seed, episode, player):
    """Play the actions of an episode again, and let the player choose them again."""
    observation, _ = env.reset(seed=seed)
    observations, rewards, ended, cut, infos = zip(*map(env.step, episode.actions), strict=True)
    assert np.array_equal(episode.observations, [observation, *observations])
    assert np.array_equal(episode.actions, player.predict(episode.observations[:-1], deterministic=True)[0])
    assert np.array_equal(episode.rewards, rewards)
    assert np.array_equal([episode.terminations, episode.truncations], [ended, cut])
    assert ended.index(True) == len(ended) - 1
    last = {name: values[-1] for name, values in episode.infos.items()}
    assert (last["object_velocity"], last["position"]) == (
        infos[-1]["object_velocity"],
        env.unwrapped.sensors()["position"],
    )
    assert -sum(rewards) == pytest.approx(
        last["object_velocity"] + last["time_weight"] * last["approach_time"], rel=1e-12
    )


def test_episodes_are_those_of_the_environment_in_order(capsys, monkeypatch):
    make()
    printed, setup = capsys.readouterr().out.splitlines(), load_setup("linear-blind")
    env, rule, policy = setup.make(time_weight=setup.training.time_weight), PaperTrapezoid(), load_policy(setup.name)
    for who, line in zip(dataset.PLAYERS, printed, strict=True):
        name, returns, steps = f"impact/linear-blind/{who}-v0", [], 0
        assert dataset.check(name) == COUNT
        for seed, episode in enumerate(minari.load_dataset(name), start=SEED):
            profile = load_baseline(setup.against[0], episode.infos["time_weight"][0]).for_task(setup.task)
            check_by_hand(env, seed, episode, {"rule": rule, "profile": profile, "policy": policy}[who])
            returns, steps = [*returns, episode.rewards.sum()], steps + len(episode.rewards)
        assert line == f"{name}: {COUNT} episodes, {steps} steps, mean return {np.mean(returns):.4f} m/s"
        about = dataset.MinariStorage.read_raw_metadata(dataset.get_dataset_path(name) / "data")
        assert (about["total_episodes"], about["total_steps"]) == (COUNT, steps)
        assert (about["algorithm_name"], about["solver"]) == (who, compiled_from())
        assert f"impact-gym=={version('impact-gym')}" in about["requirements"]
        assert dataset.PLAYERS[who] in about["description"]
    monkeypatch.setattr(sys, "argv", ["", "impact/linear-blind/profile-v0"])
    runpy.run_path(str(EXAMPLE))
    assert capsys.readouterr().out == "begins as recorded: True\n"


def test_failed_write_leaves_nothing_and_none_is_replaced(root):
    setup = load_setup("linear-blind")

    def stopped():
        yield dataset.recorded(setup.make(), 1, {}, dataset.players("rule", setup))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        dataset.write(NAME, setup.make(), stopped(), dataset.DatasetOptions("linear-blind"), "rule", "")
    assert not minari.list_local_datasets()
    assert not list(root.rglob("*.hdf5"))
    rule_of()
    refused(rule_of, f"there is a dataset {NAME} already", "another --version")
    rule_of(version=1)
    assert {*minari.list_local_datasets()} == {f"impact/linear-blind/rule-v{version}" for version in (0, 1)}


@pytest.mark.parametrize("what", ["observations", "rewards", "terminations", "truncations"])
def test_check_refuses_an_episode_that_differs_in_one_bit(rule, what):
    with h5py.File(rule / "main_data.hdf5", "a") as content:
        column = content[f"episode_{COUNT - 1}/{what}"]
        flag = column.dtype == bool
        column[5] = ~column[5] if flag else np.nextafter(column[5], np.inf, dtype=column.dtype)
    said = f"{what} of episode {COUNT - 1} differ when replayed", "the dataset was made with impact-gym=="
    refused(lambda: make(NAME, check=True), *said)


def test_check_counts_or_refuses_what_it_cannot_load(rule, capsys):
    make(NAME, check=True)
    assert capsys.readouterr().out == f"{NAME}: {COUNT} episodes replay exactly\n"
    refused(lambda: dataset.check("impact/no-v0"), "there is no dataset 'impact/no-v0'", NAME)
    about = rule / "metadata.json"
    about.write_text(about.read_text().replace("time_weight", "weight_of_time"))  # an unknown argument
    refused(lambda: dataset.check(NAME), "cannot be loaded", "weight_of_time")


RUN = "subprocess:check_output"
HOSTILE = {  # the named field, and a hostile value in a dataset's metadata
    "entry_point": {"entry_point": RUN, "kwargs": {"args": ["touch", "evil"]}},
    "vector_entry_point": {"vector_entry_point": RUN},
    "additional_wrappers": {"additional_wrappers": [{"name": "x", "entry_point": RUN, "kwargs": {}}]},
    "id must be one of ImpactApproach-v0": {"id": "subprocess:Evil-v0"},
    "uplink.trace": {"kwargs": {"uplink": {"trace": "trace.csv"}}},
    "coupling": {"kwargs": {"coupling": RUN}},
}


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


@pytest.mark.parametrize(("options", "said"), [
    ({"who": ("nobody",)}, ("who must be one of rule, profile, policy", "'nobody'")),
    ({"who": ("json:nothing",)}, ("no controller 'json:nothing'",)),
    ({"who": ("rule", "rule")}, ("who must have no equal entries", "'rule'")),
    ({"namespace": "../.."}, ("Malformed dataset ID",)),
    ({"source": "no-such"}, ("no set-up 'no-such'",)),
])  # fmt: skip
def test_bad_options_are_refused(options, said):
    refused(lambda: rule_of(**options), *said)


def test_players_of_an_own_set_up_and_of_one_with_an_operator(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(tomli_w.dumps({"environment": {"coupling": {"type": "SpringDamper", "stiffness": 80.0}}}))
    refused(lambda: make(str(path), who=("policy",)), "mine")
    rule_of(path, episodes=2)
    assert dataset.check("impact/mine/rule-v0") == 2
    make("teleop-spring", who=("random",), episodes=2)
    assert dataset.check("impact/teleop-spring/random-v0") == 2


@pytest.mark.parametrize(("marked", "count"), [(False, 4), (True, 5)])
def test_tries_of_persons_play_again_to_the_bit(folder, marked, count):
    make(folder, include_marked=marked)
    name = "impact/teleop-spring/person-v0"
    assert dataset.check(name) == count
    for this, episode in zip(try_files.of_persons(folder, marked), minari.load_dataset(name), strict=True):
        assert np.array_equal(episode.actions, np.array(this.actions, np.float32))
        assert {*episode.infos["command"]} <= {*np.float64(this.operator["velocity"]), 0.0}
        assert episode.infos["done_time"][-1] == this.result["done_time"]
        assert episode.infos["slide"][-1] == pytest.approx(this.result["slide"], abs=1e-9)


def test_operator_draws_every_recording_and_a_set_up_takes_it(folder, tmp_path):
    make(folder, operator=tmp_path / "operator.toml")
    assert not minari.list_local_datasets()
    operator = tomllib.loads((tmp_path / "operator.toml").read_text())["environment"]["operator"]
    content = {"environment": {**load_setup("teleop-spring").environment, "operator": operator}}
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(content))
    setup = load_setup(tmp_path / "mine.toml")
    batch = Batch(400, Task(**setup.environment), threads=1)
    batch.begin_seeded(0, {})
    assert {*np.floor(batch.info()["record"]["operator.recording"])} == {0, 1, 2, 3}
    env = setup.make()
    for number, this in enumerate(try_files.of_persons(folder)):
        env.reset(seed=1, options={"record": {"operator.recording": number, "uplink.delay": 0.0, "distance": 0.79}})
        sent = [env.step(np.array([1.0, 1.0, -1.0], np.float32))[4]["command"] for _ in range(40)]
        assert {*sent} <= {*this.operator["velocity"]}
        assert len({*sent}) > 20


def test_tries_that_do_not_count_or_fit_are_refused(folder, tmp_path):
    refused(lambda: make(tmp_path), "has no try of a person to use")
    this = try_files.read(folder / "0.json")
    other = replace(this, result=this.result | {"done_time": 0.9})
    try_files.write(tmp_path / "0.json", other)
    refused(lambda: make(tmp_path), "a try ends at another time when replayed")
    try_files.write(tmp_path / "1.json", replace(this, environment=load_setup("teleop-rigid").environment))
    refused(lambda: make(tmp_path, operator=tmp_path / "operator.toml"), "several set-ups or couplings")
    assert not (tmp_path / "operator.toml").exists()
