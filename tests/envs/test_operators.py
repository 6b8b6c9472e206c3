"""Operators and channels: what is commanded, when it arrives, and what the operator sees."""

import numpy as np
import pytest
from episode_runs import AWAY, OWN, STOP, played, sent, steered
from scipy import stats
from scipy.signal import lsim

import impact_gym as ig
from impact_gym.teleop.channels import FIFTH_GENERATION
from impact_gym.teleop.operators import SIMPLE_REACTION


def delays_of(channel, rows=128, count=150, way="uplink"):
    """Delays of packets over a channel, (rows, n); that of a lost packet is infinite."""
    other = {"loss": 0.4, "burst": 5.0}  # the other way has losses of its own
    task = {"uplink": other, "downlink": other, way: channel, "horizon": 9.0, "scenario": AWAY, "control_period": 0.01}
    packets = sent(steered(ig.operators.Trapezoid(0.3), rows, **task), STOP, steps=count)
    return packets["arrives" if way == "uplink" else "displayed"] - packets["sent"]


@pytest.mark.parametrize(("name", "spread"), [("5g-100ms", 0.034), ("5g-299ms", 0.090), ("5g-500ms", 0.095)])
def test_presets_of_channels_have_mean_and_spread_of_source(name, spread):
    delays = delays_of(FIFTH_GENERATION[name])
    assert delays.mean() == pytest.approx(float(name[3:-2]) / 1e3, abs=0.003)
    assert delays.std() == pytest.approx(spread, rel=0.12)


@pytest.mark.parametrize("way", ["uplink", "downlink"])
@pytest.mark.parametrize(("loss", "burst"), [(0.05, 1.0), (0.3, 1.0), (0.2, 4.0)])
def test_every_packet_has_the_loss_and_burst_of_its_channel(loss, burst, way):
    lost = np.isinf(delays_of(ig.Channel(0.02, loss=loss, burst=burst), 3000, 12, way))
    error = 5.0 * np.sqrt(loss * (1.0 - loss) / len(lost))
    assert lost.mean(axis=0) == pytest.approx(loss, abs=error)  # of the first packet, too
    again = lost[:, 1:][lost[:, :-1]]  # bursts have a geometric length of the mean 1 / (1 - mean of `again`)
    assert again.mean() == pytest.approx(1.0 - 1.0 / burst, abs=2.5 / np.sqrt(len(again)) * (burst > 1.0))


PERIOD = 0.021  # s; sums of it are rounded down, so that a packet seems to arrive after the step that ends with it


@pytest.mark.parametrize(("channel", "scenario"), [
    (ig.Channel(0.05, jitter=0.06, loss=0.4, burst=6.0), AWAY), (ig.Channel(0.0), AWAY),
    (ig.Channel(0.063, timeout=0.042, loss=0.4, burst=3.0), AWAY), (ig.Channel(0.105, loss=0.2), {"distance": 0.05}),
], ids=["jitter", "no delay", "whole periods", "touch"])  # fmt: skip
def test_arm_follows_the_newest_command_until_it_expires(channel, scenario):
    batch = steered(ig.operators.Reach(0.0, 0.1), uplink=channel, scenario=scenario, control_period=PERIOD)
    packets, gone = sent(batch, OWN, steps=120)[0], 0
    stored = batch.tasks[0].link.packets(9.0, PERIOD)
    assert stored >= (channel.delay + 12.0 * channel.jitter) / PERIOD  # none is overwritten in transit
    for each in played(batch, OWN, steps=120):
        sensors, link = each.episodes["sensors"][0], each.links[0]
        now = sensors["time"]
        arrived = packets[packets["arrives"] <= now + 1e-9]
        if len(arrived) == 0:
            assert (sensors["command"], sensors["command_age"]) == (0.0, now)
            continue
        newest = arrived[arrived["sent"].argmax()]
        assert sensors["command"] == newest["command"]
        assert sensors["command_age"] == pytest.approx(now - newest["sent"], abs=1e-9)
        expired = now > newest["arrives"] + channel.timeout - 1e-9
        gone += expired
        assert link["expired"] == expired
    assert (gone > 5) == (channel.burst > 1.0)
    arrived = arrived[np.argsort(arrived["arrives"], kind="stable")]
    used = arrived[arrived["sent"] == np.maximum.accumulate(arrived["sent"])]
    ages = used["arrives"] - used["sent"]
    assert sensors["command_age_mean"] == pytest.approx(np.mean(ages), rel=1e-12)
    assert sensors["command_age_spread"] == pytest.approx(np.std(ages), rel=1e-9, abs=1e-12)


def test_trace_of_delays_is_played_from_a_random_time_on(tmp_path):
    (tmp_path / "delays.csv").write_text("time,delay\n0,0.05\n0.5,0.25\n1.0,0.05\n")
    channel, first = ig.Channel(trace=tmp_path / "delays.csv"), []
    for way in ("uplink", "downlink"):
        delays = delays_of(channel, 500, 150, way)
        assert np.abs(np.diff(delays, axis=1)).max() == pytest.approx(0.004, rel=1e-9)  # 0.4 of 10 ms
        assert stats.kstest(delays[:, 0], stats.uniform(0.05, 0.2).cdf).pvalue > 1e-3
        assert (delays.min(axis=1) < 0.054).all()
        assert (delays.max(axis=1) > 0.246).all()
        first.append(delays[:, 0])
    assert abs(np.corrcoef(*first)[0, 1]) < 5.0 / np.sqrt(500)
    # rows are 20 ms apart and every fourth is lost: of packets each 10 ms, those nearest to a lost row are lost
    lines = [f"{20 * k},{'' if k % 4 == 2 else 30}" for k in range(401)]
    (tmp_path / "delays.csv").write_text("\n".join(["t [ms],delay [ms]", *lines]))
    delays = delays_of(ig.Channel(trace=tmp_path / "delays.csv"), rows=64)
    assert (delays > 9.0).mean() == pytest.approx(0.25, abs=0.01)
    assert delays[delays < 9.0] == pytest.approx(0.03)
    # a delay of the horizon or more is a loss, too
    text = "\n".join(["t [ms],delay [ms]", *lines]).replace(",\n", ",34000\n", 99).replace(",\n", ",1e12\n")
    (tmp_path / "delays.csv").write_text(text)
    with pytest.warns(UserWarning, match="uplink.trace: 100 of 401 packets have delays .* count as lost"):
        assert np.array_equal(delays_of(ig.Channel(trace=tmp_path / "delays.csv"), rows=64), delays)


@pytest.mark.parametrize(("link", "mean"), [
    ({"delay": 0.0}, 0.0), ({"delay": 0.1125}, 0.1125), ({"jitter": 0.25}, 0.25),
    ({"trace": [[0.0, 0.0], [1.0, 0.4], [2.0, 0.3]]}, 0.5 * (0.2 + 0.35)),
    (ig.Channel(0.15, 0.1, loss=0.3), 0.25), ({"delay": 0.05, "jitter": 0.1, "tail": 0.6, "tail_share": 0.2}, 0.25),
], ids=str)  # fmt: skip
def test_reach_has_minimum_jerk_and_takes_longer_over_delays(link, mean):
    way, error, reaction = 0.5, 0.03, 0.4
    operator = ig.operators.Reach(error, 1e-3, noise=0.0, reaction=reaction)
    batch = steered(operator, scenario={"distance": way}, uplink=link, downlink=link)
    packets, duration = sent(batch, STOP, steps=230)[0], 1.875 * (way + error) / 0.5 * (1.0 + 0.64 / 0.225 * 2.0 * mean)
    assert batch.links["duration"][0] == pytest.approx(duration, rel=1e-12)
    share = np.clip(packets["sent"] / duration, 0.0, 1.0)
    speed = (way + error) / duration * 30.0 * share**2 * (1.0 - share) ** 2
    assert packets["command"] == pytest.approx(np.where(share > 0.5, np.maximum(speed, 1e-3), speed), abs=1e-12)
    assert batch.info()["stop_delay"][0] == pytest.approx(2.0 * mean + reaction, rel=1e-12)
    assert batch.episodes["withheld_share"][0] == 1.0


@pytest.mark.parametrize(("damping", "speed", "way"), [
    (8.9, 0.3, 0.7), (5.7, 0.5, 0.1), (2.0 * np.sqrt(38.0), 0.4, 0.5), (2.01 * np.sqrt(38.0), 0.5, 0.3),
])  # fmt: skip
def test_second_order_lag_commands_as_a_spring_and_damper_move(damping, speed, way):
    # x'' = k (target - x) - d x'; the target moves to the place where the operator believes the object to be
    operator = ig.operators.SecondOrderLag(0.0, 1e-9, speed=speed, damping=damping)
    decay, root = 0.5 * damping, np.sqrt(max(38.0 - 0.25 * damping**2, 0.0))
    beyond = 1.0 + (np.exp(-np.pi * decay / root) if root else 0.0)
    rate, times = speed / beyond, 1e-3 * np.arange(8000)
    target = np.minimum(rate * times, way)
    expected = lsim(([38.0, 0.0], [1.0, damping, 38.0]), target, times)[1][::16]  # every 16 ms
    commands = sent(steered(operator, scenario={"distance": way}), STOP)["command"][0, :500]
    assert commands == pytest.approx(np.where(expected > 1e-4, expected, commands), abs=2e-4)
    assert 0.98 * way < 0.016 * commands.sum() < 1.03 * beyond * way  # a sum for an integral
    assert commands.max() <= speed + 1e-12


@pytest.mark.parametrize("display", [
    {"delay": 3 * PERIOD}, {"delay": 0.02, "jitter": 0.15}, {"delay": 0.02, "loss": 0.4, "burst": 20.0},
], ids=str)  # fmt: skip
def test_tracker_uses_the_newest_displayed_position(display):
    operator = ig.operators.Tracker(0.0, 1e-6, speed=0.45, gain=1.0, reaction=2 * PERIOD)
    batch, late = steered(operator, scenario={"distance": 0.5}, downlink=display, control_period=PERIOD), 0
    packets = sent(batch, OWN, steps=100)[0]
    places = [0.0, *(each.chains["flange_position"][0] for each in played(batch, OWN, steps=100))]
    assert packets["position"] == pytest.approx(places[: len(packets)], abs=1e-12)
    for number, packet in enumerate(packets):
        seen = packets[: number + 1][packets["displayed"][: number + 1] <= packet["sent"] - 2 * PERIOD + 1e-9]
        late += len(seen) > 0 and np.isfinite(seen["displayed"]).all() and seen["displayed"].argmax() != len(seen) - 1
        remaining = 0.5 - (seen["position"][-1] if len(seen) else 0.0)
        assert packet["command"] == pytest.approx(min(remaining, 0.45), abs=1e-12)
    assert late > 10 or np.isinf(packets["displayed"]).mean() > 0.1 or len(display) == 1


@pytest.mark.parametrize("display", [{"delay": 0.12}, {"jitter": 0.3, "loss": 0.3, "burst": 4.0}], ids=str)
def test_operator_stops_a_reaction_after_seeing_the_touch(display):
    # it is seen by the first arrival of the packet at the touch, which is not kept, and one at each later control step
    options = {"uplink": {"delay": 0.05}, "downlink": display, "scenario": {"distance": 0.25}}
    batch = steered(ig.operators.Trapezoid(0.4), 200, **options)
    packets, touch, stop = sent(batch, OWN), batch.info()["touch_time"], batch.links["stop"]
    after = np.where(packets["sent"] >= touch[:, None], packets["displayed"], np.inf).min(axis=1) + SIMPLE_REACTION
    assert (stop <= after + 1e-12).all()
    if len(display) == 1:
        assert stop == pytest.approx(touch + 0.12 + SIMPLE_REACTION, abs=1e-12)
    else:
        assert 0.5 < np.mean(np.abs(stop - after) < 1e-12) < 1.0
    for row, own in enumerate(packets):
        stops = own[own["command"] == 0.0]["sent"]
        assert len(stops) == 0 or stops[0] == pytest.approx(stop[row], abs=1e-9)
    done = stop + 0.05 + 0.3  # earlier if the tool is beside the object
    assert (batch.info()["done_time"] < np.maximum(done, batch.chains["object_rest_time"]) + 0.016 + 1e-9).all()


MUSCLE = 0.016 / 0.04 / (1.0 + 0.016 / 0.04)  # rate of a lag of 40 ms, for steps of 16 ms


def undone(noise):
    """What a lag has filtered to `noise` (rows, n); the first column is unknown."""
    return noise[:, :-1] + np.diff(noise, axis=1) / MUSCLE


def measured_noise(rows=2000, count=64):
    """Errors by source, (rows, count) with nan for none; the hand's noise after its lags; and what each row draws."""
    link = ig.Channel(0.05, jitter=0.1, loss=0.3, burst=1.0 / 0.7)  # losses are independent of the previous ones
    task = {"uplink": link, "downlink": link, "scenario": AWAY, "range_sensor": {"noise": 0.01, "dropout": 0.3}}
    task |= {"force_noise": 0.5, "force_bias": 0.5}
    draws = {"tool_mass": (0.1, 0.2), "friction": (0.1, 0.5), "alarm_threshold": (1.0, 2.0)}
    loud = steered(ig.operators.Reach(0.0, 1e-9), rows, **task | draws)
    quiet = steered(ig.operators.Reach(0.0, 1e-9, noise=0.0), **task)
    loud.begin_seeded(3, {"force_error": 5.0})
    quiet.begin_seeded(3, {})
    force, gap, age = np.zeros((3, rows, count + 4))
    for tick in range(count + 4):
        loud.step(np.tile(STOP, (rows, 1)), loud.ended)
        quiet.step(np.array([STOP]), quiet.ended)
        force[:, tick], gap[:, tick], age[:, tick] = (loud.sensors()[name] for name in ("force", "range", "range_age"))
    kept, also = loud.packets[:, : count + 4], quiet.packets[:, : count + 4]
    tremor = kept["command"][:, 1:] / also["command"][:, 1:] - 1.0
    delays = {"uplink": kept["arrives"] - kept["sent"], "downlink": kept["displayed"] - kept["sent"]}
    found = {name: np.where(np.isfinite(delay), delay, np.nan) for name, delay in delays.items()}
    found |= {"force": force - 5.0, "range": np.where(age == 0.0, gap - AWAY["distance"], np.nan)}
    found = {name: values[:, 2 : count + 2] for name, values in found.items()}
    found["hand"] = undone(undone(tremor))[:, :count]
    return found, tremor, list(loud.info()["record"].values())


def features_of(values):
    """Bounded features (k, rows, n) of a source's errors: sign, size, and whether there is none; mean 0 and sd 1."""
    apart = values - np.nanmedian(values)
    size = np.abs(apart)
    found = [np.sign(apart), np.sign(size - np.nanmedian(size)), np.isnan(values).astype(float)]
    return [stats.zscore(np.nan_to_num(each), axis=None) for each in found if np.nanstd(each) > 0.0]


def test_noise_of_every_source_row_and_step_is_independent():
    found, tremor, draws = measured_noise()
    laws = {"force": stats.norm(0.0, 0.5), "range": stats.norm(0.0, 0.01), "hand": stats.norm(0.0, found["hand"].std()),
            "uplink": stats.expon(0.05, 0.1), "downlink": stats.expon(0.05, 0.1)}  # fmt: skip
    for name, values in found.items():
        assert stats.kstest(values[np.isfinite(values)][::7], laws[name].cdf).pvalue > 1e-3, name
    # white noise through two lags of 40 ms, 10 ms each in the source: sd 0.5 / sqrt(4 * 40 / 10) of the control
    assert tremor[:, 30:].std() == pytest.approx(0.125, rel=0.15)  # here the lags are in steps of a control period
    features = [(source, each) for source, values in enumerate(found.values()) for each in features_of(values)]
    sources, noise = np.array([source for source, _ in features]), np.array([each for _, each in features])
    (count, rows, steps), drawn = noise.shape, np.array([stats.zscore(each) for each in draws if np.ptp(each) > 0.0])
    columns = np.concatenate([noise.transpose(0, 2, 1).reshape(-1, rows), drawn])
    own = np.kron(sources[:, None] == sources, np.eye(steps)) > 0.0  # numbers of one reading or packet may depend
    for neighbour in (0, 1):
        correlation = columns @ np.roll(columns, neighbour, axis=1).T / rows
        if neighbour == 0:
            correlation[: len(own), : len(own)][own] = 0.0
            np.fill_diagonal(correlation, 0.0)
        assert np.abs(correlation).max() < 6.0 / np.sqrt(rows)
        by_step = correlation[: len(own), : len(own)].reshape(count, steps, count, steps)
        for lag in range(4):
            mean = np.diagonal(by_step, lag, 1, 3).mean(axis=-1)
            assert np.abs(mean).max() < 5.0 / np.sqrt(rows * (steps - lag)), (neighbour, lag)
