"""Controllers, training, saved policies and evaluation."""

import gc
import io
import itertools
import json
import math
import os
import pickle
import warnings
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import agents.train
import impact_gym as ig
from agents import Policy, baselines, load_policy
from agents.evaluation import TEST_SEED, VALIDATION_SEED, evaluate
from agents.train import Settings, train

TINY = {"steps": 2048, "envs": 16, "rollout": 16, "batch": 64}
OBJECTIVES = ("object_velocity", "approach_time", "peak_force", "missed")


class Run(NamedTuple):
    folder: Path
    model: Any  # of stable-baselines3
    left_open: list  # files of the log
    warned: list  # texts


def train_tiny(out, seed=0):
    """Train for some seconds, watching; what fails here is for one test to say, not for all that need a run."""
    models = []

    def export(model, provenance):
        models.append(model)
        return original(model, provenance)

    original = agents.train.export
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        patch.setattr(agents.train, "export", export)
        folder = train(Settings(**TINY, seed=seed, out=out))
    outputs = models[0].logger.output_formats
    left_open = [output.file.name for output in outputs if hasattr(output, "file") and not output.file.closed]
    models[0].logger.close()
    return Run(folder, models[0], left_open, [str(warning.message) for warning in caught])


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return train_tiny(tmp_path_factory.mktemp("runs") / "run")


def made_up_policy(seed=0, inputs=8, log_std=-1.0):
    rng = np.random.default_rng(seed)
    sizes = [inputs, 16, 12, 2]
    weights = [rng.normal(size=(n, m)).astype(np.float32) for m, n in itertools.pairwise(sizes)]
    biases = [rng.normal(size=n).astype(np.float32) for n in sizes[1:]]
    return Policy(weights, biases, np.full(2, log_std, np.float32), {"command": "by hand", "seed": seed})


def arrays_of(policy):
    return [*policy.weights, *policy.biases, policy.log_std]


def observations(count=5000):
    space = gym.make("ImpactApproach-v0").observation_space
    return np.random.default_rng(1).uniform(space.low, space.high, (count, 8)).astype(np.float32)


CONTROLLERS = [
    (baselines.PaperTrapezoid(), (1.0, 8.0), (0.0, 8.0)),
    (baselines.ConstantSpeed(0.3), (0.3, 8.0), (0.0, 8.0)),
    (baselines.ConstantSpeed(1.5, 20.0, 1.0), (1.5, 20.0), (0.0, 1.0)),
]


@pytest.mark.parametrize(("controller", "go", "stop"), CONTROLLERS)
def test_the_baselines_go_until_the_alarm_and_then_stop(controller, go, stop):
    seen = observations(50)
    seen[:, 3] = np.arange(50) % 2
    low, high = np.array([-0.5, 1.0]), np.array([1.5, 20.0])
    batch, state = controller.predict(seen, state="kept", episode_start=np.zeros(50, bool), deterministic=True)
    assert state == "kept"
    assert batch.dtype == np.float32
    assert batch.shape == (50, 2)
    expected = np.where(seen[:, 3:4] == 1.0, stop, go)
    assert low + 0.5 * (batch.astype(float) + 1.0) * (high - low) == pytest.approx(expected, rel=0, abs=1e-6)
    for row, observation in zip(batch, seen, strict=True):
        action, state = controller.predict(observation)
        assert state is None
        assert action.shape == (2,)
        assert action in gym.make("ImpactApproach-v0").action_space
        assert np.array_equal(action, row)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"speed": 0.0}, "speed.*above 0.*m/s"),
    ({"speed": 1.6}, "speed.*at most 1.5"),
    ({"speed": 1.0, "acceleration": 0.5}, "acceleration.*at least 1"),
    ({"speed": 1.0, "deceleration": 21.0}, "deceleration.*at most 20"),
    ({"speed": math.nan}, "speed.*finite"),
], ids=str)  # fmt: skip
def test_a_baseline_that_the_environment_cannot_play_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        baselines.ConstantSpeed(**arguments)


@pytest.mark.parametrize("inputs", [8, 9])
def test_a_policy_survives_its_file_bit_for_bit(tmp_path, inputs):
    policy = made_up_policy(inputs=inputs)
    path = policy.save(tmp_path / "new" / "policy.npz")
    assert [file.name for file in path.parent.iterdir()] == ["policy.npz"]
    again = load_policy(path)
    assert again.inputs == inputs
    assert again.provenance == policy.provenance
    for one, other in zip(arrays_of(again), arrays_of(policy), strict=True):
        assert one.dtype == other.dtype
        assert np.array_equal(one, other)
    assert load_policy(str(path)).provenance == policy.provenance


def test_a_policy_is_the_network_it_says_it_is():
    """Written out in float64: tanh layers, a linear one, a cut to [-1, 1]."""
    policy, seen = made_up_policy(), observations()
    hidden = seen.astype(float)
    for weight, bias in zip(policy.weights[:-1], policy.biases[:-1], strict=True):
        hidden = np.tanh(hidden @ weight.T.astype(float) + bias)
    expected = np.clip(hidden @ policy.weights[-1].T.astype(float) + policy.biases[-1], -1.0, 1.0)
    batch, state = policy.predict(seen)
    assert state is None
    assert batch.dtype == np.float32
    assert batch == pytest.approx(expected, rel=0, abs=1e-5)
    assert 0.05 < np.mean(np.abs(batch) < 1.0) < 0.95
    single, state = policy.predict(seen[7], state="kept", deterministic=True)
    assert state == "kept"
    assert single.shape == (2,)
    assert single == pytest.approx(batch[7], rel=0, abs=1e-6)
    with pytest.raises(ValueError, match=r"8 numbers.*9"):
        policy.predict(np.zeros(9, np.float32))


def test_the_noise_of_a_policy_has_the_standard_deviation_it_says():
    policy = made_up_policy(log_std=-4.0)
    policy.biases[-1] *= 0.0
    policy.weights[-1] *= 0.0
    noise = policy.predict(observations(20_000), deterministic=False)[0]
    sigma = math.exp(-4.0)
    assert np.abs(noise.mean(axis=0)).max() < 5.0 * sigma / math.sqrt(20_000)
    assert np.abs(noise.std(axis=0) - sigma).max() < 5.0 * sigma / math.sqrt(40_000)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 5.0 / math.sqrt(20_000)


def test_an_exported_policy_is_the_model_it_came_from(trained):
    policy, seen = load_policy(trained.folder / "policy.npz"), observations()
    expected, _ = trained.model.predict(seen, deterministic=True)
    assert policy.predict(seen)[0] == pytest.approx(expected, rel=0, abs=1e-6)
    assert policy.log_std == pytest.approx(trained.model.policy.log_std.detach().numpy(), rel=0, abs=0)


def test_a_run_folder_says_how_it_came_about_and_what_came_of_it(trained):
    folder = trained.folder
    config = json.loads((folder / "config.json").read_text())
    assert "agents.train" in config["command"]
    assert TINY.items() <= config["settings"].items()
    assert config["settings"]["seed"] == 0
    assert {"python", "numpy", "torch", "gymnasium", "stable-baselines3", "impact-gym"} <= set(config["versions"])
    assert config["versions"]["impact-gym"] == ig.__version__
    assert load_policy(folder / "policy.npz").provenance == config
    judged = json.loads((folder / "metrics.json").read_text())["validation"]
    for name, controller in (
        ("policy", load_policy(folder / "policy.npz")),
        ("paper's rule", baselines.PaperTrapezoid()),
    ):
        episodes = evaluate(controller, VALIDATION_SEED, 1000)
        for objective in ("object_velocity", "approach_time", "missed"):
            assert judged[name][objective] == pytest.approx(getattr(episodes, objective).mean(), rel=1e-5)


def test_training_logs_the_objectives_by_name(trained):
    """As text and for TensorBoard; an update before which no episode ended says nothing instead of nan."""
    folder = trained.folder
    header, *rows = (folder / "progress.csv").read_text().splitlines()
    columns = dict(zip(header.split(","), zip(*(row.split(",") for row in rows), strict=True), strict=True))
    events = EventAccumulator(str(folder))
    events.Reload()
    for name in OBJECTIVES:
        written = [float(value) for value in columns[f"objectives/{name}"] if value]
        logged = [event.value for event in events.Scalars(f"objectives/{name}")]
        assert len(written) >= 4
        assert np.isfinite(written).all()
        assert logged == pytest.approx(written, rel=1e-5)
    assert columns["time/total_timesteps"][-1] == "2048"


def test_training_warns_of_nothing_and_closes_its_files(trained):
    """But for the progress bar of stable-baselines3, which silences that warning itself outside of tests."""
    assert [text for text in trained.warned if text != "rich is experimental/alpha"] == []
    assert trained.left_open == []


def test_the_same_seed_trains_the_same_policy_and_another_seed_another(trained, tmp_path):
    expected = arrays_of(load_policy(trained.folder / "policy.npz"))
    same = arrays_of(load_policy(train_tiny(tmp_path / "same").folder / "policy.npz"))
    other = arrays_of(load_policy(train_tiny(tmp_path / "other", seed=1).folder / "policy.npz"))
    assert all(np.array_equal(*pair) for pair in zip(same, expected, strict=True))
    assert not any(np.array_equal(*pair) for pair in zip(other[:3], expected[:3], strict=True))


def test_a_run_folder_that_exists_is_left_alone(tmp_path):
    (tmp_path / "keep").write_text("me")
    with pytest.raises(FileExistsError):
        train(Settings(**TINY, out=tmp_path))
    assert [file.name for file in tmp_path.iterdir()] == ["keep"]


@pytest.mark.parametrize("seed", [-1, VALIDATION_SEED, VALIDATION_SEED - 3, TEST_SEED])
def test_seeds_kept_for_evaluation_are_refused_before_anything_is_written(tmp_path, seed):
    with pytest.raises(ValueError, match=r"seed must be (below|a whole number of at least 0).*got"):
        train(Settings(**TINY, seed=seed, out=tmp_path / "run"))
    assert not (tmp_path / "run").exists()


HEADER = {"format": "impact_gym policy 1", "layers": 1, "provenance": {}}
FITTING = {"weight_0": np.zeros((2, 8), np.float32), "bias_0": np.zeros(2, np.float32), "log_std": np.zeros(2)}


class Bomb:
    """Unpickled, it makes a folder."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_reading_a_policy_runs_no_code(tmp_path):
    mark, path = tmp_path / "code ran", tmp_path / "policy.npz"
    good = {"header": np.array(json.dumps(HEADER)), **FITTING}
    np.savez(path, **good)
    assert load_policy(path).inputs == 8
    for name in good:
        np.savez(path, **{**good, name: np.array([Bomb(mark)], object)})
        with pytest.raises(ValueError, match="not a policy file"):
            load_policy(path)
    pickled = pickle.dumps(Bomb(mark))
    path.write_bytes(pickled)
    with pytest.raises(ValueError, match="not a policy file"):
        load_policy(path)
    assert not mark.exists()
    pickle.loads(pickled)
    assert mark.exists()


@pytest.mark.parametrize(("header", "arrays", "message"), [
    (HEADER, {}, "weight_0|log_std"),
    (HEADER | {"format": "impact_gym policy 9"}, FITTING, "policy 9.*policy 1"),
    (HEADER | {"layers": 2}, FITTING, "weight_1"),
    (HEADER | {"layers": 0}, FITTING, "weights"),
    (HEADER | {"layers": "many"}, FITTING, ""),
    ({}, FITTING, "format"),
    ([], FITTING, ""),
    (HEADER, FITTING | {"weight_0": np.zeros((3, 8), np.float32)}, "fit"),
    (HEADER, FITTING | {"weight_0": np.zeros(8, np.float32)}, "fit"),
    (HEADER, FITTING | {"log_std": np.zeros(3)}, "log_std"),
    (HEADER, FITTING | {"bias_0": np.array([0.0, np.nan], np.float32)}, "finite"),
    (HEADER, FITTING | {"bias_0": np.array(["a", "b"])}, ""),
    (HEADER, FITTING | {"weight_0": np.zeros((2, 8), complex)}, ""),
], ids=itertools.count())  # fmt: skip
def test_an_archive_that_is_no_policy_is_refused(tmp_path, header, arrays, message):
    np.savez(tmp_path / "policy.npz", header=np.array(json.dumps(header)), **arrays)
    with pytest.raises(ValueError, match=rf"policy\.npz is not a policy file, or is damaged: .*({message})"):
        load_policy(tmp_path / "policy.npz")


def test_files_of_other_kinds_are_refused(tmp_path):
    stream = io.BytesIO()
    np.save(stream, np.zeros(3))
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("header.npy", "not an array")
    kinds = [b"", b"PK", b"text", b"\x80\x04", stream.getvalue(), archive.getvalue(), bytes(range(256)) * 20]
    path = tmp_path / "policy.npz"
    for content in kinds:
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"policy\.npz is not a policy file, or is damaged"):
            load_policy(path)


def test_a_truncated_or_altered_file_is_refused_or_harmless(tmp_path):
    policy = made_up_policy()
    whole = policy.save(tmp_path / "whole.npz").read_bytes()
    path = tmp_path / "policy.npz"
    rng = np.random.default_rng(0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for length in [*rng.integers(0, len(whole), 60), len(whole) - 1]:
            path.write_bytes(whole[:length])
            with pytest.raises(ValueError, match="not a policy file, or is damaged"):
                load_policy(path)
        gc.collect()
    refused = 0
    for place in range(0, len(whole), 3):
        altered = bytearray(whole)
        altered[place] ^= int(rng.integers(1, 256))
        path.write_bytes(altered)
        try:
            found = load_policy(path)
        except ValueError:
            refused += 1
        else:
            assert all(np.array_equal(*pair) for pair in zip(arrays_of(found), arrays_of(policy), strict=True))
    assert refused > len(whole) / 6
    assert {str(warning.message) for warning in caught} == set()  # such as a file left open


def test_an_unknown_name_lists_what_is_shipped():
    with pytest.raises(FileNotFoundError, match=r"'linear-blnd'.*linear-blind"):
        load_policy("linear-blnd")


def test_the_result_for_a_scenario_depends_on_neither_count_nor_neighbours():
    """To the last bit for a rule; a network's arithmetic may round differently in a batch of another size."""
    for controller in (baselines.PaperTrapezoid(), made_up_policy()):
        exact = isinstance(controller, baselines.PaperTrapezoid)
        many, few = evaluate(controller, TEST_SEED, 60), evaluate(controller, TEST_SEED + 41, 7)
        assert all(np.array_equal(values[41:48], few.scenario[name]) for name, values in many.scenario.items())
        for name in ("object_velocity", "approach_time", "peak_force", "contact_count", "missed"):
            one, other = getattr(many, name)[41:48], getattr(few, name)
            assert np.array_equal(one, other) if exact else one == pytest.approx(other, rel=1e-4, abs=1e-6)
        env = gym.make("ImpactApproach-v0", scenario="test")
        for row in (0, 41, 59):
            observation, _ = env.reset(seed=TEST_SEED + row)
            ended = False
            while not ended:
                observation, _, ended, _, info = env.step(controller.predict(observation)[0])
            assert info["scenario"] == {name: values[row] for name, values in many.scenario.items()}
            for name in ("object_velocity", "approach_time", "peak_force"):
                rounding = {"rel": 0, "abs": 0} if exact else {"rel": 1e-4, "abs": 1e-6}
                assert info[name] == pytest.approx(getattr(many, name)[row], **rounding)


def test_every_controller_meets_the_same_scenarios_and_other_seeds_others():
    controllers = [baselines.PaperTrapezoid(), baselines.ConstantSpeed(1.5, 20.0), made_up_policy()]
    sets = [evaluate(controller, TEST_SEED, 50).scenario for controller in controllers]
    for scenario in sets[1:]:
        assert all(np.array_equal(scenario[name], sets[0][name]) for name in sets[0])
    validation = evaluate(controllers[0], VALIDATION_SEED, 50).scenario
    assert not np.isin(validation["distance"], sets[0]["distance"]).any()


def test_a_solver_that_fails_is_reported_with_the_seed_of_the_scenario():
    stiff = ig.SpringDamper(1e12, damping_ratio=1e6)
    with pytest.raises(RuntimeError, match=f"scenario seeded {TEST_SEED}: .*too stiff"):
        evaluate(baselines.PaperTrapezoid(), TEST_SEED, 1, coupling=stiff)


def test_the_cost_of_an_episode_is_minus_its_return():
    episodes = evaluate(baselines.PaperTrapezoid(), TEST_SEED, 20, time_weight=3.0)
    envs = gym.make_vec("ImpactApproach-v0", num_envs=20, scenario="test", time_weight=3.0)
    seen, _ = envs.reset(seed=TEST_SEED)
    total, open_rows = np.zeros(20), np.ones(20, bool)
    while open_rows.any():
        seen, rewards, terminated, _, _ = envs.step(baselines.PaperTrapezoid().predict(seen)[0])
        total += np.where(open_rows, rewards, 0.0)
        open_rows &= ~terminated
    assert episodes.cost(3.0) == pytest.approx(-total, rel=1e-12)


def test_the_shipped_policy_beats_the_papers_rule_on_both_objectives():
    """On scenarios that training never saw: at most half the object velocity, and no later."""
    policy, paper = load_policy("linear-blind"), baselines.PaperTrapezoid()
    learned, fixed = evaluate(policy, TEST_SEED, 300), evaluate(paper, TEST_SEED, 300)
    assert not learned.missed.any()
    assert learned.object_velocity.mean() <= 0.5 * fixed.object_velocity.mean()
    assert learned.approach_time.mean() <= fixed.approach_time.mean()
    assert policy.inputs == 8
    assert {"command", "settings", "versions"} <= set(policy.provenance)
    assert policy.provenance["settings"]["seed"] + policy.provenance["settings"]["envs"] < VALIDATION_SEED
