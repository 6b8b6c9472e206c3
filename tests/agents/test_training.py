"""Parts of a training: options, environments, networks, and the imitation of a teacher."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
import torch
from made_up_policies import observations
from stable_baselines3.common.logger import Logger
from tiny_training import ALL_PARTS, tiny

from agents import load_setup
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.setups import shipped
from agents.setups.tuned import load_baseline, read_tuned
from agents.train.__main__ import TrainOptions, read_options
from agents.train.imitation import Teacher
from agents.train.networks import FastTanh
from agents.train.ppo import Run, ScaledRewards, make_environments, make_model, policy_from
from impact_gym.sb3 import ImpactVecEnv


def model_of(run):
    torch.set_num_threads(run.training.threads)
    environments = make_environments(run)
    environments.seed(3)
    model = make_model(run, environments)
    model.set_logger(Logger(None, []))
    return model, environments


@pytest.mark.parametrize("name", shipped())
def test_options_come_from_the_set_up_and_a_runs_command(name):
    setup = load_setup(name)
    assert read_options([name]) == TrainOptions(name, setup.training)
    run = Run(setup, replace(tiny().training, time_weight=(1.0, 2.0), informed_critic=False), seed=7)
    options = read_options(shlex.split(run.command)[2:])
    assert Run(load_setup(options.setup), options.training, options.seed) == run
    assert Run(setup, setup.training).command == f"impact-gym train {name}"


def test_record_of_a_run_has_all_that_determines_its_result(tmp_path):
    """Here what its other settings do not show: values in the set-up's file, and the content of the teacher's file."""
    path, made, more = tmp_path / "parts.toml", [], "[training]\nmixed = [{ share = 0.25, force_noise = 1.0 }]\n"
    texts = [ALL_PARTS, ALL_PARTS.replace("0.125", "0.13"), ALL_PARTS.replace("[0.1,", "[0.11,"), ALL_PARTS + more,
             ALL_PARTS + more.replace("1.0", "2.0"), ALL_PARTS + "[evaluation]\nweights = [2.0]\n"]  # fmt: skip
    for text in texts:
        path.write_text(text)
        made.append(tiny(path, nominal=0.5, teacher="blind-profile").made_for())
    assert len({json.dumps(each) for each in made}) == len(texts)
    assert made[0]["teacher"] == read_tuned("blind-profile")["sha256"]


def test_rewards_are_scaled_by_the_weight_of_the_episode():
    plain, inner = (ImpactVecEnv(16, time_weight=(0.5, 8.0)) for _ in range(2))
    scaled, power, episodes = ScaledRewards(inner, 0.7), 0.7, 0
    for envs in (scaled, plain):
        envs.seed(5)
        seen = envs.reset()
    for _ in range(60):
        weights = plain.observation_spec.decode(seen, "time_weight")
        actions = np.full((16, 2), 0.4, np.float32)
        seen, rewards, ended, _ = plain.step(actions)
        assert scaled.step(actions)[1] == pytest.approx(rewards / (1.0 + weights) ** power, rel=1e-5)
        episodes += ended.sum()
    assert episodes > 16


def test_share_of_the_environments_is_nominal():
    run = tiny("linear-robust", nominal=0.25)
    environments = make_environments(run)
    environments.seed(3)
    spec, seen = environments.venv.observation_spec, environments.reset()
    truths = {"tool_mass": 0.125, "coupling.stiffness": 50.0, "coupling.damping_ratio": 1.0, "reaction_delay": 0.016}
    truths |= {"alarm_threshold": 1.0, "force_noise": spec.scale("force_noise").low}  # 0 lies below its scale
    truths |= {name: spec.scale(name).high for name in ("robot.mass", "robot.stiffness", "robot.damping")}  # rigid
    assert truths.keys() == {*run.task.drawn, "reaction_delay"}
    for name, truth in truths.items():
        assert spec.decode(seen, name)[12:] == pytest.approx(truth, rel=1e-5)
    assert len({*spec.decode(seen, "tool_mass")[:12]}) == 12
    tasks = environments.get_attr("batch", [0])[0].tasks
    assert {each.rtol for each in tasks} == {run.training.rtol} != {run.task.rtol}


RECORDED = """extends = "teleop-spring"
[environment]
uplink = { trace = "delays.csv" }
[training]
mixed = [
  { share = 0.25, operator = { type = "Trapezoid", speed = [0.1, 0.4], reaction = 8.0 } },
  { share = 0.5, operator = { type = "Replay", time = [0.0, 1.0], velocity = [0.0, 0.3] }, uplink = { delay = 0.2 } },
]
"""


def test_environments_mix_operators_that_the_critic_sees(tmp_path):
    """A file of delays lies beside the set-up's file, and the policy keeps the delays."""
    (tmp_path / "mixed.toml").write_text(RECORDED)
    (tmp_path / "delays.csv").write_text("time,delay\n0,0.05\n1,0.15\n")
    run = tiny(tmp_path / "mixed.toml", rollout=8)
    assert run.task.arguments()["uplink"] == {"trace": [[0.0, 0.05], [1.0, 0.15]]}
    model, environments = model_of(run)
    tasks = environments.get_attr("batch", [0])[0].tasks
    assert [type(task.operator).__name__ for task in tasks] == ["Reach"] * 4 + ["Trapezoid"] * 4 + ["Replay"] * 8
    assert [task.uplink.delay for task in tasks] == [0.0] * 8 + [0.2] * 8
    seen, spec = environments.reset(), environments.venv.observation_spec
    assert np.ptp(spec.decode(seen, "operator.speed")[4:8]) > 0.01
    assert np.ptp(spec.decode(seen, "operator.place_error")[:4]) > 0.01
    model.learn(run.training.round, log_interval=None)
    assert policy_from(model, run, {}).predict(seen[:, spec.actor])[0].shape == (16, 3)


def test_fast_tanh_equals_torchs_and_has_its_gradient():
    values = torch.cat((torch.linspace(-12.0, 12.0, 4001), torch.tensor([-1e4, -0.0, 0.0, 1e4])))
    assert FastTanh()(values).numpy() == pytest.approx(torch.tanh(values).numpy(), rel=0, abs=3e-7)
    assert torch.autograd.gradcheck(FastTanh(), torch.linspace(-2.0, 2.0, 9, dtype=torch.float64, requires_grad=True))


@pytest.fixture(scope="module")
def learned():
    run = tiny("linear-ranged")
    model, _ = model_of(run)
    model.learn(run.training.round, log_interval=None)
    return run, model


def test_critic_uses_more_than_the_actor_and_the_controller(learned):
    _, model = learned
    spec = model.env.venv.observation_spec
    seen = torch.as_tensor(model.env.reset())
    other = seen.clone()
    other[:, spec.actor.stop :] += 0.3
    means = [model.policy.get_distribution(rows).distribution.mean for rows in (seen, other)]
    assert torch.equal(*means)
    assert (model.policy.predict_values(seen) != model.policy.predict_values(other)).all()
    assert torch.equal(model.policy(seen)[1], model.policy.predict_values(seen))
    plain = make_environments(tiny("linear-ranged", informed_critic=False))
    assert plain.venv.observation_spec.ids == spec.ids[spec.actor]


def test_policy_from_equals_the_models_actor(learned):
    run, model = learned
    policy = policy_from(model, run, {})
    seen = observations(policy, 1500)
    hidden = np.zeros((1500, model.observation_space.shape[0] - policy.inputs), np.float32)
    expected, _ = model.predict(np.append(seen, hidden, axis=1), deterministic=True)
    assert policy.predict(seen)[0] == pytest.approx(expected, rel=0, abs=2e-6)
    log_std = np.broadcast_to(model.policy.log_std.detach().numpy(), (1500, 2))
    assert policy.network.read(policy.network.log_std, seen) == pytest.approx(log_std, rel=1e-6)


def test_teacher_uses_the_best_parameters_at_each_weight():
    weights = [0.3, 0.7, 1.0, 2.0, 4.0, 8.0]  # the teacher is tuned for all but the first and the last
    teacher = Teacher(load_setup("linear-blind"), "blind-profile")
    spec, seen = teacher.spec, observations(teacher, 15 * 6).reshape(15, 6, -1)
    seen[..., spec.index("time_weight")] = spec.encode("time_weight", weights)
    actions = teacher.actions(seen, np.zeros((15, 6)))
    velocity, time = teacher.means.T
    of_weights = [float(weight) for weight in read_tuned("blind-profile")["weights"]]
    for row, weight in enumerate(weights):
        tuned = of_weights[int(np.argmin(velocity + weight * time))]
        assert tuned == weight or weight in (0.3, 8.0)
        expected, _ = load_baseline("blind-profile", tuned).predict(seen[:, row, spec.actor])
        assert np.array_equal(actions[:, row], expected)


def test_teacher_reacts_to_a_touch_and_to_no_false_alarm():
    teacher, starts = Teacher(load_setup("linear-robust"), "blind-profile"), np.zeros((60, 24))
    seen = observations(teacher, 60 * 24).reshape(60, 24, -1)
    alarm, since, place = map(teacher.spec.index, ("alarm", "time_since_alarm", "time_since_touch"))
    seen[::2, :, place] = 0.0  # no touch
    actions, other, blind = teacher.actions(seen, starts), seen.copy(), seen.copy()
    other[..., alarm], other[..., since] = 1.0 - other[..., alarm], 0.3  # the alarm that the policy observes
    assert np.array_equal(teacher.actions(other, starts), actions)
    blind[..., place] = 0.0
    differs = (teacher.actions(blind, starts) != actions).any(axis=-1)
    assert differs[1::2].any()
    assert not differs[::2].any()


def test_every_setting_of_the_updates_reaches_the_model():
    model, _ = model_of(tiny(gae_lambda=0.9, entropy=0.01, clip=0.3, epochs=5, learning_rate=1e-3, final_rate=0.2))
    assert (model.gae_lambda, model.ent_coef, model.n_epochs, model.clip_range(1.0)) == (0.9, 0.01, 5, 0.3)
    assert (model.n_steps, model.batch_size, model.gamma) == (16, 64, 1.0)
    assert [model.lr_schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([1e-3, 0.6e-3, 0.2e-3])


def test_imitation_nearly_reaches_its_teacher():
    run = tiny(teacher="blind-profile", envs=128, rollout=32, batch=512, learning_rate=5e-3, width=32,
               steps=50_000, imitation_steps=50_000)  # fmt: skip
    model, _ = model_of(run)
    before = policy_from(model, run, {})
    model.learn(run.training.steps, log_interval=None)
    batch = ScenarioBatch.of("validation", 100, run.setup.task, time_weight=[2.0], threads=1)
    players = before, policy_from(model, run, {}), load_baseline("blind-profile", 2.0)
    start, end, teacher = (batch.play(controller).loss(2.0).mean() for controller in players)
    assert end < 1.05 * teacher
    assert start > 1.3 * teacher
