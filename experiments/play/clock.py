"""The clock: a process that plays attempts in real time or slower, and saves them even if the server is killed."""

import math
import multiprocessing
import os
import queue
import random
import signal
import threading
import time
from bisect import bisect_right
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from experiments.play import attempts
from experiments.play.assistance import PERIOD
from experiments.play.attempts import BUSY, Attempt, Live, timed_right
from impact_gym.render.chain import object_radius
from impact_gym.teleop.channels import CUT

STOPPED = "the server was stopped"
SILENT = 0.25  # s; if the player sends nothing for longer than this, the commanded velocity is 0
HOLD = 1e-5  # m/s, sent instead of 0 until the player has seen the touch, because a command of 0 would end the attempt


@dataclass
class Stick:
    """All that the player does in an attempt, with its times: `at` returns the command at any moment up to now."""

    inputs: list[tuple[float, float]] = field(default_factory=lambda: [(-math.inf, 0.0)])  # arrival (s), velocity (m/s)
    touched_at: float = math.inf  # s, from this moment on the player has seen the touch
    stopped_at: float = math.inf  # s, from this moment on the command is 0
    marks: list[str] = field(default_factory=list)  # reasons for which the attempt was interrupted

    def stop(self, moment: float, why: str = "") -> None:
        """Set the command to 0 from `moment` (s) on. Only the first call records `why` the attempt was interrupted."""
        if why and self.stopped_at == math.inf:
            self.marks.append(f"interrupted: {why}")
        self.stopped_at = min(self.stopped_at, moment)

    def at(self, moment: float) -> float:
        """Return the command (m/s) at `moment` (s): the last input or HOLD; 0 after `stop` or a silence (SILENT)."""
        came, velocity = self.inputs[bisect_right(self.inputs, (moment, math.inf)) - 1]
        if moment >= self.stopped_at or moment - came > SILENT:
            return 0.0
        return HOLD if velocity == 0.0 and moment < self.touched_at else velocity


@dataclass
class Clock:
    """Plays the attempts that the server requests, one after another."""

    server: Connection
    now: Callable[[], float] = time.perf_counter  # returns the time, s
    sleep: Callable[[float], None] = time.sleep  # waits for a time given in s
    stick: Stick = field(default_factory=Stick)
    gone: bool = False  # whether the server has ended
    wanted: queue.SimpleQueue[tuple[Attempt, Path, bool] | None] = field(default_factory=queue.SimpleQueue)
    unsaved: list[tuple[Path, Attempt]] = field(default_factory=list)  # attempts that could not be written yet

    def listen(self) -> None:
        """Handle messages of the server until the server ends."""
        with suppress(EOFError, OSError):
            while True:
                self.hear(*self.server.recv())
        self.stick.stop(self.now(), STOPPED)
        self.gone = True
        self.wanted.put(None)

    def hear(self, word: str, value: Any) -> None:
        """Handle a message of the server."""
        if word == "v":
            self.stick.inputs.append((self.now(), value))
        elif word == "stop":
            self.stick.stop(self.now(), value)
        elif word == "touched":
            self.stick.touched_at = min(self.stick.touched_at, self.now())
        else:
            self.stick = Stick()
            self.wanted.put(value)

    def send(self, **message: Any) -> None:
        """Send a message, unless the server has ended."""
        with suppress(OSError):
            self.server.send(message)

    def play(self, wanted: Attempt, path: Path, seen: bool) -> None:
        """Play an attempt, save it and send its results; `seen`: whether the object is visible before the touch."""
        try:
            live, rng = Live(wanted), random.Random(wanted.seed)
            kept, stick, slow, begun = live.kept, self.stick, wanted.slow, self.now()
            self.send(kind="began", setup=kept.setup, radius=object_radius(kept.record["object_mass"]))
            self.send(kind="frame", **frame(live, seen, rng))
            start = begun
            while not (live.ended or self.gone):
                due = start + slow * (live.time + PERIOD)
                while (left := due - self.now()) > 0.0:
                    self.sleep(left)
                late = self.now() - due
                live.step(stick.at(start + slow * live.next_tick))
                if late > slow * PERIOD:  # more than a step late: delay the schedule
                    start += late
                self.send(kind="frame", **frame(live, seen, rng))
            kept.marks.extend(stick.marks)
            if not timed_right(live.finished(), lambda tick: stick.at(begun + slow * tick)):
                kept.marks.append(BUSY)
            self.unsaved.append((path, kept))
            while self.unsaved:
                attempts.write(*self.unsaved[0])
                self.unsaved.pop(0)
            self.send(kind="ended", entry=entry_of(path.stem, kept))
        except (OSError, RuntimeError, ValueError) as problem:
            self.send(kind="failed", text=str(problem))


def frame(live: Live, seen: bool, rng: random.Random) -> dict[str, Any]:
    """Return a frame: positions (m) now and one step later, delay `wait` and time step `dt` in real time (s)."""
    now, record, slow = live.batch.bodies(), live.kept.record, live.kept.slow
    then = now if live.ended else live.ahead()
    late = record["downlink.delay"] + record["downlink.jitter"] * min(rng.expovariate(1.0), CUT)
    touched = bool(then.touched[0])
    positions = [np.round(np.ravel(each[1:4]), 6).tolist() for each in (now, then)]  # m; flange, tool, object
    if not (seen or touched or live.ended):  # at the end, the page shows even a missed object
        positions = [[*chain, None] for *chain, _ in positions]
    return {
        "n": len(live.kept.actions), "t": round(live.time, 4), "touched": touched, "wait": late * slow,
        "dt": round(float(then.time[0] - now.time[0]) * slow, 5), "from": positions[0], "to": positions[1],
    }  # fmt: skip


def entry_of(name: str, this: Attempt) -> dict[str, Any]:
    """Return the data of an attempt for the page's chart and table."""
    return {"name": name, "setup": this.setup, "assist": this.assist, "delay": 2.0 * this.record["uplink.delay"],
            "marks": this.marks, **this.result}  # fmt: skip


def start() -> tuple[Connection, Callable[[float], None]]:
    """Start a clock in another process; return the server's end of the connection, and a function that joins it."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=run, args=(theirs, ours), daemon=True)
    process.start()
    theirs.close()
    return ours, process.join


def run(server: Connection, theirs: Connection) -> None:
    """Run the clock in its own process, and close `theirs`, the server's end of the connection."""
    theirs.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server stops the clock, Ctrl-C does not
    clock = Clock(server)
    threading.Thread(target=clock.listen, daemon=True).start()
    with suppress(OSError, AttributeError):  # real-time priority needs Linux and permission
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    while (wanted := clock.wanted.get()) is not None:
        clock.play(*wanted)
