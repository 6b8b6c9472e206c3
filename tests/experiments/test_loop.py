"""The loop at 1 kHz: arm and controller stop at every fault, and V_p agrees with the environment."""

import json
import shutil
import socket
import struct
import subprocess
import time
from contextlib import suppress
from math import inf, nan

import pytest

from agents.export.contract import of_name
from experiments.loop.__main__ import Loop, compiled, run, start
from experiments.loop.arm import COMMAND, MAGIC, SILENCE

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
LATE = 0.06  # s, that a busy machine may add
FAULT_AT = 0.1  # s of the approach, before any object is met
READING = struct.Struct("8s11d")  # MAGIC, sequence, stamp, approach, time weight, sensors
SAID = "loop: no packet from the arm for 0.1 s: stopped\n"
SUBJECT = of_name("linear-blind")


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return compiled(SUBJECT, "linear-blind", tmp_path_factory.mktemp("loop"))


@pytest.fixture
def line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.settimeout(5.0)
        yield made


def shifted(place, by):
    """A function that adds `by` to the number at a place of a packet: 1 sequence, 2 stamp (s), 3 velocity (m/s)."""

    def change(packet):
        (number,) = struct.unpack_from("d", packet, 8 * place)
        return packet[: 8 * place] + struct.pack("d", number + by) + packet[8 * place + 8 :]

    return change


FAULTS = {
    "none": lambda packet: b"", "none, all late": lambda packet: packet, "from another address": lambda packet: packet,
    "wrong size or kind: 39 bytes": lambda packet: packet[:-1], "wrong size or kind: 41": lambda packet: packet + b"0",
    "wrong size or kind: 40": lambda packet: b"IGLOOP99" + packet[8:], "with NaN": shifted(3, nan),
    "infinity": shifted(2, inf), "stale": shifted(2, -0.2), "in the future": shifted(2, 0.5),
    "out of order": shifted(1, -1000.0), "beyond -0.5 ... 1.5 m/s": shifted(3, 9.0),
}  # fmt: skip


def steered(folder, line, change, delay=0.0, other=None):
    """Steer an arm by packets that are changed from FAULT_AT on; return its approaches, and when the last good came."""
    arm, port = start(SUBJECT, 2.0, 0.3, folder / "arm.json")
    line.connect(("127.0.0.1", port))
    line.send(COMMAND.pack(MAGIC, 0.0, 0.0, 0.0, 20.0))
    sequence, good_at, approach, waiting = 0, 0.0, 0.0, []
    with suppress(ConnectionRefusedError):  # the arm has ended
        while approach >= 0.0:
            _, _, stamp, approach, _, reading_time, *_ = READING.unpack(line.recv(1000))
            sequence, faulty = sequence + 1, approach < 0.0 or (approach == 0.0 and reading_time >= FAULT_AT)
            packet, now = COMMAND.pack(MAGIC, sequence, stamp, 1.0, 10.0), time.monotonic()
            good_at = good_at if faulty else now
            waiting.append((now + delay, change(packet)) if faulty else (now, packet))
            while waiting and waiting[0][0] <= now:
                if packet := waiting.pop(0)[1]:
                    (other.sendto if faulty and other else line.sendto)(packet, ("127.0.0.1", port))
    arm.join()
    return json.loads((folder / "arm.json").read_text()), good_at


@pytest.mark.parametrize("reason", FAULTS)
def test_arm_stops_0_1_s_after_the_last_good_packet_and_says_why(tmp_path, line, reason, capfd):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        elsewhere, delay = (other if "address" in reason else None), (0.15 if "late" in reason else 0.0)
        (played,), good_at = steered(tmp_path, line, FAULTS[reason], delay, elsewhere)
    stop = played["stop"]
    assert -0.01 < stop["at"] - good_at - SILENCE < LATE
    assert 0.5 < stop["velocity"] <= 1.0
    assert abs(stop["rest"] - stop["at"] - stop["velocity"] / 20.0) < LATE
    assert f"arm: stopped, no valid packet for 0.1 s: {stop['packets']}" in capfd.readouterr().out
    assert reason.partition(",")[0] in stop["packets"]


def test_arm_goes_on_where_some_packets_are_lost(tmp_path, line):
    numbers = iter(range(10**6))
    played, _ = steered(tmp_path, line, lambda packet: packet if next(numbers) % 3 else b"")
    assert [each["stop"] for each in played] == [{}] * len(played) != []


@pytest.mark.parametrize("fault", ["none", "wrong size or kind: 39 bytes", "wrong size or kind: 40", "infinity",
                                   "out of order"])  # fmt: skip
def test_controller_stops_0_1_s_after_the_last_good_packet_and_says_so(program, line, fault):
    line.bind(("127.0.0.1", 0))
    words, pipe = [program, str(line.getsockname()[1])], subprocess.PIPE
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True) as controller:
        hello, peer = line.recvfrom(100)
        assert COMMAND.unpack(hello)[:2] == (MAGIC, 0.0)
        begun, number, good_at = time.monotonic(), 0, 0.0
        while controller.poll() is None and number < 5000:
            number, now = number + 1, time.monotonic()
            packet = READING.pack(MAGIC, number, now, 0.0, 2.0, now - begun, *[0.0] * 6)
            good_at = now if number <= 50 else good_at
            line.sendto(packet if number <= 50 else FAULTS[fault](packet), peer)
            time.sleep(1e-3)
        assert -0.01 < time.monotonic() - good_at - SILENCE < LATE
        assert (controller.communicate()[1], controller.returncode) == (SAID, 3)


@pytest.mark.parametrize("killed", ["arm", "controller"])
def test_a_side_stops_where_the_other_is_killed(program, tmp_path, killed):
    arm, port = start(SUBJECT, 2.0, 1.0, tmp_path / "arm.json")
    controller = subprocess.Popen([program, str(port)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(0.5)
    (arm if killed == "arm" else controller).kill()
    at = time.monotonic()
    _, errors = controller.communicate(timeout=5.0)
    ended = time.monotonic()
    arm.join()
    if killed == "arm":
        assert (controller.returncode, errors) == (3, SAID)
    else:
        ended = json.loads((tmp_path / "arm.json").read_text())[-1]["stop"]["at"]
    assert -0.01 < ended - at - SILENCE < LATE


def test_loop_has_the_object_velocity_of_the_environment(tmp_path, capsys):
    """Both play the same scenarios; the commands are a period old, which changes V_p by about a hundredth."""
    run(Loop("linear-blind", tmp_path, seconds=3.0))
    found = json.loads((tmp_path / "loop.json").read_text())
    assert found["approaches"] >= 5
    assert found["object_velocity"] == pytest.approx(found["environment"], rel=0.04)
    assert 0.0 < found["age_median"] < 0.004
    assert "V_p of" in capsys.readouterr().out
