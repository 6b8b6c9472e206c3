"""What is recorded of an operator's commands is what was executed."""

import math

import gymnasium as gym
import numpy as np
import pytest
from episodes import scene
from steered import AWAY, ID, OWN, played, steered

import impact_gym as ig

LOSSY = {"delay": 0.05, "loss": 0.4, "burst": 10.0}


@pytest.mark.parametrize("uplink", [*({"delay": delay} for delay in (0.0, 0.016, 0.05, 0.096, 0.1)), LOSSY], ids=str)
def test_operator_alone_is_never_corrected(uplink):
    """Not even where a command comes just as a step ends, or the newest is too old and the arm stops by itself."""
    batch = steered({"type": "Reach", "place_error": (-0.05, 0.05), "creep": 0.1}, 20, uplink=uplink, scenario=AWAY)
    stopped = 0
    for each in played(batch, OWN):
        columns = each.link_columns()
        assert not columns["is_intervention"].any()
        assert (columns["teleop_action"] == columns["intervene_action"]).all()
        stopped += each.links["expired"].sum()
    assert (stopped > 100) == ("loss" in uplink)


@pytest.mark.parametrize("delay", [0.0, 0.016, 0.05, 0.096, 0.1])
def test_flange_follows_from_what_is_recorded(delay):
    """Until the touch a step begins with the newest command, takes in what comes on the way, and ends with the pair."""
    rng, env = np.random.default_rng(2), gym.make(ID, uplink={"delay": delay}).unwrapped
    for seed in range(5):
        env.reset(seed=seed)
        velocity, ended = 0.0, False
        while not ended and env.episode_info()["contact_count"] == 0:
            begun, command = env.sensors()["time"], env.sensors()["command"]
            action = np.array([*rng.uniform(-1.0, 1.0, 2), 1.0], np.float32)  # before an alarm it cannot withdraw
            *_, ended, _, info = env.step(action)
            gain, gently = 0.5 * (float(action[0]) + 1.0), round(1.0 + 9.5 * (float(action[1]) + 1.0), 6)
            now, u, v = env.sensors()["time"], info["teleop_action"].item(), info["intervene_action"].item()
            arrives = math.floor((now - delay - 1e-9) / 0.016) * 0.016 + delay
            bends = [begun, arrives if arrives > begun + 1e-9 else now, now]
            for k, (of, target) in enumerate(((command, gain * command), (u, v))):
                most = (gently if of else 20.0) * (bends[k + 1] - bends[k])
                velocity += min(max(target - velocity, -most), most)
            assert velocity == pytest.approx(env.sensors()["velocity"], abs=1e-9)
            assert v == pytest.approx(gain * u, abs=1e-12)
            assert info["is_intervention"] == (abs(v - u) > 1e-3)
            assert info["command"] == env.sensors()["command"]


def test_simulate_follows_what_was_executed():
    """The flange that follows the recorded velocities, as a motion of `simulate`, does to the object what it did."""
    rng = np.random.default_rng(5)
    for seed in range(10):
        env = gym.make(ID, record_trace=True, rtol=1e-10).unwrapped
        env.reset(seed=seed)
        ended = False
        while not ended:
            *_, ended, _, info = env.step(rng.uniform(-0.2, 1.0, 3).astype(np.float32))
        trace, record = env.trace(), info["record"]
        kept = np.flatnonzero(np.diff(trace.time, append=np.inf) > 1e-12)  # of equal times the last
        times, velocities = trace.time[kept], trace.command_velocity[kept]
        bends = np.flatnonzero(np.abs(np.diff(np.diff(velocities) / np.diff(times))) > 1e-6) + 1
        corners = [0, *bends, len(times) - 1]
        motion = ig.Motion(times[corners], velocities[corners])
        struck = scene(record, ig.SpringDamper(50.0), friction=record["friction"])
        outcome = ig.simulate(struck, motion, duration=float(times[-1]), rtol=1e-10)
        assert outcome.peak_object_velocity == pytest.approx(info["object_velocity"], abs=2e-6)
