"""Training: what it leaves behind, and what is learned."""

import csv
import json
import math
import shlex
import warnings
from dataclasses import replace

import numpy as np
import pytest
from episodes import Always
from policies import observations
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training import OBJECTIVES, tiny

import agents.train.run
import impact_gym as ig
from agents import baselines, load_policy
from agents.evaluate import Validation
from agents.evaluate.stage import VALIDATION_SEED, evaluate
from agents.policies.networks import to_arrays
from agents.setups import load_setup, shipped
from agents.setups.evaluation import WEIGHTS
from agents.train import callback
from agents.train.ppo import ScaledRewards, make_environment
from agents.train.run import train
from agents.train.settings import SLOTS, Settings, command, default_settings, read_settings
from impact_gym.envs.task import coupling_from
from impact_gym.sb3 import ImpactVecEnv


class Run:
    """A training of some seconds, watched; what fails in it is for one test to say, not for all that need one."""

    def __init__(self, settings):
        self.settings = settings
        models, logs, original = [], [], agents.train.run.make_model

        def make_model(*arguments):
            models.append(original(*arguments))
            return models[-1]

        with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            patch.setattr(agents.train.run, "make_model", make_model)
            patch.setattr(agents.train.run, "outputs", lambda *args: logs.extend(original_outputs(*args)) or logs)
            original_outputs = agents.train.logs.outputs
            self.folder = train(settings)
        self.model = models[0]
        self.left_open = [output.file.name for output in logs if hasattr(output, "file") and not output.file.closed]
        self.warned = [str(warning.message) for warning in caught]

    def read(self, name):
        return json.loads((self.folder / name).read_text())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return Run(tiny(out=tmp_path_factory.mktemp("runs") / "run"))


def test_the_policy_is_the_model_it_came_from(run):
    policy = load_policy(run.folder / "final.npz")
    seen = observations(policy, 1500)
    hidden = np.zeros(
        (len(seen), run.model.observation_space.shape[0] - policy.inputs), np.float32
    )  # from the actor too
    expected, _ = run.model.predict(np.append(seen, hidden, axis=1), deterministic=True)
    actions, _ = policy.predict(seen)
    assert actions == pytest.approx(expected, rel=0, abs=2e-6)
    assert len(np.unique(actions)) > 1500
    log_std = np.broadcast_to(run.model.policy.log_std.detach().numpy(), (len(seen), 2))
    assert policy.network.log_std(policy.network.latent(seen)) == pytest.approx(log_std, rel=1e-4, abs=1e-5)


def test_a_run_folder_says_how_it_came_about_and_what_came_of_it(run):
    config, metrics = run.read("config.json"), run.read("metrics.json")
    assert "agents.train" in config["command"]
    assert config["settings"]["rollout"] == 16
    assert {"python", "numpy", "torch", "gymnasium", "stable-baselines3", "impact-gym"} <= set(config["versions"])
    assert config["versions"]["impact-gym"] == ig.__version__
    for name in ("best", "final"):
        policy = load_policy(run.folder / f"{name}.npz")
        assert config.items() <= policy.provenance.items()
        assert policy.provenance["validation"] == metrics["validation"][name]
    best, final = (metrics["validation"][name]["score"] for name in ("best", "final"))
    assert best == min(point["score"] for point in metrics["curve"])
    assert metrics["curve"][-1] == {"steps": run.settings.whole_steps, "score": final}
    kinds = {file.name.split(".")[0] for file in run.folder.iterdir()}
    assert kinds == {"config", "metrics", "progress", "events", "best", "final", "lock"}


def test_training_logs_the_objectives_by_name(run):
    """As text and for TensorBoard; an update before which no episode ended says nothing instead of nan."""
    with (run.folder / "progress.csv").open() as file:
        rows = list(csv.DictReader(file))
    events = EventAccumulator(str(run.folder))
    events.Reload()
    objectives = [f"objectives/{name}" for name in OBJECTIVES]
    for name in (*objectives, "validation/score", "validation/approach_time at weight 2"):
        written = [float(row[name]) for row in rows if row[name]]
        logged = [event.value for event in events.Scalars(name)]
        assert len(written) >= 2
        assert np.isfinite(written).all()
        assert logged == pytest.approx(written, rel=1e-5)
    assert float(rows[-1]["time/total_timesteps"]) == run.settings.whole_steps


def test_training_warns_of_nothing_and_closes_its_files(run):
    assert run.warned == []
    assert run.left_open == []


def test_the_same_seed_trains_the_same_policy_and_another_seed_another(tmp_path):
    first, same, other = (
        to_arrays(load_policy(train(tiny(steps=1024, seed=seed, out=tmp_path / name)) / "final.npz").network)
        for name, seed in (("first", 0), ("same", 0), ("other", 1))
    )
    assert all(np.array_equal(first[name], same[name]) for name in first)
    assert not any(np.array_equal(first[name], other[name]) for name in first if name != "log_std.weight")


def test_a_run_folder_that_exists_is_left_alone(tmp_path):
    (tmp_path / "keep").write_text("me")
    with pytest.raises(FileExistsError):
        train(tiny(out=tmp_path))
    assert [file.name for file in tmp_path.iterdir()] == ["keep"]


def test_the_best_policy_is_chosen_by_the_validation_set_alone(tmp_path, monkeypatch):
    """The scores are made up: what is kept is the policy of the lowest, whatever came later."""
    scores, kept = iter([0.9, 0.5, 0.7, 0.8, 0.6, 0.95]), []

    def play(self, controller):
        result = {"score": next(scores, 1.0), "time_weight": [1.0], "object_velocity": [0.0], "approach_time": [0.0]}
        result["missed"] = [0.0]
        kept.append((result["score"], controller))
        return result

    monkeypatch.setattr(callback.Validation, "score", play)
    folder = train(tiny(steps=2048, validate_every=512, out=tmp_path / "run"))
    best, final = load_policy(folder), load_policy(folder / "final.npz")
    expected = next(controller for score, controller in kept if score == 0.5)
    assert np.array_equal(best.network.mean.weight, expected.network.mean.weight)
    assert not np.array_equal(best.network.mean.weight, final.network.mean.weight)
    assert best.provenance["validation"]["score"] == 0.5


def test_validation_plays_what_evaluation_plays():
    """By another way: a frozen set in one batch without reset, and seeds in a vector environment of Gymnasium."""
    for environment in ({}, {"range_noise": 0.01}, {"coupling": {"type": "Bistable"}}):
        rule = baselines.ConstantSpeed(0.8, 12.0)
        result = Validation(environment, WEIGHTS, scenarios=40).score(rule)
        for place, weight in enumerate(WEIGHTS):
            episodes = evaluate(rule, VALIDATION_SEED, 40, scenario="train", time_weight=weight, **environment)
            assert result["cost"][place] == pytest.approx(episodes.cost(weight).mean(), rel=1e-12)
            for name in ("object_velocity", "approach_time", "missed"):
                assert result[name][place] == pytest.approx(getattr(episodes, name).mean(), rel=1e-12)
        assert result["score"] == pytest.approx(np.mean(result["cost"]), rel=1e-12)


def test_missing_the_object_costs_what_it_costs_in_the_environment():
    result = Validation({}, WEIGHTS, scenarios=5).score(Always(0.0, 10.5))
    assert result["missed"] == [1.0] * len(WEIGHTS)
    assert result["cost"] == pytest.approx([2.0 + 1.2 * weight for weight in WEIGHTS], rel=1e-12)


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0])
def test_rewards_are_divided_by_a_power_of_one_plus_the_weight_of_their_episode(power):
    plain, even = (
        ImpactVecEnv(16, time_weight=(0.5, 8.0)),
        ScaledRewards(ImpactVecEnv(16, time_weight=(0.5, 8.0)), power),
    )
    for envs in (plain, even):
        envs.seed(5)
        envs.reset()
    ended_once = 0
    for _ in range(120):
        weights = plain.envs.batch.episodes["drawn"]["time_weight"].copy()
        _, rewards, ended, infos = plain.step(np.full((16, 2), 0.4, np.float32))
        scaled = even.step(np.full((16, 2), 0.4, np.float32))[1]
        assert scaled == pytest.approx(rewards / (1.0 + weights) ** power, rel=1e-5)
        assert all(infos[row]["time_weight"] == weights[row] for row in np.flatnonzero(ended))
        ended_once += ended.sum()
    assert ended_once > 30


def test_the_set_up_decides_the_defaults():
    assert read_settings([]) == default_settings("linear-blind")
    ranged = read_settings(["linear-ranged", "--clip", "0.1"])
    assert ranged == replace(default_settings("linear-ranged"), clip=0.1)
    assert ranged.environment["range_noise"] == 0.01
    assert read_settings(["bistable-blind"]).environment["coupling"]["type"] == "Bistable"
    for setup in shipped():
        envs = make_environment(replace(default_settings(setup), envs=2))
        assert envs.observation_space == load_setup(setup).make(privileged=True).observation_space
        assert envs.observation_space.shape[0] >= (9 if "ranged" in setup else 8) + 5
    with pytest.raises(ValueError, match="give nothing else"):
        read_settings(["--resume", "there", "--steps", "5"])


def test_the_command_that_is_kept_asks_for_the_same_settings():
    for settings in (default_settings(), default_settings("bistable-blind"), tiny(seed=7)):
        changed = replace(settings, time_weight=(1.0, 2.0), informed_critic=False)
        for one in (settings, changed):
            assert read_settings(shlex.split(command(one))[3:]) == one
    assert command(default_settings("linear-ranged")) == "python -m agents.train linear-ranged"


@pytest.mark.parametrize(("arguments", "message"), [
    ({"steps": 0}, "steps.*at least 1"),
    ({"batch": 1}, "batch.*at least 2"),
    ({"seed": -1}, "seed.*at least 0"),
    ({"setup": "cubic"}, "no set-up 'cubic'.*linear-blind"),
    ({"time_weight": (2.0, 1.0)}, "time_weight.*inverted"),
    ({"weight_power": 2.0}, "weight_power.*at most 1"),
    ({"learning_rate": 0.0}, "learning_rate.*above 0"),
    ({"rtol": 0.5}, r"rtol.*at most 0\.01"),
    ({"envs": SLOTS + 1}, f"envs must be at most {SLOTS}"),  # or two trainings would share a scenario
    ({"gae_lambda": 1.5}, "gae_lambda.*at most 1"),
    ({"rollout": 1}, "rollout.*at least 2"),
    ({"clip": 0.0}, "clip.*above 0"),
    ({"log_std": 3.0}, "log_std.*at most 2"),
], ids=str)  # fmt: skip
def test_settings_that_make_no_sense_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Settings(**arguments)


def test_every_setting_has_a_sentence(capsys):
    with pytest.raises(SystemExit):
        read_settings(["--help"])
    said = capsys.readouterr().out
    assert all(name in said for name in ("--steps", "--resume", "--weight-power", "--gae-lambda", "--teacher"))


def test_the_mechanism_for_slow_touches_holds_more_behind_less_than_the_papers():
    papers, slow = ig.Bistable(), coupling_from(default_settings("bistable-blind").environment["coupling"])
    barriers = [one.energy(0.0) - one.energy(one.front_stop) for one in (papers, slow)]
    assert slow.force(slow.front_stop) > max(0.125 * 16.0, 1.9 * papers.force(papers.front_stop))  # N
    assert barriers[1] < barriers[0] / 12
    assert math.sqrt(2 * barriers[1] / 0.125) < 0.15  # m/s, at which a tool of 125 g gets over it
