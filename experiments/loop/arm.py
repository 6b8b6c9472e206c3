"""A simulated arm that runs in real time. A watchdog stops the arm after SILENCE (s) without valid packets."""

import json
import math
import os
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from impact_gym.envs.batch import Batch
from impact_gym.support.files import write_file
from impact_gym.task import Task

MAGIC = b"IGLOOP01"
PERIOD, SILENCE = 1e-3, 0.1  # s, control period; time without valid packets after which the arm stops
COMMAND = struct.Struct("8s4d")  # MAGIC, sequence number, stamp of a reading (s), velocity (m/s), acceleration (m/s^2)
EARLY = 1e-3  # s, how far a stamp may be ahead of the arm's clock
WAIT = 10.0  # s, time limit for a controller's first packet


class Line:
    """The arm's end of the line to its controller: a UDP socket that does not block, and the arm's clock."""

    def __init__(
        self, task: Task, connection: Any, now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep, silence: float = SILENCE,
    ) -> None:  # fmt: skip
        self.connection, self.now, self.sleep, self.silence = connection, now, sleep, silence
        self.task, self.sent, self.last, self.begun = task, 0, -1.0, 0.0
        self.refused: Counter[str] = Counter()
        self.peer: Any = None  # address of the controller, from the first valid packet

    def send(self, approach: int, time_weight: float, readings: Mapping[str, Any]) -> None:
        """Send readings, each an array (1,), to the controller."""
        self.sent += 1
        numbers = [self.sent, self.now(), approach, time_weight, *np.concatenate([*readings.values()])]
        self.connection.sendto(MAGIC + struct.pack(f"{len(numbers)}d", *numbers), self.peer)

    def newest(self) -> tuple[float, float, float] | None:
        """Return stamp (s), velocity (m/s) and acceleration (m/s^2) of the newest valid unread command, if any."""
        found = None
        while True:
            try:
                packet, peer = self.connection.recvfrom(2048)
            except (BlockingIOError, ConnectionRefusedError):
                return found
            if reason := self.refusal(packet, peer, self.now()):
                self.refused[reason] += 1
                continue
            _, self.last, *command = COMMAND.unpack(packet)
            self.peer = peer
            found = (command[0], command[1], command[2]) if self.last > 0.0 else found  # sequence 0: a greeting

    def refusal(self, packet: bytes, peer: Any, now: float) -> str:
        """Return the reason to refuse a packet received at `now` (s); "": none."""
        if self.peer not in (None, peer):
            return "from another address"
        if len(packet) != COMMAND.size or packet[:8] != MAGIC:
            return f"of a wrong size or kind: {len(packet)} bytes, not {COMMAND.size}"
        _, sequence, stamp, velocity, acceleration = COMMAND.unpack(packet)
        (slowest, fastest), most = self.task.velocity_range, self.task.acceleration_range[1]
        if not all(map(math.isfinite, (sequence, stamp, velocity, acceleration))):
            return "with NaN or infinity"
        if sequence <= self.last:
            return "out of order"
        if sequence > 0.0 and stamp > now + EARLY:
            return "stamped in the future"
        if sequence > 0.0 and stamp < max(now - self.silence, self.begun):
            return "with a stale stamp"
        within = slowest <= velocity <= fastest and 0.0 <= acceleration <= most
        return "" if within else f"beyond {slowest:g} ... {fastest:g} m/s or {most:g} m/s^2"


def approach(line: Line, batch: Batch, number: int, seed: int, weight: float) -> dict[str, Any]:
    """Play an approach in `line`'s time; return V_p (m/s), ages (s) of the last command at each step, and `stop`.

    `stop` is empty unless the watchdog stopped the arm. Then it has time (s) and velocity (m/s) of the stop,
    refused packets, and the time of rest (s), if any. After a stop, the flange brakes fully and ignores commands.
    """
    batch.begin_seeded(seed + number, {"time_weight": weight})
    begun = good_at = stamp = line.begun = line.now()
    velocity, acceleration = 0.0, line.task.acceleration_range[1]
    ages, stop = list[float](), dict[str, Any]()
    line.refused.clear()
    while not batch.ended[0]:
        readings = batch.sensors()
        line.send(number, weight, readings)
        line.sleep(max(begun + float(readings["time"][0]) + PERIOD - line.now(), 0.0))
        now, command = line.now(), line.newest()
        if command and not stop:
            (stamp, velocity, acceleration), good_at = command, now
        elif not stop and now - good_at > line.silence:
            velocity, acceleration = 0.0, line.task.acceleration_range[1]
            why = ", ".join(f"{count} {reason}" for reason, count in line.refused.most_common(2)) or "none"
            stop = {"at": now, "velocity": float(readings["velocity"][0]), "packets": why}
        elif stop and readings["velocity"][0] == 0.0:
            stop.setdefault("rest", now)
        ages.append(now - stamp)
        action = batch.action_spec.encode(velocity, acceleration)[None]
        while not batch.ended[0] and float(batch.sensors()["time"][0]) + PERIOD <= now - begun + 1e-9:
            batch.step(action, np.zeros(1, np.bool_))
    return {"object_velocity": batch.info(0)["object_velocity"], "ages": ages, "stop": stop}


def play(line: Line, batch: Batch, seed: int, weight: float, seconds: float) -> list[dict[str, Any]]:
    """Wait for a controller, at most WAIT (s), then play approaches; return their results.

    Approaches with the seeds `seed`, `seed` + 1, ... begin until `seconds` are over or the watchdog stops the arm.
    """
    played, begun = list[dict[str, Any]](), line.now()
    while line.peer is None and line.now() < begun + WAIT:
        line.newest()
        line.sleep(PERIOD)
    while line.peer and line.now() < begun + seconds and not (played and played[-1]["stop"]):
        played.append(approach(line, batch, len(played), seed, weight))
        if stop := played[-1]["stop"]:
            print(f"arm: stopped, no valid packet for {line.silence:g} s: {stop['packets']}", flush=True)
    return played


def serve(
    environment: Mapping[str, Any], weight: float, seed: int, seconds: float, out: Path, port: Any, silence: float
) -> None:
    """Send the arm's UDP port through the pipe `port`, `play` in real time, write the results to `out` (JSON)."""
    task = Task(**{**environment, "control_period": PERIOD, "time_weight": weight})
    with suppress(OSError, AttributeError):  # real-time priority needs Linux and permission
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as connection:
        connection.bind(("127.0.0.1", 0))
        connection.setblocking(False)
        line, batch = Line(task, connection, silence=silence), Batch(1, task, threads=1)
        port.send(connection.getsockname()[1])
        write_file(out, json.dumps(play(line, batch, seed, weight, seconds)))
        if line.peer:
            line.send(-1, weight, batch.sensors())
