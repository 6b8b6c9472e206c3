"""Operators and channels: what is commanded, when it arrives, what the operator sees, what is recorded."""

import math
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import AWAY, OWN, STOP, TELEOP, Given, played, scene, sent, steered, steps
from scipy.signal import lsim

import impact_gym as ig
from impact_gym.teleop.channels import FIFTH_GENERATION


def delays_of(channel, rows=128):
    """Delays of packets over an uplink, (rows, n); that of a lost packet is infinite."""
    task = {"uplink": channel, "horizon": 9.0, "scenario": AWAY, "control_period": 0.01}
    packets = sent(steered(ig.operators.Trapezoid(0.3), rows, **task), STOP, steps=300)
    return packets["arrives"] - packets["sent"]


@pytest.mark.parametrize(("name", "spread"), [("5g-100ms", 0.034), ("5g-299ms", 0.090), ("5g-500ms", 0.095)])
def test_presets_of_channels_have_the_mean_and_spread_of_their_source(name, spread):
    delays = delays_of(FIFTH_GENERATION[name])
    assert delays.mean() == pytest.approx(float(name[3:-2]) / 1e3, abs=0.003)
    assert delays.std() == pytest.approx(spread, rel=0.12)


@pytest.mark.parametrize(("loss", "burst"), [(0.05, 1.0), (0.3, 1.0), (0.2, 4.0)])
def test_losses_have_the_share_and_length_that_the_channel_says(loss, burst):
    lost = np.isinf(delays_of(ig.Channel(0.02, loss=loss, burst=burst)))
    assert lost.mean() == pytest.approx(loss, abs=0.01)
    begins = np.diff(lost.astype(int), axis=1) == 1
    assert lost[:, 1:].sum() / begins.sum() == pytest.approx(burst, rel=0.06)


def test_arm_follows_the_newest_command_drops_late_ones_and_reports_their_ages():
    batch = steered(ig.operators.Reach(0.0, 0.1), uplink=ig.Channel(0.05, jitter=0.06, loss=0.2), scenario=AWAY)
    packets, ages, last = sent(batch, OWN, steps=90)[0], [], -1.0
    assert batch.tasks[0].link.packets(1.2, 0.016) >= (0.05 + 12.0 * 0.06) / 0.016  # none is overwritten in transit
    for each in played(batch, OWN, steps=90):
        now, sensors = each.chains["time"][0] + 1e-9, each.episodes["sensors"][0]
        arrived = packets[packets["arrives"] <= now]
        if len(arrived) == 0:
            assert sensors["command"] == 0.0
            continue
        newest = arrived[arrived["sent"].argmax()]
        assert sensors["command"] == newest["command"]
        assert sensors["command_age"] == pytest.approx(now - newest["sent"], abs=2e-9)
    for packet in arrived[np.argsort(arrived["arrives"])]:
        if packet["sent"] > last:
            last = packet["sent"]
            ages.append(packet["arrives"] - last)
    assert sensors["command_age_mean"] == pytest.approx(np.mean(ages), rel=1e-12)
    assert sensors["command_age_spread"] == pytest.approx(np.std(ages), rel=1e-9)


def test_trace_of_delays_is_played_from_a_random_time_on(tmp_path):
    (tmp_path / "delays.csv").write_text("time,delay\n0,0.05\n0.5,0.25\n1.0,0.05\n")
    delays = delays_of(ig.Channel(trace=tmp_path / "delays.csv"), rows=64)
    assert np.abs(np.diff(delays, axis=1)).max() == pytest.approx(0.004, rel=1e-9)  # 0.4 of 10 ms
    assert delays.min() >= 0.05
    assert delays.max() <= 0.25
    assert len(np.unique(delays[:, 0])) == 64


def test_empty_delay_of_a_trace_is_a_lost_packet_and_others_keep_their_delay(tmp_path):
    # rows are 20 ms apart and every fourth is lost: of packets each 10 ms, those nearest to a lost row are lost
    lines = [f"{20 * k},{'' if k % 4 == 2 else 30}" for k in range(401)]
    (tmp_path / "delays.csv").write_text("\n".join(["t [ms],delay [ms]", *lines]))
    delays = delays_of(ig.Channel(trace=tmp_path / "delays.csv"), rows=64)
    assert (delays > 9.0).mean() == pytest.approx(0.25, abs=0.01)
    assert delays[delays < 9.0] == pytest.approx(0.03)
    names = [field.name for field in fields(ig.Channel)]  # callers rely on this order
    assert names[:6] == ["delay", "jitter", "loss", "burst", "timeout", "trace"]


RISING = {"trace": [[0.0, 0.0], [1.0, 0.4], [2.0, 0.3]]}


@pytest.mark.parametrize("link", [
    {"delay": 0.25}, {"jitter": 0.25}, {"delay": 0.05, "jitter": 0.1, "tail": 0.6, "tail_share": 0.2},
    RISING, ig.Channel(0.15, 0.1, loss=0.3),
], ids=str)  # fmt: skip
def test_reach_takes_longer_by_the_mean_delay_of_its_links(link):
    batch = steered(ig.operators.Reach(0.0, 0.1), scenario={"distance": 0.5}, uplink=link, downlink=link)
    batch.begin_seeded(0, {})
    mean = 0.25 if link != RISING else 0.5 * (0.2 + 0.35)  # 0 to 0.4 s, then 0.4 to 0.3
    assert batch.links["duration"][0] == pytest.approx(1.875 * 0.5 / 0.5 * (1.0 + 0.64 / 0.225 * 2.0 * mean), rel=1e-12)


def test_reach_has_minimum_jerk_and_takes_longer_over_a_delay():
    way, error = 0.5, 0.03
    for delay in (0.0, 0.1125):
        links = {"uplink": {"delay": delay}, "downlink": {"delay": delay}}
        batch = steered(ig.operators.Reach(error, 1e-3, noise=0.0), scenario={"distance": way}, **links)
        packets, duration = sent(batch, STOP, steps=230)[0], 1.875 * (way + error) / 0.5 * (1.64 if delay else 1.0)
        share = np.clip(packets["sent"] / duration, 0.0, 1.0)
        speed = (way + error) / duration * 30.0 * share**2 * (1.0 - share) ** 2
        assert packets["command"] == pytest.approx(np.where(share > 0.5, np.maximum(speed, 1e-3), speed), abs=1e-12)
        assert batch.episodes["taken"][0] == 1.0


@pytest.mark.parametrize(("damping", "speed", "way"), [
    (8.9, 0.3, 0.7), (5.7, 0.5, 0.1), (2.0 * math.sqrt(38.0), 0.4, 0.5), (2.01 * math.sqrt(38.0), 0.5, 0.3),
])  # fmt: skip
def test_second_order_lag_commands_the_velocity_of_a_spring_and_damper_with_a_moving_target(damping, speed, way):
    # x'' = k (target - x) - d x'; the target moves to the place where the operator believes the object to be
    operator = ig.operators.SecondOrderLag(0.0, 1e-9, speed=speed, damping=damping)
    decay, root = 0.5 * damping, math.sqrt(max(38.0 - 0.25 * damping**2, 0.0))
    beyond = 1.0 + (math.exp(-math.pi * decay / root) if root else 0.0)
    rate, times = speed / beyond, 1e-3 * np.arange(8000)
    target = np.minimum(rate * times, way)
    expected = lsim(([38.0, 0.0], [1.0, damping, 38.0]), target, times)[1][::16]  # every 16 ms
    commands = sent(steered(operator, scenario={"distance": way}), STOP)["command"][0, :500]
    assert commands == pytest.approx(np.where(expected > 1e-4, expected, commands), abs=2e-4)
    assert 0.98 * way < 0.016 * commands.sum() < 1.03 * beyond * way  # a sum for an integral
    assert commands.max() <= speed + 1e-12
    if way / rate > 1.0:
        assert commands.max() == pytest.approx(speed, rel=1e-2)


@pytest.mark.parametrize("display", [
    {"delay": 0.06}, {"delay": 0.02, "jitter": 0.15}, {"delay": 0.02, "loss": 0.4, "burst": 20.0},
], ids=str)  # fmt: skip
def test_tracker_uses_the_newest_displayed_position(display):
    operator = ig.operators.Tracker(0.0, 1e-6, speed=0.45, gain=1.0, reaction=0.1)
    batch, late = steered(operator, scenario={"distance": 0.5}, downlink=display), 0
    packets = sent(batch, OWN, steps=100)[0]
    places = [0.0, *(each.chains["flange_position"][0] for each in played(batch, OWN, steps=100))]
    assert packets["position"] == pytest.approx(places[: len(packets)], abs=1e-12)
    for number, packet in enumerate(packets):
        seen = packets[: number + 1][packets["displayed"][: number + 1] <= packet["sent"] - 0.1 + 1e-9]
        late += len(seen) > 0 and np.isfinite(seen["displayed"]).all() and seen["displayed"].argmax() != len(seen) - 1
        remaining = 0.5 - (seen["position"][-1] if len(seen) else 0.0)
        assert packet["command"] == pytest.approx(min(remaining, 0.45), abs=1e-12)
    if len(display) == 1:
        assert packets["displayed"] - packets["sent"] == pytest.approx(0.06)
    else:
        assert late > 10 or np.isinf(packets["displayed"]).mean() > 0.1


def test_touch_is_displayed_by_the_first_arrival_of_the_packets_sent_from_the_touch_on():
    # these are the packet at the touch, which is not kept, and one at each control step
    display = {"jitter": 0.3, "loss": 0.3, "burst": 4.0}
    batch = steered(ig.operators.Trapezoid(0.4, 0.05), 200, downlink=display, scenario={"distance": 0.25})
    packets, touch, stop = sent(batch, OWN), batch.chains["first_contact"], batch.links["stop"]
    after = np.where(packets["sent"] >= touch[:, None], packets["displayed"], np.inf).min(axis=1) + 0.05
    assert (stop <= after + 1e-12).all()
    assert 0.5 < np.mean(np.abs(stop - after) < 1e-12) < 1.0
    at_once = touch - 0.3 * np.log1p(-np.random.default_rng(0).random((2000, 200)))
    assert np.mean(stop - touch) < 0.5 * np.mean(at_once - touch)


def test_noise_of_control_is_proportional_to_the_control():
    # white noise through two lags of 40 ms, 10 ms each in the source: sd 0.5 / sqrt(4 * 40 / 10) of the control
    batch = steered(ig.operators.Reach(0.0, 0.1), 2000, scenario=AWAY)
    quiet = steered(ig.operators.Reach(0.0, 0.1, noise=0.0), scenario=AWAY)
    ratios = sent(batch, STOP, steps=60)["command"][:, 30:55] / sent(quiet, STOP, steps=60)["command"][:, 30:55]
    assert ratios.mean() == pytest.approx(1.0, abs=0.01)
    assert ratios.std() == pytest.approx(0.125, rel=0.15)  # here the lags are in steps of a control period
    assert ratios.std(axis=0) == pytest.approx(ratios.std(), rel=0.1)


LOSSY = {"delay": 0.05, "loss": 0.4, "burst": 10.0}


@pytest.mark.parametrize("uplink", [*({"delay": delay} for delay in (0.0, 0.016, 0.05, 0.096, 0.1)), LOSSY], ids=str)
def test_command_without_assistance_is_never_an_intervention_even_if_the_arm_stops_after_a_timeout(uplink):
    batch = steered({"type": "Reach", "place_error": (-0.05, 0.05), "creep": 0.1}, 20, uplink=uplink, scenario=AWAY)
    stopped = 0
    for each in played(batch, OWN):
        columns = each.link_columns()
        assert not columns["is_intervention"].any()
        assert (columns["teleop_action"] == columns["intervene_action"]).all()
        stopped += each.links["expired"].sum()
    assert (stopped > 100) == ("loss" in uplink)


@pytest.mark.parametrize("delay", [0.0, 0.016, 0.05, 0.096, 0.1])
def test_velocity_of_the_flange_follows_from_the_recorded_commands_and_actions(delay):
    rng, env = np.random.default_rng(2), gym.make(TELEOP, uplink={"delay": delay}).unwrapped
    for seed in range(5):
        env.reset(seed=seed)
        velocity, ended = 0.0, False
        while not ended and env.episode_info()["contact_count"] == 0:
            begun, command = env.sensors()["time"], env.sensors()["command"]
            action = np.array([*rng.uniform(-1.0, 1.0, 2), 1.0], np.float32)  # before an alarm it cannot withdraw
            *_, ended, _, info = env.step(action)
            gain, acceleration = 0.5 * (float(action[0]) + 1.0), round(1.0 + 9.5 * (float(action[1]) + 1.0), 6)
            now, u, v = env.sensors()["time"], info["teleop_action"].item(), info["intervene_action"].item()
            arrives = math.floor((now - delay - 1e-9) / 0.016) * 0.016 + delay
            bends = [begun, arrives if arrives > begun + 1e-9 else now, now]
            for k, (of, target) in enumerate(((command, gain * command), (u, v))):  # before and after a new command
                most = (acceleration if of else 20.0) * (bends[k + 1] - bends[k])
                velocity += min(max(target - velocity, -most), most)
            assert velocity == pytest.approx(env.sensors()["velocity"], abs=1e-9)
            assert v == pytest.approx(gain * u, abs=1e-12)
            assert info["is_intervention"] == (abs(v - u) > 1e-3)
            assert info["command"] == env.sensors()["command"]


def test_simulate_with_the_recorded_velocities_gives_the_object_the_same_velocity():
    rng = np.random.default_rng(5)
    for seed in range(10):
        env = gym.make(TELEOP, record_trace=True, rtol=1e-10).unwrapped
        *_, (*_, info) = steps(env, Given(rng.uniform(-0.2, 1.0, (600, 3)).astype(np.float32)), seed)
        trace, record = env.trace(), info["record"]
        kept = np.flatnonzero(np.diff(trace.time, append=np.inf) > 1e-12)  # of equal times the last
        times, velocities = trace.time[kept], trace.command_velocity[kept]
        bends = np.flatnonzero(np.abs(np.diff(np.diff(velocities) / np.diff(times))) > 1e-6) + 1
        corners = [0, *bends, len(times) - 1]
        motion = ig.Motion(times[corners], velocities[corners])
        struck = scene(record, ig.SpringDamper(50.0), friction=record["friction"])
        outcome = ig.simulate(struck, motion, duration=float(times[-1]), rtol=1e-10)
        assert outcome.peak_object_velocity == pytest.approx(info["object_velocity"], abs=2e-6)
