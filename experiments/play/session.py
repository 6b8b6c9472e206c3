"""What goes on between the pages and the clock: who has the stick, what may be asked for, and what is told."""

import asyncio
import multiprocessing
import secrets
import time
from collections import Counter, deque
from contextlib import suppress
from pathlib import Path
from typing import Any

from agents.setups import load_setup
from experiments.lab.player.films import chain_of
from experiments.play import clock, contest, tries
from experiments.play.assistance import (
    LONGEST,
    MOST_JITTER,
    NAMES,
    PERIOD,
    STIFFNESS,
    environment_of,
    playable,
    usual,
)  # fmt: skip
from experiments.play.live import INTERRUPTED, Asked, recovered
from experiments.play.plan import Study
from impact_gym.task import Task
from impact_gym.validation import choice, flag, number, one_of

SLOWEST = 16.0  # times slower than life
SHOWN = 200  # tries on the chart
COUPLINGS = ("rigid", "spring", "bistable")
WORDS = ("v", "begin", "done", "take", "agree")


class Session:
    """One player at a time, watchers, one try at a time."""

    def __init__(self, setup: str, assist: str, folder: Path, study: Study | None = None) -> None:
        """Begin with what is in a folder, and start the clock."""
        self.setup, self.assist, self.folder, self.study = playable(setup).called, assist, folder, study
        self.seats: list[Any] = []  # the player is the first
        self.refused: Counter[str] = Counter()
        self.busy = False  # a try is under way
        self.history: deque[dict[str, Any]] = deque(maxlen=SHOWN)
        self._loop: Any = None
        self._speeds, self._latest = (-1.0, 1.0), ""
        self._seen_at = 0.0  # s, by the loop's clock: when the last frame is seen
        self._seed, self._shown = -1, -1  # of the try under way, and its newest frame that was shown
        for journal in sorted(folder.glob("*.journal")):  # what a killed clock left under way
            with suppress(ValueError, LookupError, TypeError, RuntimeError):
                tries.write(journal.with_suffix(".json"), recovered(journal))
            journal.unlink()
        for path, this in tries.folder_of(folder):
            self._note(clock.entry_of(path.stem, this, {}))
        self._pipe, theirs = multiprocessing.Pipe()
        self._clock = multiprocessing.get_context("fork").Process(
            target=clock.run, args=(theirs, self._pipe), daemon=True
        )
        self._clock.start()
        theirs.close()

    def _note(self, entry: dict[str, Any]) -> None:
        """Enter a try into what the page's chart shows."""
        self.history.append(entry)
        if not entry["marks"]:
            self._latest = entry["name"]

    @property
    def setups(self) -> list[str]:
        """What may be chosen for a coupling: the shipped set-ups of a family, or what was asked for alone."""
        family, dash, kind = self.setup.rpartition("-")
        if self.study or not load_setup(self.setup).shipped or kind not in COUPLINGS:
            return [self.setup]
        return [f"{family}{dash}{each}" for each in COUPLINGS]

    def hello(self) -> dict[str, Any]:
        """Return all that a page has to know at first."""
        return {
            "kind": "hello", "setups": {name: _about(name) for name in self.setups}, "setup": self.setup,
            "assists": NAMES, "assist": self.assist, "period": PERIOD, "tries": list(self.history),
            "longest": 2.0 * LONGEST, "jitter": MOST_JITTER, "stiffness": STIFFNESS, "busy": self.busy,
            "study": self.study.now() if self.study else None,
        }  # fmt: skip

    def tell(self, message: dict[str, Any]) -> None:
        """Tell all pages."""
        for seat in self.seats:
            seat.tell(message)

    def hear(self, seat: Any, said: dict[str, Any]) -> None:
        """Do what the page of a seat asks for.

        Raises:
            ValueError: it is nothing that can be asked for; says what can.
        """
        if len(said) != 1:
            raise ValueError("a message must have one key")
        ((word, value),) = said.items()
        choice("message", word, WORDS)
        if word == "take":
            self.stop(f"{INTERRUPTED}another tab took the stick")
            self.seats.remove(seat)
            self.seats.insert(0, seat)
            self._roles()
        elif seat is not self.seats[0]:
            return  # who watches has no stick
        elif word == "v":
            share = number("v", value, "(of full speed)", at_least=-1.0, at_most=1.0)
            low, high = self._speeds
            self._send("v", share * high if share >= 0.0 else -share * low)
        elif word == "done":
            self._send("stop", "")
        elif word == "agree" and self.study:
            self.study.agree()
            self.tell({"kind": "study", "study": self.study.now()})
        elif word == "begin" and not self.busy:
            self._begin(value)

    def _begin(self, options: Any) -> None:
        """Begin a try with what the page's controls say, or with what the plan says."""
        asked, seen = (self.study.asked(), False) if self.study else self._asked(options)
        low, high = Task(**environment_of(playable(asked.setup)), operator={"type": "Person"}).velocity_range
        self._speeds, self._seed, self._shown, self.busy = (min(low, 0.0), high), asked.seed, -1, True
        name = time.strftime("%Y%m%d-%H%M%S-") + f"{time.time_ns() // 1000 % 1_000_000:06d}"
        if asked.study:  # nothing of a person but the number
            name = f"{asked.study['person']:06d}-{asked.study['number']:04d}"
        self._send("play", (asked, self.folder / f"{name}.json", seen))

    def _asked(self, options: Any) -> tuple[Asked, bool]:
        """Return what the page's controls ask for, and whether the object is to be seen."""
        one_of("begin", options, dict)
        choice("setup", options.get("setup"), self.setups)
        choice("assist", options.get("assist"), list(NAMES))
        flag("seen", options.get("seen"))
        setup, chosen = playable(options["setup"]), {}
        limits = {
            "delay": ("s", 0.0, 2.0 * LONGEST),
            "jitter": ("s", 0.0, MOST_JITTER),
            "stiffness": ("N/m", *STIFFNESS),
        }
        for name, at in usual(setup).items():
            unit, low, high = limits[name]
            chosen[name] = number(name, options.get(name, at), unit, at_least=low, at_most=high)
        slow = number("slow", options.get("slow"), "(times)", at_least=1.0, at_most=SLOWEST)
        return Asked(setup.called, options["assist"], chosen, secrets.randbelow(2**31), slow), options["seen"]

    def sit(self, seat: Any) -> None:
        """A page has come."""
        self.seats.append(seat)
        seat.tell(self.hello())
        self._roles()

    def leave(self, seat: Any, why: str) -> None:
        """A page has gone: if it had the stick, the arm stops."""
        if seat in self.seats:
            if seat is self.seats[0]:
                self.stop(f"{INTERRUPTED}{why}")
            self.seats.remove(seat)
            self._roles()

    def _roles(self) -> None:
        """Tell each page whether it has the stick."""
        for seat in self.seats:
            seat.tell({"kind": "role", "player": seat is self.seats[0], "others": len(self.seats) - 1})

    def stop(self, mark: str) -> None:
        """Stop the arm of a try under way, which is kept and marked."""
        if self.busy:
            self._send("stop", mark)

    def _send(self, word: str, value: Any = None) -> None:
        with suppress(OSError):
            self._pipe.send((word, value))

    # what the clock says

    def attach(self, loop: Any) -> None:
        """Listen to the clock on an event loop."""
        self._loop = loop
        loop.add_reader(self._pipe.fileno(), self._listen)

    def _listen(self) -> None:
        try:
            while self._pipe.poll():
                self._heard(self._pipe.recv())
        except (EOFError, OSError):
            self._loop.remove_reader(self._pipe.fileno())
            self.busy = False
            self.tell({"kind": "failed", "text": "the clock has stopped: start impact-gym play again"})

    def _heard(self, message: dict[str, Any]) -> None:
        """Pass on what the clock says, each thing when it reaches the eyes: what came of a try after its last frame."""
        now, wait = self._loop.time(), message.pop("wait", 0.0)
        if message["kind"] == "frame":
            self._seen_at = max(self._seen_at, now + wait)
        elif message["kind"] in ("ended", "failed"):
            wait = self._seen_at - now
        act = self._frame if message["kind"] == "frame" else self._result
        if wait > 0.0:
            self._loop.call_later(wait, act, message)
        else:
            act(message)

    def _result(self, message: dict[str, Any]) -> None:
        """Tell the pages that a try has begun, or what came of it."""
        kind = message["kind"]
        self.busy = self.busy and kind not in ("ended", "failed")
        if kind == "ended" and self.study:
            self.study.enter(message["study"])
            message = {"kind": "study", "study": self.study.now()}
        elif kind == "ended":
            self._note(message["entry"])
        self.tell(message)

    def _frame(self, frame: dict[str, Any]) -> None:
        """Show a frame of this try, if no newer one has come before it."""
        if frame["of"] == self._seed and frame["n"] > self._shown:
            self._shown = frame["n"]
            if frame["touched"]:
                self._send("touched")
            for seat in self.seats:
                seat.show(frame)

    async def closed(self) -> None:
        """Stop what is under way, have it kept, and end."""
        self._loop.remove_reader(self._pipe.fileno())
        await asyncio.to_thread(self.close)

    def close(self) -> None:
        """Likewise, without a loop."""
        self._pipe.close()
        self._clock.join(20.0)

    def film(self, name: str) -> str:
        """Return the film of a try by its name, beside rule and policy; the first film where there is no name.

        Raises:
            ValueError: there is no such try.
        """
        if not name:
            latest = self.folder / f"{self._latest}.json"
            return contest.first_film(self.setup, tries.read(latest) if self._latest else None)
        if name not in {entry["name"] for entry in self.history}:
            raise ValueError(f"there is no try {name!r:.60}")
        this = tries.read(self.folder / f"{name}.json")
        return contest.film(contest.beside(this), "this scenario, the same for all")


def _about(name: str) -> dict[str, Any]:
    """Return what a page knows of a set-up: title, what holds the tool, how fast the arm is, where objects stand."""
    setup = playable(name)
    task = Task(**environment_of(setup), operator={"type": "Person"})
    return {"title": setup.title, "usual": usual(setup), "chain": chain_of(task), "speeds": task.velocity_range,
            "distance": task.scenario.distance, "horizon": task.horizon}  # fmt: skip
