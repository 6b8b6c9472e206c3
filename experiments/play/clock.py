"""The clock of tries, in a process of its own: however busy the server is, each step comes when it is due.

The server sends what the player does, and gets frames with the time until they reach the player's eyes, and the result
of each try. If the server is killed, the arm stops and the try is kept; a journal keeps it if the clock is killed, too.
"""

import os
import queue
import random
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any

import numpy as np

from experiments.lab.player.films import radius_of
from experiments.play import contest, tries
from experiments.play.assistance import PERIOD, PERSON
from experiments.play.tries import Live, Try
from impact_gym.teleop.channels import CUT

STOPPED = "the server was stopped"
SILENT = 0.25  # s, without a message a stick is let go
HOLD = 1e-5  # m/s, of a stick that is let go before a touch was seen: a pause does not end the try, as 0 would


@dataclass
class Stick:
    """The player's input, with the times at which it came."""

    inputs: deque[tuple[float, float]] = field(default_factory=lambda: deque([(-1e9, 0.0)], 256))
    touched: bool = False  # a touch has been seen
    let_go: bool = False
    marks: list[str] = field(default_factory=list)  # why the try does not count

    def put(self, velocity: float, came: float) -> None:
        """Take a velocity (m/s) that comes at a moment of the clock (s)."""
        self.inputs.append((came, velocity))

    def stop(self, why: str = "") -> None:
        """Let go for good, and say `why` the try was interrupted; nothing where the player ended it."""
        if why and not self.let_go:
            self.marks.append(f"interrupted: {why}")
        self.let_go = True

    def at(self, moment: float) -> float:
        """Return the velocity (m/s) that counts at a moment of the clock (s)."""
        inputs = tuple(self.inputs)
        came, velocity = next((each for each in reversed(inputs) if each[0] <= moment), inputs[0])
        if self.let_go or moment - came > SILENT:
            return 0.0
        return HOLD if velocity == 0.0 and not self.touched else velocity


@dataclass
class Clock:
    """Plays one try after another, as the server asks for them."""

    server: Connection
    now: Callable[[], float] = time.perf_counter  # s
    sleep: Callable[[float], None] = time.sleep  # for so many seconds
    stick: Stick = field(default_factory=Stick)
    gone: bool = False  # the server is gone: nobody looks
    wanted: queue.SimpleQueue[tuple[Try, Path, bool] | None] = field(default_factory=queue.SimpleQueue)
    unsaved: list[tuple[Path, Try]] = field(default_factory=list)  # for want of room

    def listen(self) -> None:
        """Do what the server says, until it is gone."""
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

    def tell(self, **message: Any) -> None:
        """Send a message to the server, if it is still there."""
        with suppress(OSError):
            self.server.send(message)

    def play(self, wanted: Try, path: Path, seen: bool) -> None:
        """Play a try on the clock, keep it, and tell its result; `seen`: the object is shown before it is touched."""
        try:
            live = Live(wanted)
            self.tell(kind="began", setup=wanted.setup, radius=radius_of(live.kept.record["object_mass"]))
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.with_suffix(".journal").open("wb", buffering=0) as journal:
                self._run(live, seen, journal)
            live.kept.marks.extend(self.stick.marks)
            self.unsaved.append((path, live.finished()))
            while self.unsaved:  # those that found no room before, too
                tries.write(*self.unsaved[0]).with_suffix(".journal").unlink()
                self.unsaved.pop(0)
            beside = {name: played.result for name, played in contest.rivals_of(live.kept).items()}
            self.tell(kind="ended", entry=entry_of(path.stem, live.kept, **beside))
        except (OSError, RuntimeError, ValueError) as problem:
            self.tell(kind="failed", text=str(problem))

    def _run(self, live: Live, seen: bool, journal: IO[bytes]) -> None:
        """Play the steps of a try, each when it is due, until it ends or nobody looks; `journal` has them at once."""
        slow, start, behind, rng = live.kept.slow, self.now(), 0.0, random.Random(live.kept.seed)
        self._note(journal, tries.to_text(replace(live.kept, operator=PERSON)))
        self._show(live, seen, rng)
        while not (live.ended or self.gone):
            due = start + slow * (live.time + PERIOD)
            while (left := due - self.now()) > 0.0:
                self.sleep(left)
            now = self.now()
            velocity = self.stick.at(now - slow * (live.time + PERIOD - live.next_tick))
            live.step(velocity, now - due - behind)
            self._note(journal, repr(velocity))
            behind = now - due
            if behind > slow * PERIOD:  # the machine slept: the clock goes on from here
                start, behind = start + behind, 0.0
            self._show(live, seen, rng)

    def _note(self, journal: IO[bytes], line: str) -> None:
        """Write a line into the journal; if it finds no room, the arm stops."""
        try:
            journal.write(f"{line}\n".encode())
        except OSError:
            self.stick.stop("no room for the journal")

    def _show(self, live: Live, seen: bool, rng: random.Random) -> None:
        """Send the state now and one step on, with the time until it reaches the player's eyes."""
        now, record, slow = live.batch.bodies(), live.kept.record, live.kept.slow
        then = now if live.ended else live.ahead()
        late = record["downlink.delay"] + record["downlink.jitter"] * min(rng.expovariate(1.0), CUT)
        touched = bool(then.touched[0])
        places = [np.round(np.ravel(each[1:4]), 6).tolist() for each in (now, then)]  # flange, tool, object, m
        if not (seen or touched or live.ended):  # what was missed is shown, too
            places = [[*chain, None] for *chain, _ in places]
        self.tell(
            kind="frame", n=len(live.kept.actions), t=round(live.time, 4), touched=touched, wait=late * slow,
            dt=round(float(then.time[0] - now.time[0]) * slow, 5), **dict(zip(("from", "to"), places, strict=True)),
        )  # fmt: skip


def entry_of(name: str, this: Try, **beside: dict[str, float]) -> dict[str, Any]:
    """Return what a page shows of a try in its chart and its table, and the results of those `beside` it."""
    return {"name": name, "setup": this.setup, "assist": this.assist, "delay": 2.0 * this.record["uplink.delay"],
            "marks": this.marks, "beside": beside, **this.result}  # fmt: skip


def run(server: Connection, theirs: Connection) -> None:
    """Be the clock of a server, in a process of its own; `theirs` is the server's end of the connection."""
    theirs.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server says when it ends
    clock = Clock(server)
    threading.Thread(target=clock.listen, daemon=True).start()
    with suppress(OSError, AttributeError):  # before all others, where the machine lets us
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    while (wanted := clock.wanted.get()) is not None:
        clock.play(*wanted)
