"""Datasets of Minari: their contract, atomic writes, bit-exact replay; an operator made of tries."""

import json
import subprocess
import sys
import tomllib
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomli_w
from play_client import pushed
from refusal import refused

from agents.setups import load_setup
from experiments.play import try_files
from impact_gym.envs.batch import Batch
from impact_gym.task import Task

minari = pytest.importorskip("minari")
dataset = pytest.importorskip("experiments.dataset")
COUNT = 12


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
    dataset.work(dataset.DatasetOptions(str(source), **{"episodes": COUNT, **options}))


rule_of = partial(make, who=("rule",))
check_rule = partial(dataset.check, "impact/linear-blind/rule-v0")


def test_each_player_of_a_set_up_has_a_dataset_that_replays(capsys):
    make()
    names = [f"impact/linear-blind/{who}-v0" for who in dataset.PLAYERS]
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == names
    for name in names:
        assert dataset.check(name) == COUNT
        loaded = minari.load_dataset(name)
        for episode in loaded:
            assert all(map(loaded.observation_space.contains, episode.observations))
            assert all(map(loaded.action_space.contains, episode.actions))
    example = Path(__file__).parents[2] / "docs" / "examples" / "minari_again.py"
    command = [sys.executable, str(example), "impact/linear-blind/profile-v0"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "begins as recorded: True\n"


def test_failed_write_leaves_nothing_and_nothing_is_overwritten(root):
    setup = load_setup("linear-blind")

    def stopped():
        yield dataset.recorded(setup.make(), 1, {}, dataset.players("rule", setup))
        raise KeyboardInterrupt

    named = ("impact/linear-blind/rule-v0", setup.make(), stopped(), dataset.DatasetOptions("linear-blind"), "rule", "")
    with pytest.raises(KeyboardInterrupt):
        dataset.write(*named)
    assert not minari.list_local_datasets()
    assert not list(root.rglob("*.hdf5"))
    rule_of()
    refused(rule_of, "there is a dataset impact/linear-blind/rule-v0 already", "another --version")
    rule_of(version=1)
    assert {*minari.list_local_datasets()} == {f"impact/linear-blind/rule-v{version}" for version in (0, 1)}


def test_dataset_of_another_version_is_refused(tmp_path):
    refused(lambda: dataset.check("impact/no-v0"), "there is no dataset 'impact/no-v0'")
    rule_of()
    file = next(tmp_path.rglob("main_data.hdf5"))
    with h5py.File(file, "a") as content:
        content["episode_3/rewards"][5] += 1e-16 + abs(content["episode_3/rewards"][5]) * 1e-15
    refused(check_rule, "rewards of episode 3 differ when replayed", "the dataset was made with impact-gym==")
    about = next(tmp_path.rglob("metadata.json"))
    about.write_text(about.read_text().replace("time_weight", "weight_of_time"))  # an unknown argument
    refused(check_rule, "cannot be loaded", "weight_of_time")


RUN = "subprocess:check_output"
HOSTILE = {  # the named field, and a hostile value in a dataset's metadata
    "entry_point": {"entry_point": RUN, "kwargs": {"args": ["touch", "evil"]}},
    "vector_entry_point": {"vector_entry_point": RUN},
    "additional_wrappers": {"additional_wrappers": [{"name": "x", "entry_point": RUN, "kwargs": {}}]},
    "id must be one of ImpactApproach-v0": {"id": "subprocess:Evil-v0"},
    "uplink.trace": {"kwargs": {"uplink": {"trace": "trace.csv"}}},
    "coupling": {"kwargs": {"coupling": RUN}},
}


@pytest.mark.parametrize("spaces", [True, False], ids=["", "without spaces, for which Minari makes the environment"])
@pytest.mark.parametrize("field", HOSTILE)
def test_check_imports_nothing_that_a_dataset_names(root, tmp_path, monkeypatch, field, spaces):
    rule_of()
    monkeypatch.chdir(tmp_path)
    Path("trace.csv").write_text("0,0.01\n0.016,0.02\n")
    file = next(root.rglob("impact/linear-blind/rule-v0/data/metadata.json"))
    about = json.loads(file.read_text())
    about["env_spec"] = json.dumps(json.loads(about["env_spec"]) | HOSTILE[field])
    if not spaces:
        del about["observation_space"]
    file.write_text(json.dumps(about))
    refused(check_rule, "cannot be loaded", field)
    assert not Path("evil").exists()


@pytest.mark.parametrize(("options", "said"), [
    ({"who": ("nobody",)}, ("who must be one of rule, profile, policy", "'nobody'")),
    ({"who": ("json:nothing",)}, ("no controller 'json:nothing'",)),
    ({"who": ("rule", "rule")}, ("who must have no equal entries", "'rule'")),
    ({"episodes": 0}, ("episodes must be", "at least 1", "got 0")),
    ({"namespace": "../.."}, ("Malformed dataset ID",)),
    ({"source": "no-such"}, ("no set-up 'no-such'",)),
])  # fmt: skip
def test_bad_input(options, said):
    refused(lambda: make(**{"who": ("rule",), **options}), *said)


def test_policy_is_refused_where_there_is_none_and_a_set_up_with_an_operator_takes_random_actions(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(tomli_w.dumps({"environment": {"coupling": {"type": "SpringDamper", "stiffness": 80.0}}}))
    refused(lambda: make(str(path), who=("policy",)), "mine")
    rule_of(path)
    assert dataset.check("impact/mine/rule-v0") == COUNT
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


def test_tries_that_do_not_count_or_do_not_fit_are_refused(tmp_path):
    refused(lambda: make(tmp_path), "has no try of a person to use")
    for setup in ("teleop-rigid", "teleop-spring"):
        try_files.write(tmp_path / f"{setup}.json", pushed(lambda time: 0.4 if time < 2.0 else 0.0, setup=setup))
    refused(lambda: make(tmp_path, operator=tmp_path / "operator.toml"), "several set-ups or couplings")
    assert not (tmp_path / "operator.toml").exists()
