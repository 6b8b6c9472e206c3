"""A pupil does as its teacher would, from what it can see itself; then it learns by itself."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3.common.logger import Logger
from training import TINY, assert_same, interrupted

from agents.baselines.rule import ALARM, SINCE_ALARM
from agents.baselines.tuned import load_baseline
from agents.evaluate.stage import Stage
from agents.setups import load_setup
from agents.train.imitation import Teacher, time_weights
from agents.train.ppo import make_environment, make_model, policy_from
from agents.train.run import resume, train

pytestmark = pytest.mark.usefixtures("one_thread")
TAUGHT = replace(TINY, teacher="blind-profile", taught=2048)


def observations_at(weights, steps=40, **options):
    """Observations (steps, rows, n_obs) of random actions, and where episodes begin."""
    rows = len(weights)
    envs = gym.make_vec("ImpactApproach-v0", num_envs=rows, autoreset_mode="SameStep", **options)
    rng = np.random.default_rng(1)
    seen, starts = [envs.reset(seed=0, options={"record": {"time_weight": weights}})[0]], [np.ones(rows)]
    for _ in range(steps - 1):
        observation, _, ended, _, _ = envs.step(rng.uniform([-0.5, -1], [1, 1], (rows, 2)))
        seen.append(observation)
        starts.append(ended.astype(float))
    return np.array(seen), np.array(starts)


def test_a_teacher_does_as_it_was_tuned_for_the_weight_in_each_episode():
    weights = [0.7, 1.0, 2.0, 4.0]
    seen, starts = observations_at(weights, steps=15, time_weight=(0.3, 8.0))
    assert time_weights(seen[0]) == pytest.approx(weights, rel=1e-5)
    teacher = Teacher("linear-blind", "blind-profile")
    told = teacher.actions(seen, starts)
    for row, weight in enumerate(weights):
        assert starts[1:, row].sum() == 0
        expected, _ = load_baseline("blind-profile", weight).predict(seen[:, row])
        assert np.array_equal(told[:, row], expected)


def test_a_teacher_takes_what_does_best_at_the_weight_whatever_that_was_tuned_for():
    teacher = Teacher("linear-blind", "blind-profile")
    velocity, time = teacher.means.T
    for weight in (0.3, 0.8, 1.5, 3.0, 8.0):
        seen, starts = observations_at([weight], steps=1, time_weight=(0.3, 8.0))
        best = teacher.rules[int(np.argmin(velocity + weight * time))]
        assert np.array_equal(teacher.actions(seen, starts)[0], best.predict(seen[0])[0])


def test_where_readings_raise_the_alarm_a_teacher_is_told_of_the_touch_and_of_no_false_alarm():
    options = {**load_setup("linear-robust").environment, "privileged": True, "time_weight": (0.3, 8.0)}
    seen, starts = observations_at([2.0] * 50, steps=70, **options)
    teacher = Teacher("linear-robust", "blind-profile")
    place = teacher.told.index("time_since_touch")
    touched = seen[..., place].copy()
    assert (seen[..., ALARM][touched == 0.0] > 0.5).mean() > 0.3  # false alarms
    told = teacher.actions(seen, starts)
    for alarm in (0.0, 1.0):  # the pupil's own makes no difference
        other = seen.copy()
        other[..., ALARM], other[..., SINCE_ALARM] = alarm, 0.3 * alarm
        assert np.array_equal(teacher.actions(other, starts), told)
    assert (touched > 0.0).any()
    seen[..., place] = 0.0
    assert not np.array_equal(teacher.actions(seen, starts)[touched > 0.0], told[touched > 0.0])
    assert np.array_equal(teacher.actions(seen, starts)[touched == 0.0], told[touched == 0.0])


def test_a_pupil_follows_the_gradient_of_its_squared_error():
    settings = replace(TAUGHT, batch=256, epochs=1)
    environment = make_environment(settings)
    environment.seed(3)
    model = make_model(settings, environment)
    model.set_logger(Logger(None, []))
    model.max_grad_norm = np.inf
    model.policy.optimizer = torch.optim.SGD(model.policy.parameters(), 0.0)  # what is compared stays where it is
    model._update_learning_rate = lambda _: None
    model.learn(settings.round, log_interval=None)
    buffer = model.rollout_buffer
    told = torch.as_tensor(model._teacher.actions(buffer.observations, buffer.episode_starts)).reshape(-1, 2)
    features = model.policy.features_extractor(torch.as_tensor(buffer.observations).flatten(0, 1))
    actor, critic = model.policy.mlp_extractor(features)
    error = (model.policy.action_net(actor) - told).square().mean()
    value_error = (model.policy.value_net(critic)[:, 0] - torch.as_tensor(buffer.returns).flatten()).square().mean()
    ours = {name: value.grad.clone() for name, value in model.policy.named_parameters()}
    model.policy.zero_grad()
    (error + model.vf_coef * value_error).backward()
    assert model.logger.name_to_value["train/imitation_loss"] == pytest.approx(error.item(), rel=1e-5)
    for name, value in model.policy.named_parameters():
        theirs = torch.zeros_like(value) if value.grad is None else value.grad
        assert torch.dist(ours[name], theirs) <= 1e-5 * theirs.norm(), name


def test_a_pupil_soon_does_nearly_as_well_as_its_teacher():
    settings = replace(TAUGHT, steps=150_000, envs=128, batch=512, learning_rate=3e-3, width=32)
    settings = replace(settings, rollout=32, taught=150_000)
    environment = make_environment(settings)
    environment.seed(3)
    model = make_model(settings, environment)
    model.set_logger(Logger(None, []))
    before = policy_from(model, settings, {})
    model.learn(settings.steps, log_interval=None)
    stage = Stage.of("validation", 200, time_weight=[2.0], threads=1, **load_setup("linear-blind").environment)
    after, teacher, paper = (
        policy_from(model, settings, {}),
        load_baseline("blind-profile", 2.0),
        load_baseline("paper-trapezoid"),
    )
    losses = [stage.play(one).loss(2.0).mean() for one in (before, after, teacher, paper)]
    assert losses[2] < 0.8 * losses[3]  # there is something to learn
    assert losses[1] < 1.05 * losses[2]
    assert losses[0] > 1.3 * losses[2]


@pytest.mark.storm
@pytest.mark.parametrize("taught", [1024, 4096])
def test_an_interrupted_pupil_ends_as_one_that_is_not(tmp_path, taught):
    settings = replace(TAUGHT, taught=taught)
    whole = train(replace(settings, out=tmp_path / "whole"))
    interrupted(settings, tmp_path / "part", checkpoints=2)
    np.random.seed(7)  # noqa: NPY002 - stable-baselines3 draws from it
    assert_same(whole, resume(tmp_path / "part"))


@pytest.mark.parametrize(("setup", "teacher", "words"), [
    ("linear-blind", "nobody", "nobody"),
    ("linear-blind", "ranged", "Ranged needs an estimate of the distance"),
])  # fmt: skip
def test_who_cannot_teach_is_named_before_anything_is_trained(tmp_path, setup, teacher, words):
    settings = replace(TAUGHT, setup=setup, out=tmp_path / "run")
    with pytest.raises(ValueError, match=words):
        train(replace(settings, teacher=teacher))
    assert not (tmp_path / "run" / "checkpoint.npz").exists()
