"""The session checks messages of the page, and forwards messages of the clock (the process that plays) to the page."""

import asyncio
import secrets
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from agents.setups import Setup
from experiments.play import attempts, clock
from experiments.play.assistance import NAMES, RANGES, about, assistance, playable, record_of, related
from impact_gym.support.files import locked
from impact_gym.support.validation import choice, flag, identifier, number, one_of

MAX_ON_CHART = 200  # largest number of attempts on the chart
Page = Callable[[dict[str, Any]], object]
"""A function that sends a message to a page."""


class Session:
    """The page that steers, which is the one opened last, and the attempt in progress, if there is one."""

    def __init__(self, setup: Setup, assist: str, folder: Path, start: Callable[[], Any] = clock.start) -> None:
        """Read the attempts in `folder`, `start` the clock; ValueError: no such assistance, or the folder is in use."""
        assistance(assist, setup)
        self._lock = ExitStack()  # the clock's process inherits the lock
        self._lock.enter_context(locked(folder / ".lock", wait=False))
        self.setup, self.assist, self.folder = setup.called, assist, folder
        self.page: Page | None = None
        self.setups = {name: about(playable(name)) for name in related(setup).values()}
        self.busy, self._speeds = (
            False,
            (-1.0, 1.0),
        )  # whether an attempt is in progress; velocity range of the arm, m/s
        self._seen_at, self._newest = 0.0, -1  # s, latest time for sending a frame; number of the newest sent frame
        self.history: deque[dict[str, Any]] = deque(maxlen=MAX_ON_CHART)
        self.left_out = list[str]()  # reasons for which .json files are left out
        for path in sorted(folder.glob("*.json")):
            try:
                name = identifier(f"name of {path}", path.stem)
                self.history.append(clock.entry_of(name, attempts.read(path)))
            except ValueError as problem:
                self.left_out.append(str(problem))
        self.pipe, self._join_clock = start()

    def handle(self, page: Page, message: Any) -> None:
        """Handle a message of a page; ValueError: the message is invalid."""
        one_of("message", message, dict)
        if len(message) != 1:
            raise ValueError("a message must have one key")
        ((word, value),) = message.items()
        choice("message", word, ("v", "begin", "done"))
        if page is not self.page:
            return
        if word == "v":
            stick = number("v", value, "(of full speed)", at_least=-1.0, at_most=1.0)
            if self.busy:  # the clock keeps all inputs of an attempt
                self._send("v", abs(stick) * self._speeds[stick >= 0.0])
        elif word == "done":
            self._send("stop", "")
        elif not self.busy:
            self._begin(value)

    def _begin(self, options: Any) -> None:
        one_of("begin", options, dict)
        choice("setup", options.get("setup"), list(self.setups))
        choice("assist", options.get("assist"), list(NAMES))
        flag("seen", options.get("seen"))
        chosen, settings = self.setups[options["setup"]], {}
        for name, usual in chosen["usual"].items():
            unit, low, high = RANGES[name]
            settings[name] = number(name, options.get(name, usual), unit, at_least=low, at_most=high)
        slow = number("slow", options.get("slow"), "(times)", at_least=1.0, at_most=attempts.SLOWEST)
        record = record_of(settings)
        if (distance := options.get("distance")) is not None:  # without a distance in the record, the distance is drawn
            near, far = chosen["distance"]
            record["distance"] = number("distance", distance, "m", at_least=near, at_most=far)
        self._speeds, self._newest, self.busy = chosen["speeds"], -1, True
        seed, path = secrets.randbelow(2**31), self.folder / f"{datetime.now():%Y%m%d-%H%M%S-%f}.json"
        wanted = attempts.Attempt(options["setup"], options["assist"], seed, record, slow=slow)
        self._send("play", (wanted, path, options["seen"]))

    def join(self, page: Page) -> None:
        """Let a page steer; send set-ups, assistances, RANGES and earlier attempts to this page."""
        if self.page:
            self.page({"kind": "taken"})
            self._send("stop", "another tab took the stick")
        self.page = page
        page({
            "kind": "hello", "setups": self.setups, "setup": self.setup, "assists": NAMES, "assist": self.assist,
            "attempts": list(self.history), **{name: limits for name, (_, *limits) in RANGES.items()},
        })  # fmt: skip

    def leave(self, page: Page, why: str) -> None:
        """Remove a page, for the reason `why`; if this page steered, the arm stops."""
        if page is self.page:
            self._send("stop", why)
            self.page = None

    def _send(self, word: str, value: Any) -> None:
        with suppress(OSError):
            self.pipe.send((word, value))

    def listen(self) -> None:
        """Handle the messages of the clock that have arrived."""
        loop = asyncio.get_running_loop()
        try:
            while self.pipe.poll():
                self.schedule(self.pipe.recv(), loop)
        except (EOFError, OSError):
            loop.remove_reader(self.pipe.fileno())
            self._forward({"kind": "failed", "text": "the clock has stopped: start impact-gym play again"})

    def schedule(self, message: dict[str, Any], loop: Any) -> None:
        """Let `loop` forward a frame of the clock after the frame's delay, and a result after the last frame."""
        at = loop.time() + message.pop("wait", 0.0)
        if message["kind"] == "frame":
            self._seen_at = max(self._seen_at, at)
        elif message["kind"] in ("ended", "failed"):
            at = max(at, self._seen_at + 1e-6)  # two calls at the same time may run in any order
        loop.call_at(at, self._forward, message)

    def _forward(self, message: dict[str, Any]) -> None:
        """Send a message to the page, except a frame that is not newer than the last one."""
        kind = message["kind"]
        if kind == "frame":
            if message["n"] <= self._newest:
                return
            self._newest = message["n"]
            if message["touched"]:
                self._send("touched", None)
        elif kind in ("ended", "failed"):
            self.busy = False
        if kind == "ended":
            self.history.append(message["entry"])
        if self.page:
            self.page(message)

    def close(self) -> None:
        """Stop the clock, which saves the attempt in progress, and release the folder."""
        self.pipe.close()
        self._join_clock(20.0)
        self._lock.close()
