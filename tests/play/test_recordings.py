"""What was played as data: a dataset that plays again to the bit, and an operator that draws among recordings."""

import gc
import sys
import tomllib
import types
import warnings

import numpy as np
import pytest
import tomli_w
from episodes import assert_identical

from agents.setups import load_setup
from experiments.play import recordings, tries
from experiments.play.assistance import usual
from experiments.play.live import Asked, Live
from impact_gym.envs.batch import Batch
from impact_gym.task import Task


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Tries of persons who push until a while after the touch, with several delays and assistances."""
    path = tmp_path_factory.mktemp("tries")
    for seed, assist in enumerate(("none", "brake", "policy", "limit")):
        live = Live(Asked("teleop-spring", assist, usual(load_setup("teleop-spring")) | {"delay": 0.1 * seed}, seed))
        late = 0
        while not live.ended:
            late += bool(live.batch.bodies().touched[0])
            live.step(0.0 if late > 4 else 0.1 + 0.3 * np.sin(3.0 * live.time + seed) ** 2)
        tries.write(path / f"{seed}.json", live.finished())
    return path


def test_dataset_loads_and_plays_again_to_the_bit(folder, tmp_path, monkeypatch):
    minari = pytest.importorskip("minari")
    tree = pytest.importorskip("torch.utils._pytree")  # Minari's collector takes `tree_map` from jax, nothing else
    monkeypatch.setitem(sys.modules, "jax", types.SimpleNamespace(tree_util=tree))
    monkeypatch.setitem(sys.modules, "jax.tree_util", tree)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    found = recordings.played(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Minari asks for an author, and leaves its folder to be cleaned up
        recordings.dataset(found, "impact/test-v0")
        gc.collect()
    dataset = minari.load_dataset("impact/test-v0")
    env, about = dataset.recover_environment(), dataset.storage.get_episode_metadata(range(len(found)))
    for this, episode, known in zip(found, dataset, about, strict=True):
        record = {name: float(values[0]) for name, values in episode.infos["record"].items()}
        observation, _ = env.reset(seed=known["seed"], options={"record": record})
        for step, action in enumerate(episode.actions):
            assert_identical(observation, episode.observations[step])
            observation, reward, *_, info = env.step(action)
            assert reward == episode.rewards[step]
            assert info["command"] == episode.infos["command"][step + 1]
        assert np.array_equal(episode.actions, np.array(this.actions, np.float32))
        assert info["done_time"] == this.result["done_time"]
        assert info["slide"] == pytest.approx(this.result["slide"], abs=1e-9)


def test_operator_draws_every_recording_and_a_set_up_takes_it(folder, tmp_path):
    found = recordings.played(folder)
    options = recordings.Recordings(folder, operator=tmp_path / "operator.toml")
    recordings.work(options)
    operator = tomllib.loads((tmp_path / "operator.toml").read_text())["environment"]["operator"]
    content = {"environment": {**load_setup("teleop-spring").environment, "operator": operator}}
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(content))
    setup = load_setup(tmp_path / "mine.toml")
    batch = Batch(400, Task(**setup.environment), threads=1)
    batch.begin_seeded(0, {})
    drawn = np.floor(batch.info()["record"]["operator.recording"]).astype(int)
    assert {*drawn} == {0, 1, 2, 3}
    env = setup.make()
    for number, this in enumerate(found):
        env.reset(seed=1, options={"record": {"operator.recording": number, "uplink.delay": 0.0, "distance": 0.79}})
        sent, ended = [], False
        while not ended and len(sent) < 60:
            *_, ended, _, info = env.step(np.array([1.0, 1.0, -1.0], np.float32))
            sent.append(info["command"])
        assert {*sent} <= {*this.operator["velocity"]}
        assert len({*sent} & {*this.operator["velocity"]}) > 20


def test_tries_that_do_not_count_or_do_not_fit_are_left_out_or_refused(folder, tmp_path):
    with pytest.raises(ValueError, match="has no try of a person that counts"):
        recordings.played(tmp_path)
    for name, setup in (("a", "teleop-rigid"), ("b", "teleop-spring")):
        live = Live(Asked(setup, "none", usual(load_setup(setup)), 1))
        while not live.ended:
            live.step(0.4 if live.time < 2.0 else 0.0)
        tries.write(tmp_path / f"{name}.json", live.finished())
    with pytest.raises(ValueError, match="several couplings or set-ups"):
        recordings.played(tmp_path)
