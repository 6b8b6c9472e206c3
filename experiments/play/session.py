"""Between the pages and the clock: who has the stick, what may be asked for, and what is told."""

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
from experiments.play.assistance import DELAY, JITTER, NAMES, STIFFNESS, playable, record_of, task_of, usual
from experiments.play.live import INTERRUPTED, recover
from experiments.play.tries import Try
from impact_gym.validation import choice, flag, number, one_of

SLOWEST = 16.0  # times slower than real time
SHOWN = 200  # tries on the chart
COUPLINGS = ("rigid", "spring", "bistable")
WORDS = ("v", "begin", "done", "take")
SLIDERS = {"delay": ("s", *DELAY), "jitter": ("s", *JITTER), "stiffness": ("N/m", *STIFFNESS)}


class Session:
    """One player at a time, watchers, one try at a time."""

    def __init__(self, setup: str, assist: str, folder: Path) -> None:
        """Begin with the tries in a folder, and start the clock."""
        self.setup, self.assist, self.folder = playable(setup).called, assist, folder
        self.seats: list[Any] = []  # the player is the first
        self.refused: Counter[str] = Counter()
        self.busy = False  # a try is under way
        self.history: deque[dict[str, Any]] = deque(maxlen=SHOWN)
        self._speeds, self._latest = (-1.0, 1.0), ""
        self._seen_at = 0.0  # s, by the loop's clock: when the last frame is seen
        self._seed, self._shown = -1, -1  # of the try under way, and its newest frame that was shown
        recover(folder)
        for path, this in tries.folder_of(folder):
            self._note(clock.entry_of(path.stem, this, {}))
        self._pipe, theirs = multiprocessing.Pipe()
        fork = multiprocessing.get_context("fork")
        self._clock = fork.Process(target=clock.run, args=(theirs, self._pipe), daemon=True)
        self._clock.start()
        theirs.close()

    def _note(self, entry: dict[str, Any]) -> None:
        """Enter a try into what the page's chart shows."""
        self.history.append(entry)
        if not entry["marks"]:
            self._latest = entry["name"]

    @property
    def setups(self) -> list[str]:
        """The set-ups that may be chosen: those of a shipped family, or the one that was asked for."""
        family, dash, kind = self.setup.rpartition("-")
        if not load_setup(self.setup).shipped or kind not in COUPLINGS:
            return [self.setup]
        return [f"{family}{dash}{each}" for each in COUPLINGS]

    def hello(self) -> dict[str, Any]:
        """Return all that a page has to know at first."""
        return {
            "kind": "hello", "setups": {name: _about(name) for name in self.setups}, "setup": self.setup,
            "assists": NAMES, "assist": self.assist, "tries": list(self.history), "delay": DELAY, "jitter": JITTER,
            "stiffness": STIFFNESS,
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
        elif not self.busy:
            self._begin(value)

    def _begin(self, options: Any) -> None:
        """Begin a try with what the page's controls say."""
        one_of("begin", options, dict)
        choice("setup", options.get("setup"), self.setups)
        choice("assist", options.get("assist"), list(NAMES))
        flag("seen", options.get("seen"))
        setup, sliders = playable(options["setup"]), {}
        for name, at in usual(setup).items():
            unit, low, high = SLIDERS[name]
            sliders[name] = number(name, options.get(name, at), unit, at_least=low, at_most=high)
        slow = number("slow", options.get("slow"), "(times)", at_least=1.0, at_most=SLOWEST)
        seed, (low, high) = secrets.randbelow(2**31), task_of(setup).velocity_range
        self._speeds, self._seed, self._shown, self.busy = (min(low, 0.0), high), seed, -1, True
        name = time.strftime("%Y%m%d-%H%M%S-") + f"{time.time_ns() // 1000 % 1_000_000:06d}.json"
        wanted = Try(setup.called, options["assist"], seed, record_of(sliders), slow=slow)
        self._send("play", (wanted, self.folder / name, options["seen"]))

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

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Listen to the clock on an event loop."""
        loop.add_reader(self._pipe.fileno(), self._listen, loop)

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            while self._pipe.poll():
                self._heard(loop, self._pipe.recv())
        except (EOFError, OSError):
            loop.remove_reader(self._pipe.fileno())
            self.busy = False
            self.tell({"kind": "failed", "text": "the clock has stopped: start impact-gym play again"})

    def _heard(self, loop: asyncio.AbstractEventLoop, message: dict[str, Any]) -> None:
        """Pass on what the clock says when it reaches the player's eyes: the result of a try after its last frame."""
        at = loop.time() + message.pop("wait", 0.0)
        if message["kind"] == "frame":
            self._seen_at = max(self._seen_at, at)
        elif message["kind"] in ("ended", "failed"):
            at = self._seen_at
        if at > loop.time():
            loop.call_at(at, self._pass_on, message)
        else:
            self._pass_on(message)

    def _pass_on(self, message: dict[str, Any]) -> None:
        """Tell the pages; of a try's frames none that comes behind a newer one."""
        if message["kind"] == "frame":
            if message["of"] != self._seed or message["n"] <= self._shown:
                return
            self._shown = message["n"]
            if message["touched"]:
                self._send("touched")
        elif message["kind"] in ("ended", "failed"):
            self.busy = False
        if message["kind"] == "ended":
            self._note(message["entry"])
        self.tell(message)

    def close(self) -> None:
        """Stop what is under way, have it kept, and end."""
        self._pipe.close()
        self._clock.join(20.0)

    async def detach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Likewise, on the loop that listens."""
        loop.remove_reader(self._pipe.fileno())
        await asyncio.to_thread(self.close)

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
        return contest.film({**contest.rivals_of(this), "you": this}, "this scenario, the same for all")


def _about(name: str) -> dict[str, Any]:
    """Return what a page knows of a set-up: what holds the tool, where objects stand, and how long a try may take."""
    setup, task = playable(name), task_of(playable(name))
    chain, distance = chain_of(task), task.scenario.distance
    return {"usual": usual(setup), "chain": chain, "distance": distance, "horizon": task.horizon}
