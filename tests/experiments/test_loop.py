"""The loop at 1 kHz on simulated time, which is exact; one test runs arm and loop.c as programs that talk over UDP."""

import errno
import itertools
import json
import os
import shutil
import struct
from functools import partial
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from made_up_policies import made_up_policy
from refusal import refused
from simulated_time import SHIM, Network, Program, World

from agents.export.c_header import c_text
from agents.export.documentation import Exported, of_name
from experiments.loop import __main__ as command
from experiments.loop import arm
from experiments.loop.arm import COMMAND, MAGIC, PERIOD, SILENCE, Line
from impact_gym.envs.batch import Batch

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
SUBJECT = of_name("linear-blind")
TASK = SUBJECT.task.changed({"control_period": PERIOD})
SHORT = TASK.changed({"horizon": 0.3})  # s, in which the arm meets no object
READING = struct.Struct("8s11d")  # MAGIC, sequence, stamp, approach, time weight, sensors
PROBED = struct.Struct("8s6d")  # the same with the sensors of probe.h: time, alarm
SAID = "loop: no packet from the arm for 0.1 s: stopped\n"


def sent(sequence=5.0, stamp=10.0, velocity=1.0, acceleration=5.0, magic=MAGIC):
    return COMMAND.pack(magic, sequence, stamp, velocity, acceleration)


def line_with(*inbox, begun=9.95, last=4.0, peer="ours"):
    """The arm's line at 10 s, in an approach that began at `begun` (s), after a packet with the number `last`."""
    line = Line(TASK, Network(None), lambda: 10.0)
    line.begun, line.last, line.peer, line.connection.inbox = begun, last, peer, [*inbox]
    return line


@pytest.mark.parametrize(("packet", "reason"), [
    (b"", "wrong size or kind: 0 bytes"), (sent()[:-1], "kind: 39 bytes, not 40"), (sent() + b"0", "kind: 41 bytes"),
    (sent(magic=b"IGLOOP99"), "kind: 40"), (sent(velocity=nan), "with NaN"), (sent(stamp=inf), "infinity"),
    (sent(acceleration=-inf), "infinity"), (sent(nan), "with NaN"), (sent(4.0), "out of order"),
    (sent(-1.0), "out of order"), (sent(stamp=10.0011), "in the future"), (sent(stamp=9.949), "stale"),
    (sent(velocity=1.51), "beyond -0.5 ... 1.5 m/s"), (sent(velocity=-0.51), "beyond -0.5 ... 1.5 m/s"),
    (sent(acceleration=20.1), "or 20 m/s^2"), (sent(acceleration=-0.1), "or 20 m/s^2"),
])  # fmt: skip
def test_wrong_packet_is_refused_with_its_reason(packet, reason):
    line = line_with((packet, "ours"))
    assert (line.newest(), line.last, [*line.refused.values()]) == (None, 4.0, [1])
    assert reason in next(iter(line.refused))


def test_newest_valid_packet_of_the_first_sender_counts():
    for packet in (sent(4.1, 10.0009, 1.5, 20.0), sent(stamp=9.951, velocity=-0.5, acceleration=0.0)):
        assert COMMAND.unpack(packet)[2:] == line_with((packet, "ours")).newest()
    for age in (0.099, 0.101):  # s; the approach began long ago
        assert (line_with((sent(stamp=10.0 - age), "ours"), begun=5.0).newest() is None) == (age > SILENCE)
    line = line_with((b"?", "other"), (sent(0.0, 0.0), "ours"), (sent(1.0), "other"), last=-1.0, peer=None)
    assert (line.newest(), line.peer, line.last) == (None, "ours", 0.0)
    assert line.refused == {"from another address": 1, "of a wrong size or kind: 1 bytes, not 40": 1}
    line.connection.inbox = [(sent(number, velocity=0.1 * number), "ours") for number in (1.0, 3.0, 2.0)]
    assert (line.newest(), line.last) == ((10.0, pytest.approx(0.3), 5.0), 3.0)


def stamped(packet, stamp):
    return packet[:16] + struct.pack("d", stamp) + packet[24:]


class Hand:
    """Steers an arm at 1 m/s ahead; `answers(reading, packet)` are the packets that come after a reading."""

    def __init__(self, answers=lambda reading, packet: [(packet, "ours")], overslept=lambda: 0.0, seconds=60.0):
        self.world, self.network, self.readings = World(overslept), Network(self.answer), []
        self.answers, self.network.inbox = answers, [(sent(0.0, 0.0, 0.0), "ours")]
        line = Line(SHORT, self.network, self.world.time, self.world.sleep)
        self.played = arm.play(line, Batch(1, SHORT, threads=1), command.SEED, 2.0, seconds)

    def answer(self, packet):
        magic, sequence, stamp, approach, weight, time, _, velocity, *_ = READING.unpack(packet)
        assert (magic, sequence, stamp, weight) == (MAGIC, len(self.readings) + 1, self.world.now, 2.0)
        self.readings.append(SimpleNamespace(stamp=stamp, approach=approach, time=time, velocity=velocity))
        self.network.inbox += self.answers(self.readings[-1], sent(sequence, stamp))


@pytest.mark.parametrize(("reason", "since"), [("none", 0.1), ("stale", 0.0), ("from another address", 0.1)])
def test_arm_stops_0_1_s_after_the_last_good_packet(reason, since, capsys):
    """In the second approach. Stale: stamped in the first. What comes after the stop is ignored."""

    def answers(reading, packet):
        if reading.approach < 1 or not since <= reading.time < since + 0.17:
            # what is refused in the first does not count
            return [(packet, "ours")] if reading.approach else [(b"?", "ours"), (packet, "ours")]
        old = stamped(packet, reading.stamp - reading.time - 2 * PERIOD)
        return {"none": [], "stale": [(old, "ours")], "from another address": [(packet, "other")]}[reason]

    hand = Hand(answers)
    assert [bool(each["stop"]) for each in hand.played] == [False, True]
    stop, begun = hand.played[-1]["stop"], next(each.stamp for each in hand.readings if each.approach == 1)
    assert stop["at"] - begun == pytest.approx(since + SILENCE + PERIOD, abs=PERIOD)
    assert stop["velocity"] == pytest.approx(1.0 if since else 0.0, abs=0.01)
    assert stop["rest"] - stop["at"] == pytest.approx(stop["velocity"] / 20.0, abs=2 * PERIOD)
    assert f"arm: stopped, no valid packet for 0.1 s: {stop['packets']}\n" == capsys.readouterr().out
    assert reason in stop["packets"]
    assert (hand.readings[-1].time > 0.29, hand.readings[-1].velocity) == (True, 0.0)


def test_late_wake_up_of_the_arm_delays_no_later_one():
    wake_ups = itertools.count()
    hand = Hand(overslept=lambda: 4e-4 * (next(wake_ups) % 5 == 3), seconds=0.1)
    late = np.array([each.stamp - each.time for each in hand.readings])
    assert {*np.round(1e6 * np.array(hand.played[0]["ages"]))} == {600, 1000, 1400}  # microseconds
    assert {*np.round(1e6 * (late - late[0]))} == {0, 400}


def test_arm_waits_10_s_for_a_controller(tmp_path, monkeypatch):
    """In vain; and in real time, without permission for real-time priority, not at all."""
    world, task = World(), SUBJECT.task.arguments()
    assert arm.play(Line(SHORT, Network(None), world.time, world.sleep), None, 0, 2.0, 60.0) == []
    assert world.now == pytest.approx(10.0, abs=2 * PERIOD)
    monkeypatch.setattr(os, "sched_setscheduler", mock.Mock(side_effect=PermissionError))
    monkeypatch.setattr(arm, "WAIT", 0.0)
    arm.serve(task, 2.0, 0, 1.0, tmp_path / "arm.json", mock.Mock(), SILENCE)
    assert (os.sched_setscheduler.called, json.loads((tmp_path / "arm.json").read_text())) == (True, [])


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    folder = tmp_path_factory.mktemp("probe")
    shutil.copy(SHIM.with_name("probe.h"), folder)
    names = {"name": "probe", "magic": MAGIC.decode(), "silence": SILENCE, "cycle": 0.016, "top": 20.0}
    (folder / "loop.c").write_text(c_text("loop.c.jinja", Path(command.__file__).parent, **names))
    return Program(folder / "loop.c")


def reading(number, approach, ms, alarm=0.0):
    return PROBED.pack(MAGIC, number, 50.0 + number, approach, 2.0 + approach, 1e-3 * ms, alarm)


def steps(probe, packets):
    """Let loop.c receive a packet or an error in each period, then the end; return results and commands."""
    waiting = iter([*packets, reading(1e6, -1, 0)])
    return probe.run(lambda until: probe.inbox.append(next(waiting))), [COMMAND.unpack(each) for each in probe.sent]


def test_controller_is_called_each_16_ms_and_at_each_alarm(probe):
    """Also in the second approach; a lost packet moves no later call, and a call repeats the stamp of its reading."""
    first = [(0, time, time >= 53) for time in range(72) if time not in (15, 16, 17)]
    both = first + [(1, time, time >= 5) for time in range(40)]
    (code, printed, warned), commands = steps(probe, [reading(number, *each) for number, each in enumerate(both, 1)])
    assert (code, warned, json.loads(printed)["calls"]) == (0, "", 10)
    called = [(0, 0), (0, 18), (0, 32), (0, 48), (0, 53), (0, 69), (1, 0), (1, 5), (1, 21), (1, 37)]
    expected = []
    for number, (approach, time, _) in enumerate(both, 1):
        call = max(each for each in called if each <= (approach, time))
        since = called.index(call) - called.index((approach, 0)) + 1  # calls in this approach
        expected.append((MAGIC, number, 50.0 + number, 1e-3 * call[1], 100.0 * (2 + approach) + since))
    assert commands == expected


GOOD = [reading(number, 0, number) for number in range(1, 210)]
BAD = {
    "none": lambda packet: errno.EAGAIN, "no arm receives": lambda packet: errno.ECONNREFUSED,
    "too short": lambda packet: packet[:-1], "too long": lambda packet: packet + b"0",
    "out of order": lambda packet: GOOD[8], "infinite stamp": lambda packet: stamped(packet, inf),
}  # fmt: skip


@pytest.mark.parametrize("fault", BAD)
def test_controller_stops_0_1_s_after_the_last_good_packet(probe, fault):
    (code, printed, warned), commands = steps(probe, GOOD[:9] + [BAD[fault](packet) for packet in GOOD[9:]])
    assert (code, warned, len(commands)) == (3, SAID, 9 + 100)
    assert json.loads(printed)["refused"] == (0 if fault.startswith("no") else 101)


def test_controller_greets_for_10_s(probe):
    (code, printed, warned), commands = steps(probe, [errno.EAGAIN] * 10**5)
    assert (code, printed, warned) == (3, "", SAID)
    assert commands == [(MAGIC, 0.0, 0.0, 0.0, 20.0)] * 10000


def test_controller_keeps_its_schedule_and_says_its_errors(probe):
    def wake(until):
        asked.append(until)
        number = len(asked)
        probe.inbox.append(reading(number, -(number > 40), number))
        return until + {10: 300_000, 20: 3_500_000}.get(number, 0)  # ns

    asked, expected = [], {"periods": 40, "calls": 3, "missed": 3, "refused": 0, "real_time": False}
    expected |= {"error_median": 0.0, "error_99": 0.0035, "error_most": 0.0035}
    assert json.loads(probe.run(wake, priority=-1)[1]) == expected
    assert asked == [10**6 * until for until in (*range(1, 21), *range(24, 45))]


def test_loop_has_the_object_velocity_of_the_environment(tmp_path):
    """Both play the same scenarios; the commands are a period old, which changes V_p by about a hundredth."""
    program = Program(command.compiled(SUBJECT, "linear-blind", tmp_path).with_suffix(".c"))
    world, network, batch = World(), Network(None), Batch(1, TASK, threads=1)
    line, results = Line(TASK, network, world.time, world.sleep), program.run_with(network)
    played = arm.play(line, batch, command.SEED, 2.0, 2.0)
    line.send(-1, 2.0, batch.sensors())
    ((code, printed, warned),) = results
    found = command.measured(SUBJECT, 2.0, played) | json.loads(printed)
    assert (code, warned, found["missed"], found["refused"]) == (0, "", 0, 0)
    assert found["approaches"] == len(played) > 3
    assert found["object_velocity"] == pytest.approx(found["environment"], rel=0.01)
    assert found["age_median"] == pytest.approx(found["age_99"]) == pytest.approx(PERIOD)
    gentle, hurried = (command.measured(of_name("blind-profile"), weight, played) for weight in (0.5, 4.0))
    assert gentle["environment"] < 0.9 * hurried["environment"]  # the rule takes its parameters for the weight


def test_controller_is_refused_what_the_arm_lacks(tmp_path):
    for lacks in ({"range_sensor": {"noise": 0.01}}, {"past_readings": 1}, {"alarm": "reading"}):
        exported = Exported(made_up_policy(environment=lacks))
        refused(partial(command.compiled, exported, "it", tmp_path), "it needs an operator")


def test_arm_and_controller_talk_over_udp(tmp_path, monkeypatch, capsys):
    """As programs, in real time; on a busy machine they may answer late, so the watchdogs have patience."""
    monkeypatch.setattr(command, "SILENCE", 60.0)
    command.run(command.Loop("linear-blind", tmp_path, seconds=0.1))
    found, played = (json.loads((tmp_path / name).read_text()) for name in ("loop.json", "arm.json"))
    assert found["approaches"] == len(played) >= 1
    assert found["object_velocity"] == pytest.approx(np.mean([each["object_velocity"] for each in played]))
    assert (played[0]["stop"], 0.0 < found["age_median"] <= found["age_99"] <= found["age_most"]) == ({}, True)
    means = f"mean {found['object_velocity']:.4f} m/s; environment: {found['environment']:.4f}"
    assert means in capsys.readouterr().out
