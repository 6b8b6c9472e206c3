"""The clock of tries, in a process of its own: however busy the server is, each step comes when it is due.

The server sends what the player does, and gets frames as they reach the eyes, and what came of a try. If the server is
killed, the arm stops and the try is kept.
"""

import os
import queue
import random
import signal
import threading
import time
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from experiments.lab.player.films import radius_of
from experiments.play import contest, tries
from experiments.play.assistance import PERIOD
from experiments.play.live import INTERRUPTED, Asked, Live
from experiments.play.tries import Try
from impact_gym.envs.batch import Bodies
from impact_gym.files import DiskFullError
from impact_gym.operators import CUT

STOPPED = "the server was stopped"
SILENT = 0.25  # s, without a message a stick is let go
HOLD = 1e-5  # m/s, of a stick that is let go before a touch was seen: a pause does not end the try, as 0 would


class Stick:
    """What has been put in, with the times at which it came."""

    def __init__(self) -> None:
        self._inputs: deque[tuple[float, float]] = deque([(-1e9, 0.0)], maxlen=256)
        self.touched = False  # a touch has been seen
        self.marks: list[str] = []  # why the try is to end; one without a reason is the player's wish
        self.let_go = False

    def put(self, velocity: float) -> None:
        """Take a velocity (m/s) that has just come in."""
        self._inputs.append((time.perf_counter(), velocity))

    def stop(self, mark: str = "") -> None:
        """Let go for good; a `mark` says why the try does not count."""
        if mark and not self.let_go:
            self.marks.append(mark)
        self.let_go = True

    def at(self, moment: float) -> tuple[float, float]:
        """Return the velocity (m/s) that counts at a moment of the clock (s), and when it came (s)."""
        inputs = tuple(self._inputs)
        came, velocity = next((each for each in reversed(inputs) if each[0] <= moment), inputs[0])
        if self.let_go or moment - came > SILENT:
            return 0.0, came
        return (HOLD if velocity == 0.0 and not self.touched else velocity), came


class Clock:
    """Plays one try after another, as the server asks for them."""

    def __init__(self, server: Connection) -> None:
        self.server, self.stick, self.hurry = server, Stick(), False
        self.asked: queue.SimpleQueue[tuple[Asked, Path, bool] | None] = queue.SimpleQueue()
        self.unsaved: list[tuple[Path, Try]] = []

    def listen(self) -> None:
        """Do what the server says, until it has gone."""
        with suppress(EOFError, OSError):
            while True:
                word, value = self.server.recv()
                if word == "v":
                    self.stick.put(value)
                elif word == "stop":
                    self.stick.stop(value)
                elif word == "touched":
                    self.stick.touched = True
                else:
                    self.stick = Stick()
                    self.asked.put(value)
        self.stick.stop(INTERRUPTED + STOPPED)
        self.hurry = True
        self.asked.put(None)

    def tell(self, **message: Any) -> None:
        """Send a message to the server, if it is still there."""
        with suppress(OSError):
            self.server.send(message)

    def play(self, asked: Asked, path: Path, seen: bool) -> None:
        """Play a try on the clock, keep it, and tell what came of it."""
        try:
            live = Live(asked, path.with_suffix(".journal"))
        except (OSError, RuntimeError, ValueError) as problem:
            self.tell(kind="failed", text=str(problem))
            return
        stick = self.stick
        self.tell(kind="began", setup=asked.setup, radius=radius_of(live.record["object_mass"]), slow=asked.slow)
        self._run(live, stick, seen)
        live.marks += stick.marks
        try:
            this = live.finished()
            self.unsaved.append((path, this))
            while self.unsaved:  # those that found no room before, too
                tries.write(*self.unsaved[0])
                self.unsaved.pop(0)[0].with_suffix(".journal").unlink(missing_ok=True)
        except (OSError, RuntimeError, ValueError) as problem:  # the journal stays, and the try waits for room
            self.tell(kind="failed", text=str(problem))
            return
        finally:
            live.close()
        others = {} if asked.study else contest.beside(this)
        beside = {who: played.result for who, played in others.items() if played is not this}
        self.tell(kind="ended", entry=entry_of(path.stem, this, beside), study=this.study)

    def _run(self, live: Live, stick: Stick, seen: bool) -> None:
        """Play the steps of a try, each when it is due."""
        slow, start, behind, chance = live.asked.slow, time.perf_counter(), 0.0, random.Random(live.asked.seed)
        full = False
        self._show(live, stick, seen, chance)
        while not live.ended:
            due = start + slow * (live.time + PERIOD)
            while not self.hurry and (left := due - time.perf_counter()) > 0.0:
                time.sleep(min(left, 0.1))
            now = time.perf_counter()
            velocity, came = stick.at(now - slow * (live.time + PERIOD - live.next_tick))
            try:
                live.step(velocity, min(now - came, 1e3), 0.0 if self.hurry else now - due - behind)
            except DiskFullError as problem:
                stick.stop(f"{INTERRUPTED}no room for the journal")
                if not full:
                    self.tell(kind="said", text=str(problem))
                full = True
            behind = now - due
            if behind > slow * PERIOD:  # the machine slept: the clock goes on from here
                start, behind = start + behind, 0.0
            self._show(live, stick, seen, chance)

    def _show(self, live: Live, stick: Stick, seen: bool, chance: random.Random) -> None:
        """Send what is so now, and a step on, on its way to the eyes."""
        now, late, slow = live.batch.bodies(), live.record["downlink.delay"], live.asked.slow
        then = now if live.ended else live.ahead()
        if mean := live.record["downlink.jitter"]:
            late += mean * min(chance.expovariate(1.0), CUT)
        touched = bool(then.touched[0])
        seen = seen or touched or (live.ended and not live.asked.study)  # what was missed is shown, too
        self.tell(
            kind="frame", of=live.asked.seed, n=len(live.actions), t=round(float(now.time[0]), 4), touched=touched,
            dt=round(float(then.time[0] - now.time[0]) * slow, 5), wait=0.0 if self.hurry else late * slow,
            **{"from": places(now, seen), "to": places(then, seen)},
        )  # fmt: skip


def entry_of(name: str, this: Try, beside: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Return what a page's chart shows of a try."""
    return {"name": name, "setup": this.setup, "assist": this.assist, "delay": 2.0 * this.record["uplink.delay"],
            "slow": this.slow, "marks": this.marks, "beside": beside, **this.result}  # fmt: skip


def places(bodies: Bodies, seen: bool) -> list[float | None]:
    """Return where flange, tool and object are, m; the object only if it is `seen`."""
    found = [round(float(each[0]), 6) for each in (bodies.flange, bodies.tool, bodies.object)]
    return [*found[:2], found[2] if seen else None]


def run(server: Connection, theirs: Connection) -> None:
    """Be the clock of a server, in a process of its own; `theirs` is the server's end."""
    theirs.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server says when it ends
    clock = Clock(server)
    threading.Thread(target=clock.listen, daemon=True).start()
    with suppress(OSError, AttributeError):  # before all others, where the machine lets us
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    while (asked := clock.asked.get()) is not None:
        clock.play(*asked)
