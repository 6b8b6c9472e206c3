"""An operator in the loop: rules that hold for any action, the paper's brake, ends of episodes, recordings."""

import math

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import AWAY, GENTLE, OWN, TELEOP, final, played, scene, steered
from random_tasks import STEERED_DRAWN
from refusal import refused
from solver_scenes import log_uniform

import impact_gym as ig
from impact_gym.envs.batch import Batch
from impact_gym.physics.impact import GRAVITY
from impact_gym.task import Task

COUPLINGS = (ig.Rigid(), ig.SpringDamper(50.0), ig.Bistable())


@pytest.mark.parametrize("coupling", COUPLINGS, ids=lambda each: type(each).__name__)
def test_stop_sent_at_the_touch_is_the_papers_brake(coupling):
    random = np.random.default_rng(3)
    for _ in range(25):
        delay, friction = random.uniform([0.0, 0.1], [0.3, 0.5]).tolist()
        numbers = {"object_mass": log_uniform(random, 0.1, 2.5), "contact_stiffness": log_uniform(random, 1e3, 1e6),
                   "restitution": random.uniform(0.1, 1.0), "distance": random.uniform(0.2, 0.8)}  # fmt: skip
        task = {"coupling": coupling, "uplink": {"delay": delay}, "friction": friction, "scenario": numbers}
        info = final(steered(ig.operators.Trapezoid(0.5, 0.0), rtol=1e-10, **task), GENTLE)
        brake = ig.Brake(threshold=0.0, delay=delay, deceleration=20.0)
        struck = scene(numbers, coupling, friction=friction)
        outcome = ig.simulate(struck, ig.Trapezoid(0.5, 8.0, brake), duration=4.0, rtol=1e-10)
        assert info["object_velocity"][0] == pytest.approx(outcome.peak_object_velocity, abs=1e-9)
        assert info["touch_time"][0] == pytest.approx(delay + outcome.contacts[0].start, abs=1e-9)


def test_rules_of_authority_hold_for_any_action_and_channel():
    rng = np.random.default_rng(1)
    for options in STEERED_DRAWN.values():
        batch = Batch(256, Task(**options | {"robot": None, "acceleration_range": (1.0, 20.0)}), threads=1)
        batch.begin_seeded(7, {})
        still = np.zeros(256)
        for _ in range(180):
            begun = np.flatnonzero(batch.ended)
            if len(begun):
                batch.begin(begun, rng.random((len(begun), 11)))
                still[begun] = 0.0
            before, now = batch.links["expired"].copy(), batch.chains["time"].copy()
            batch.step(rng.uniform(-1.5, 1.5, (256, 3)), np.zeros(256, bool))
            sensors, links = batch.episodes["sensors"], batch.links
            command, executed = links["effective"], sensors["executed"]
            free = now - links["alarmed"] > 0.15 + 0.1
            assert (np.abs(executed[free]) <= np.abs(command[free])).all()
            assert (executed[free] * command[free] >= 0.0).all()
            assert (np.abs(executed - command) <= np.abs(command) + 0.3 + 1e-12).all()
            assert (executed[command == 0.0] == 0.0).all()
            columns = batch.link_columns()
            assert (columns["is_intervention"] == (np.abs(executed - command) > 1e-3)).all()
            assert (columns["teleop_action"][:, 0] == command).all()
            assert (columns["intervene_action"][:, 0] == executed).all()
            silent = (links["expired"] == 1) & (before == 1)  # during the whole step
            assert (executed[silent] == 0.0).all()
            still = np.where(silent | (command == 0.0), still + 0.016, 0.0)
            assert (sensors["velocity"][still > 0.032 + 0.5 / 20.0] == 0.0).all()


@pytest.mark.parametrize("alarm", ["force", "reading"])
def test_withdrawal_is_constant_and_then_ends_linearly(alarm):
    task = {"alarm": alarm, "scenario": {"distance": 0.1}, "coupling": ig.Rigid()}
    batch, back = steered(ig.operators.Trapezoid(0.5, reaction=1.0), **task), []
    for _ in played(batch, OWN):
        if batch.episodes["sensors"]["alarm"][0]:
            break
    while len(back) < 18:
        batch.step(np.array([[-1.0, 1.0, 1.0]]), batch.ended)
        since = batch.chains["time"][0] - 0.016 - batch.links["alarmed"][0]
        back.append((since, -batch.episodes["sensors"]["executed"][0]))
    since, speed = np.array(back).T
    expected = 0.3 * np.clip(1.0 - (since - 0.15) / 0.1, 0.0, 1.0)
    assert np.abs(speed - expected).max() < 1e-9
    assert expected[-1] == 0.0 < expected.max()


@pytest.mark.parametrize("coupling", COUPLINGS, ids=lambda each: type(each).__name__)
def test_tool_pushes_an_object_with_the_force_of_friction(coupling):
    dull = {"object_mass": (0.3, 1.0), "restitution": (0.1, 0.4), "distance": 0.2}
    operator = {"type": "Trapezoid", "speed": (0.1, 0.4), "reaction": 9.0}
    batch = steered(operator, 50, coupling=coupling, horizon=7.0, scenario=dull)
    *_, _ = played(batch, OWN, steps=400)
    chains, drawn = batch.chains, batch.episodes["drawn"]
    assert (batch.episodes["status"] == 0).all()
    pressed = (chains["penetration"] > 0.0) & (chains["time"] > 6.0)
    assert pressed.sum() > 40
    depth = (0.3 * drawn["object_mass"] * GRAVITY / drawn["contact_stiffness"]) ** (2.0 / 3.0)
    assert chains["penetration"][pressed] == pytest.approx(depth[pressed], rel=1e-3)  # it still oscillates a little
    speed = chains["flange_velocity"] + chains["deflection_rate"] - chains["penetration_rate"]  # of the object
    assert speed[pressed] == pytest.approx(drawn["operator"]["speed"][pressed], rel=1e-3)


def test_replay_that_touches_nothing_ends_after_the_recording():
    operator = ig.operators.Replay((0.0, 0.5, 1.0, 1.1), (0.0, -0.2, 0.3, 0.0))
    info = final(steered(operator, scenario=AWAY), [0.0, *OWN[1:]])  # half of each command
    assert info["missed"][0]
    assert info["done_time"][0] == pytest.approx(1.104 + 0.3, abs=0.017)
    assert info["reward_terms"]["time"][0] == pytest.approx(-2.0 * info["done_time"][0], rel=1e-12)
    assert info["taken"][0] == pytest.approx(0.5, rel=1e-12)  # of the ways in both directions


def test_replay_of_a_persons_commands_repeats_their_episode():
    def assist(batch):
        command, alarm = (batch.episodes["sensors"][name] for name in ("command", "alarm"))
        batch.step(np.stack([np.cos(4.0 * command), np.full(batch.size, 0.3), alarm - 0.5], axis=1), batch.ended)

    task = {"uplink": {"delay": 0.05, "jitter": 0.01}, "scenario": {"distance": (0.1, 0.6)}}
    batch, rng = steered(ig.operators.Person(), 20, **task), np.random.default_rng(3)
    commands = [[0.0] for _ in range(20)]
    batch.begin_seeded(3, {})
    while not batch.ended.all():
        if rng.random() < 0.25:  # persons move and release their sticks at random
            batch.set_operator_velocity(rng.uniform(-0.1, 0.4, 20) * (rng.random(20) < 0.95))
        assist(batch)
        for row in np.flatnonzero(batch.links["packets"] > list(map(len, commands))):  # a step to an alarm sends none
            commands[row].append(float(batch.links["person_command"][row]))
    times, length = [0.016 * np.arange(len(each)) for each in commands], 0.016 * 600
    several = {
        "type": "Replay", "time": [time for k, each in enumerate(times) for time in k * length + each],
        "velocity": [velocity for each in commands for velocity in each], "length": length, "recording": (0, 20),
    }  # fmt: skip
    again = steered(several, 20, **task)
    again.begin_seeded(3, {"operator.recording": np.arange(20) + 0.5})
    while not again.ended.all():
        assist(again)
    for name in ("object_velocity", "slide", "done_time", "peak_force", "taken", "rest_time"):
        assert np.array_equal(again.info()[name], batch.info()[name]), name
    assert len({*batch.info()["peak_force"]}) > 10


def test_command_of_a_person_is_checked_and_sent_at_a_tick():
    for link, arrives in ((None, [0.1, 0.2]), ({"delay": 0.1}, [0.0, 0.0])):  # sent at the end of the step
        envs = gym.make_vec(TELEOP, 2, operator={"type": "Person"}, uplink=link)
        envs.reset(seed=1)
        for wrong in (math.nan, 0.51, -0.31):
            refused(lambda wrong=wrong, envs=envs: envs.unwrapped.command([0.0, wrong]), "command", str(wrong))
        envs.unwrapped.command([0.1, 0.2])
        assert envs.step(np.array([OWN, OWN], np.float32))[-1]["command"].tolist() == arrives


def test_observations_show_the_object_only_by_the_belief():
    batch = steered({"type": "Reach", "place_error": (-0.05, 0.05), "creep": 0.1}, 2, scenario=AWAY)
    batch.begin_seeded(0, {"operator.place_error": [-0.3, -0.3], "distance": [0.6, 0.7], "noise_seed": [1.0, 1.0]})
    assert np.ptp(batch.links["believed"]) == pytest.approx(0.1)
    batch.begin_seeded(0, {"operator.place_error": [-0.3, -0.4], "distance": [0.6, 0.7], "noise_seed": [1.0, 1.0]})
    for _ in range(60):
        batch.step(np.array([OWN, OWN]), batch.ended)
        assert batch.observations[0].tolist() == pytest.approx(batch.observations[1].tolist(), abs=1e-6)
