"""The simulated arm: the environment in control steps of 1 ms of the wall clock, with a watchdog on its commands."""

import json
import math
import os
import socket
import struct
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from experiments.loop import EARLY, MAGIC, PERIOD, SILENCE
from impact_gym.envs.batch import Batch
from impact_gym.files import write_file
from impact_gym.task import Task

COMMAND = struct.Struct("8s4d")


class Line:
    """The arm's end of the wire: sends readings, and gives the newest good command and why others were refused."""

    def __init__(self, task: Task) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.task, self.sent, self.last, self.begun = task, 0, -1.0, 0.0
        self.refused: Counter[str] = Counter()
        self.peer: tuple[str, int] | None = None

    def send(self, approach: float, time_weight: float, readings: Mapping[str, Any]) -> None:
        """Send the readings of an approach, if a controller has said hello."""
        if self.peer is not None:
            self.sent += 1
            numbers = [self.sent, time.monotonic(), approach, time_weight, *(float(np.ravel(each)[0]) for each in readings.values())]
            self.socket.sendto(MAGIC + struct.pack(f"{len(numbers)}d", *numbers), self.peer)

    def newest(self) -> tuple[float, float, float] | None:
        """Return stamp (s), velocity (m/s) and acceleration (m/s^2) of the newest good command since the last call."""
        found = None
        while True:
            try:
                packet, peer = self.socket.recvfrom(2048)
            except (BlockingIOError, ConnectionRefusedError):
                return found
            now = time.monotonic()
            if reason := self.refusal(packet, peer, now):
                self.refused[reason] += 1
                continue
            _, sequence, *numbers = COMMAND.unpack(packet)
            self.peer, self.last = peer, sequence
            if sequence > 0:
                found = (numbers[0], numbers[1], numbers[2])

    def refusal(self, packet: bytes, peer: tuple[str, int], now: float) -> str:
        """Return why a packet is no good command at `now` (s), "" if it is one."""
        if self.peer not in (None, peer):
            return "from another address"
        if len(packet) != COMMAND.size or packet[: len(MAGIC)] != MAGIC:
            return f"wrong size: {len(packet)} bytes, not {COMMAND.size}" if packet[:8] == MAGIC else "of another kind"
        _, sequence, stamp, velocity, acceleration = COMMAND.unpack(packet)
        (slowest, fastest), (least, most) = self.task.velocity_range, self.task.acceleration_range
        if not all(map(math.isfinite, (sequence, stamp, velocity, acceleration))):
            return "NaN or infinite"
        if sequence == 0.0:
            return ""
        if sequence <= self.last:
            return "out of order"
        if stamp > now + EARLY:
            return "stamp in the future"
        if stamp < max(now - SILENCE, self.begun):
            return "stale stamp"
        if not (slowest <= velocity <= fastest and 0.0 <= acceleration <= most):
            return f"beyond {slowest:g} ... {fastest:g} m/s or {most:g} m/s^2"
        return ""


def approach(line: Line, batch: Batch, number: int, seed: int, weight: float) -> dict[str, Any]:
    """Play an approach by the wall clock, and return its results, ages of commands (s), and how it was stopped.

    With the watchdog the flange brakes as fast as it can, and what comes later moves it no more.
    """
    batch.begin_seeded(seed + number, {"time_weight": weight})
    begun = good_at = line.begun = time.monotonic()
    rest = stamp, velocity, top = begun, 0.0, line.task.acceleration_range[1]
    acceleration, ages, late, stop = top, [], [], None
    line.refused.clear()
    while not batch.ended[0]:
        line.send(number, weight, batch.sensors())
        wake = begun + float(batch.bodies().time[0]) + PERIOD
        time.sleep(max(wake - time.monotonic(), 0.0))
        now = time.monotonic()
        late.append(now - wake)
        command = line.newest()
        if stop is None and command:
            (stamp, velocity, acceleration), good_at = command, now
        if stop is None and now - good_at > SILENCE:
            _, velocity, acceleration = rest
            why = ", ".join(f"{count} packets {reason}" for reason, count in line.refused.most_common(3)) or "no packet"
            stop = {"at": now, "why": why, "velocity": float(batch.sensors()["velocity"][0])}
        if stop is not None and "rest" not in stop and batch.sensors()["velocity"][0] == 0.0:
            stop["rest"] = now
        ages.append(now - stamp)
        action = batch.action_spec.encode(velocity, acceleration)
        while not batch.ended[0] and float(batch.bodies().time[0]) + PERIOD <= now - begun + 1e-9:
            batch.step(action[None], np.zeros(1, np.bool_))
    info = batch.info(0)
    return {"object_velocity": info["object_velocity"], "approach_time": info["approach_time"],
            "missed": info["missed"], "ages": ages, "late": late, "stop": stop}  # fmt: skip


def serve(environment: Mapping[str, Any], weight: float, seed: int, seconds: float, out: Path, started: Any) -> None:
    """Play approaches for some seconds, or until the watchdog stops one, and write what came of them to `out`, JSON.

    Args:
        environment: arguments of the environment.
        weight: time weight, m/s per s.
        seed: of the first approach's scenario; the next ones count from there.
        seconds: after which no further approach begins.
        out: the file.
        started: a connection that is sent the port.
    """
    task = Task(**{**environment, "control_period": PERIOD, "time_weight": weight})
    line, batch, played = Line(task), Batch(1, task, threads=1), list[dict[str, Any]]()
    started.send(line.socket.getsockname()[1])
    with suppress(OSError):  # only some may
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    begun = time.monotonic()
    while line.peer is None and time.monotonic() < begun + 10.0:
        line.newest()
        time.sleep(PERIOD)
    while time.monotonic() < begun + seconds and not (played and played[-1]["stop"]):
        played.append(approach(line, batch, len(played), seed, weight))
    for stop in (each["stop"] for each in played if each["stop"]):
        print(f"arm: stopped, no good command for {SILENCE:g} s: {stop['why']}", flush=True)
    write_file(out, json.dumps(played))
    line.send(-1.0, weight, batch.sensors())
