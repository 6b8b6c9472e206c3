"""The loop at 1 kHz: the watchdogs of arm and controller stop on every fault, and V_p is the environment's."""

import json
import math
import shutil
import socket
import struct
import subprocess
import time
from contextlib import ExitStack, suppress

import pytest

from agents.export.contract import of_name
from experiments.loop.__main__ import Loop, compiled, run, start
from experiments.loop.arm import COMMAND, MAGIC, SILENCE

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
LATE = 0.06  # s, that a busy machine may add
FAULT_AT = 0.1  # s of the approach, before any object is met
READING = struct.Struct("8s11d")  # MAGIC, sequence, stamp, approach, time weight, sensors
NAN, INFINITY = math.nan, math.inf


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return compiled(of_name("linear-blind"), "linear-blind", tmp_path_factory.mktemp("loop"))


@pytest.fixture
def lines():
    """Two sockets on this machine that wait 5 s at the most."""
    with ExitStack() as stack:
        made = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
        for each in made:
            each.settimeout(5.0)
        yield made


def steered(folder, lines, spoilt):
    """What an arm has played, steered by packets that are `spoilt` from FAULT_AT on, and when the last good came."""
    written = folder / "arm.json"
    arm, port = start(of_name("linear-blind"), 2.0, 0.3, written)
    for each in lines:
        each.connect(("127.0.0.1", port))
    line, other = lines
    line.send(COMMAND.pack(MAGIC, 0.0, 0.0, 0.0, 20.0))
    sequence, good_at, approach, waiting = 0, 0.0, 0.0, []
    with suppress(ConnectionRefusedError):  # the arm has ended
        while approach >= 0.0:
            _, _, stamp, approach, _, reading_time, *_ = READING.unpack(line.recv(1000))
            sequence, faulty = sequence + 1, approach < 0.0 or (approach == 0.0 and reading_time >= FAULT_AT)
            good_at = good_at if faulty else time.monotonic()
            packets = spoilt(sequence, stamp) if faulty else good(sequence, stamp)
            due = time.monotonic() + (0.15 if faulty and spoilt is delayed else 0.0)
            waiting += [(due, packet) for packet in packets]
            while waiting and waiting[0][0] <= time.monotonic():
                (other if faulty and spoilt is from_elsewhere else line).send(waiting.pop(0)[1])
    arm.join()
    return json.loads(written.read_text()), good_at


def good(sequence, stamp):
    return [COMMAND.pack(MAGIC, sequence, stamp, 1.0, 10.0)]


def delayed(sequence, stamp):
    return good(sequence, stamp)


def from_elsewhere(sequence, stamp):
    return good(sequence, stamp)


FAULTS = {
    "none": lambda *_: [], "none in time": delayed, "from another address": from_elsewhere,
    "of a wrong size or kind: 39 bytes": lambda *given: [good(*given)[0][:-1]],
    "of a wrong size or kind: 41 bytes": lambda *given: [good(*given)[0] + b"0"],
    "of a wrong size or kind: 40 bytes": lambda *given: [b"IGLOOP99" + good(*given)[0][8:]],
    "with NaN": lambda sequence, stamp: [COMMAND.pack(MAGIC, sequence, stamp, NAN, 10.0)],
    "or infinity": lambda sequence, stamp: [COMMAND.pack(MAGIC, sequence, INFINITY, 1.0, 10.0)],
    "stale": lambda sequence, stamp: [COMMAND.pack(MAGIC, sequence, stamp - 0.2, 1.0, 10.0)],
    "stamped in the future": lambda sequence, stamp: [COMMAND.pack(MAGIC, sequence, stamp + 0.5, 1.0, 10.0)],
    "out of order": lambda sequence, stamp: [COMMAND.pack(MAGIC, 5.0, stamp, 1.0, 10.0)],
    "beyond -0.5 ... 1.5 m/s": lambda sequence, stamp: [COMMAND.pack(MAGIC, sequence, stamp, 9.0, 10.0)],
}  # fmt: skip


@pytest.mark.parametrize("reason", FAULTS)
def test_arm_stops_0_1_s_after_the_last_good_packet_and_says_why(tmp_path, lines, reason, capfd):
    (played,), good_at = steered(tmp_path, lines, FAULTS[reason])
    stop = played["stop"]
    assert -0.01 < stop["at"] - good_at - SILENCE < LATE
    assert 0.5 < stop["velocity"] <= 1.0
    assert abs(stop["rest"] - stop["at"] - stop["velocity"] / 20.0) < LATE
    assert f"arm: stopped, no good packet for 0.1 s: {stop['packets']}" in capfd.readouterr().out
    assert reason.removesuffix(" in time") in stop["packets"]


def test_arm_goes_on_where_some_packets_are_lost(tmp_path, lines):
    played, _ = steered(tmp_path, lines, lambda sequence, stamp: good(sequence, stamp) if sequence % 3 else [])
    assert played
    assert not any(each["stop"] for each in played)


READINGS = {
    "none": lambda packet: [], "short": lambda packet: [packet[:-1]],
    "another kind": lambda packet: [bytes(8) + packet[8:]],
    "NaN": lambda packet: [packet[:16] + struct.pack("d", NAN) + packet[24:]],
    "again": lambda packet: [packet[:8] + struct.pack("d", 3.0) + packet[16:]],
}  # fmt: skip


@pytest.mark.parametrize("spoilt", READINGS.values(), ids=READINGS)
def test_controller_stops_0_1_s_after_the_last_good_packet_and_says_so(program, lines, spoilt):
    line = lines[0]
    line.bind(("127.0.0.1", 0))
    controller = subprocess.Popen([program, str(line.getsockname()[1])], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    hello, peer = line.recvfrom(100)
    assert COMMAND.unpack(hello)[:2] == (MAGIC, 0.0)
    begun, number, good_at = time.monotonic(), 0, 0.0
    while controller.poll() is None and time.monotonic() < begun + 5.0:
        number, now = number + 1, time.monotonic()
        packet = READING.pack(MAGIC, number, now, 0.0, 2.0, now - begun, *[0.0] * 6)
        for each in [packet] if number <= 50 else spoilt(packet):
            line.sendto(each, peer)
        good_at = now if number <= 50 else good_at
        time.sleep(1e-3)
    assert -0.01 < time.monotonic() - good_at - SILENCE < LATE
    assert controller.communicate()[1] == b"loop: no packet from the arm for 0.1 s: stopped\n"
    assert controller.returncode == 3


@pytest.mark.parametrize("killed", ["arm", "controller"])
def test_a_side_stops_where_the_other_is_killed(program, tmp_path, killed):
    arm, port = start(of_name("linear-blind"), 2.0, 1.0, tmp_path / "arm.json")
    controller = subprocess.Popen([program, str(port)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(0.5)
    (arm if killed == "arm" else controller).kill()
    at = time.monotonic()
    _, errors = controller.communicate(timeout=5.0)
    assert killed == "controller" or time.monotonic() - at < SILENCE + LATE
    arm.join()
    if killed == "arm":
        assert (controller.returncode, errors) == (3, "loop: no packet from the arm for 0.1 s: stopped\n")
    else:
        assert -0.01 < json.loads((tmp_path / "arm.json").read_text())[-1]["stop"]["at"] - at - SILENCE < LATE


def test_loop_has_the_object_velocity_of_the_environment(tmp_path, capsys):
    """The same scenarios; commands are a period old, which costs less than a hundredth."""
    run(Loop("linear-blind", tmp_path, seconds=3.0))
    found = json.loads((tmp_path / "loop.json").read_text())
    assert found["approaches"] >= 5
    assert found["object_velocity"] == pytest.approx(found["environment"], rel=0.04)
    assert 0.0 < found["age_median"] < 0.004
    assert "V_p of" in capsys.readouterr().out
