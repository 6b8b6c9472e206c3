"""The clock: a process that plays tries in real time or slower, and saves them even if the server is killed."""

import os
import queue
import random
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from experiments.play import try_files
from experiments.play.assistance import PERIOD
from experiments.play.tries import Live, Try
from impact_gym.render.chain import object_radius
from impact_gym.teleop.channels import CUT

STOPPED = "the server was stopped"
SILENT = 0.25  # s; if the player sends nothing for longer than this, the commanded velocity is 0
HOLD = 1e-5  # m/s, sent instead of 0 until the player has seen the touch, because a command of 0 would end the try


@dataclass
class Stick:
    """Velocities that the player sends, with their times of arrival."""

    inputs: deque[tuple[float, float]] = field(default_factory=lambda: deque([(-1e9, 0.0)], 256))
    touched: bool = False  # whether the player has seen the touch
    let_go: bool = False  # whether the command is 0 for the rest of the try
    marks: list[str] = field(default_factory=list)  # reasons for which the try was interrupted

    def put(self, velocity: float, came: float) -> None:
        """Add a velocity (m/s) with its time of arrival (s)."""
        self.inputs.append((came, velocity))

    def stop(self, why: str = "") -> None:
        """Set the command to 0 for the rest of the try. Only the first call records `why` the try was interrupted."""
        if why and not self.let_go:
            self.marks.append(f"interrupted: {why}")
        self.let_go = True

    def at(self, moment: float) -> float:
        """Return the command (m/s) at `moment` (s): the last input or HOLD; 0 after `stop` or a silence (SILENT)."""
        inputs = tuple(self.inputs)
        came, velocity = next((each for each in reversed(inputs) if each[0] <= moment), inputs[0])
        if self.let_go or moment - came > SILENT:
            return 0.0
        return HOLD if velocity == 0.0 and not self.touched else velocity


@dataclass
class Clock:
    """Plays the tries that the server requests, one after another."""

    server: Connection
    now: Callable[[], float] = time.perf_counter  # returns the time, s
    sleep: Callable[[float], None] = time.sleep  # waits for a time given in s
    stick: Stick = field(default_factory=Stick)
    gone: bool = False  # whether the server has ended
    wanted: queue.SimpleQueue[tuple[Try, Path, bool] | None] = field(default_factory=queue.SimpleQueue)
    unsaved: list[tuple[Path, Try]] = field(default_factory=list)  # tries that could not be written yet

    def listen(self) -> None:
        """Handle messages of the server until the server ends."""
        with suppress(EOFError, OSError):
            while True:
                word, value = self.server.recv()
                if word == "v":
                    self.stick.put(value, self.now())
                elif word == "stop":
                    self.stick.stop(value)
                elif word == "touched":
                    self.stick.touched = True
                else:
                    self.stick = Stick()
                    self.wanted.put(value)
        self.stick.stop(STOPPED)
        self.gone = True
        self.wanted.put(None)

    def send(self, **message: Any) -> None:
        """Send a message, unless the server has ended."""
        with suppress(OSError):
            self.server.send(message)

    def play(self, wanted: Try, path: Path, seen: bool) -> None:
        """Play a try, save it and send its results; `seen`: whether the object is visible before the touch."""
        try:
            live = Live(wanted)
            self.send(kind="began", setup=wanted.setup, radius=object_radius(live.kept.record["object_mass"]))
            self._run(live, seen)
            live.kept.marks.extend(self.stick.marks)
            self.unsaved.append((path, live.finished()))
            while self.unsaved:
                try_files.write(*self.unsaved[0])
                self.unsaved.pop(0)
            self.send(kind="ended", entry=entry_of(path.stem, live.kept))
        except (OSError, RuntimeError, ValueError) as problem:
            self.send(kind="failed", text=str(problem))

    def _run(self, live: Live, seen: bool) -> None:
        slow, start, behind, rng = live.kept.slow, self.now(), 0.0, random.Random(live.kept.seed)
        self._send_frame(live, seen, rng)
        while not (live.ended or self.gone):
            due = start + slow * (live.time + PERIOD)
            while (left := due - self.now()) > 0.0:
                self.sleep(left)
            now = self.now()
            velocity = self.stick.at(now - slow * (live.time + PERIOD - live.next_tick))
            live.step(velocity, now - due - behind)
            behind = now - due
            if behind > slow * PERIOD:  # more than a step late: delay the schedule
                start, behind = start + behind, 0.0
            self._send_frame(live, seen, rng)

    def _send_frame(self, live: Live, seen: bool, rng: random.Random) -> None:
        """Send a frame: positions (m) now and one step later, delay `wait` and time step `dt` in real time (s)."""
        now, record, slow = live.batch.bodies(), live.kept.record, live.kept.slow
        then = now if live.ended else live.ahead()
        late = record["downlink.delay"] + record["downlink.jitter"] * min(rng.expovariate(1.0), CUT)
        touched = bool(then.touched[0])
        places = [np.round(np.ravel(each[1:4]), 6).tolist() for each in (now, then)]  # m; flange, tool, object
        if not (seen or touched or live.ended):  # at the end, the page shows even a missed object
            places = [[*chain, None] for *chain, _ in places]
        self.send(
            kind="frame", n=len(live.kept.actions), t=round(live.time, 4), touched=touched, wait=late * slow,
            dt=round(float(then.time[0] - now.time[0]) * slow, 5), **dict(zip(("from", "to"), places, strict=True)),
        )  # fmt: skip


def entry_of(name: str, this: Try) -> dict[str, Any]:
    """Return the data of a try for the page's chart and table."""
    return {"name": name, "setup": this.setup, "assist": this.assist, "delay": 2.0 * this.record["uplink.delay"],
            "marks": this.marks, **this.result}  # fmt: skip


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
