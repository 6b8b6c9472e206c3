"""An operator in the loop: rules that hold for any action, the paper's brake, ends of episodes, recordings."""

from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import AWAY, GENTLE, OWN, TELEOP, by_path, played, steered
from random_tasks import STEERED_DRAWN
from refusal import refused
from solver_scenes import COUPLINGS, scene

import impact_gym as ig
from impact_gym.envs.batch import Batch
from impact_gym.physics.impact import GRAVITY
from impact_gym.task import Task


@pytest.mark.parametrize("coupling", COUPLINGS.values(), ids=COUPLINGS)
def test_stop_sent_at_the_touch_is_the_papers_brake(coupling):
    task = {"uplink": {"delay": (0.0, 0.3)}, "friction": (0.1, 0.5), "scenario": {"distance": (0.2, 0.8)}}
    *_, batch = played(steered(ig.operators.Trapezoid(0.5, 0.0), 25, coupling=coupling, rtol=1e-10, **task), GENTLE)
    info = batch.info()
    delay, friction = info["record"]["uplink.delay"], info["record"]["friction"]
    varied = by_path(info["scenario"]) | {"object.friction": friction, "motion.brake.delay": delay}
    motion = ig.Trapezoid(0.5, 8.0, ig.Brake(threshold=0.0, deceleration=20.0))
    outcomes = ig.sweep(scene(coupling=coupling, friction=0.1), motion, varied, duration=4.0, rtol=1e-10)
    assert info["object_velocity"] == pytest.approx(outcomes.peak_object_velocity, abs=1e-9)
    assert info["touch_time"] == pytest.approx(delay + outcomes.first_contact, abs=1e-9)


def test_rules_of_authority_hold_for_any_action_and_channel():
    rng, faded = np.random.default_rng(1), 0
    for alarm, options in product(("force", "reading"), STEERED_DRAWN.values()):
        batch = Batch(256, Task(**options | {"robot": None, "acceleration_range": (1.0, 20.0), "alarm": alarm}))
        batch.begin_seeded(7, {})
        still = np.zeros(256)
        for _ in range(180):
            begun = np.flatnonzero(batch.ended)
            if len(begun):
                batch.begin(begun, rng.random((len(begun), 11)))
                still[begun] = 0.0
            sensors, links, actions = batch.episodes["sensors"], batch.links, rng.uniform(-1.5, 1.5, (256, 3))
            now, speed, before = sensors["time"].copy(), sensors["velocity"].copy(), links.copy()
            batch.step(actions, np.zeros(256, bool))
            command, executed, columns = links["effective"], sensors["executed"], batch.step_columns()
            gain, share, withdrawal = 0.5 + 0.5 * np.clip(actions, -1.0, 1.0).T
            fading = 0.3 * np.clip(1.0 - (now - links["alarmed"] - 0.15) / 0.1, 0.0, 1.0)
            expected = np.clip(gain * command - withdrawal * fading, -0.3, 0.5)
            assert np.abs(executed - np.where(command == 0.0, 0.0, expected)).max() < 1e-12
            faded += np.sum((fading > 0.0) & (fading < 0.3) & (command != 0.0))
            assert (columns["is_intervention"] == (np.abs(executed - command) > 1e-3)).all()
            assert (columns["teleop_action"][:, 0] == command).all()
            assert (columns["intervene_action"][:, 0] == executed).all()
            most = np.where(command == 0.0, 20.0, 1.0 + 19.0 * share) * (sensors["time"] - now)
            reached = speed + np.clip(executed - speed, -most, most)
            same = (command == before["effective"]) & (links["sent"] == before["sent"])  # during the whole step
            assert (np.abs(sensors["velocity"] - reached)[same] < 1e-7).all()  # accelerations are rounded
            silent = (links["expired"] == 1) & (before["expired"] == 1)
            assert (executed[silent] == 0.0).all()
            still = np.where(silent | (command == 0.0), still + 0.016, 0.0)
            assert (sensors["velocity"][still > 0.032 + 0.5 / 20.0] == 0.0).all()
    assert faded > 1000


@pytest.mark.parametrize("coupling", COUPLINGS.values(), ids=COUPLINGS)
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
    *_, batch = played(steered(operator, scenario=AWAY), [0.0, *OWN[1:]])  # half of each command
    info = batch.info()
    assert info["missed"][0]
    assert info["done_time"][0] == pytest.approx(1.104 + 0.3, abs=0.017)
    assert info["withheld_share"][0] == pytest.approx(0.5, rel=1e-12)  # of the ways in both directions


def test_command_of_a_person_is_checked_and_sent_at_a_tick():
    for link, arrives in ((None, [0.1, 0.2]), ({"delay": 0.1}, [0.0, 0.0])):  # sent at the end of the step
        envs = gym.make_vec(TELEOP, 2, operator={"type": "Person"}, uplink=link)
        envs.reset(seed=1)
        for wrong in (np.nan, 0.51, -0.31):
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
