"""Between the pages and the clock: who has the stick, what may be asked for, and what is told."""

import asyncio
import multiprocessing
import secrets
from collections import Counter, deque
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from agents.setups import Setup
from experiments.play import clock, contest, tries
from experiments.play.assistance import NAMES, SLIDERS, about, assistance, playable, record_of
from impact_gym.validation import choice, flag, identifier, number, one_of

SHOWN = 200  # tries on the chart
COUPLINGS = ("rigid", "spring", "bistable")


class Session:
    """One player at a time, watchers, one try at a time."""

    def __init__(self, setup: Setup, assist: str, folder: Path) -> None:
        """Begin with the tries in a folder, and start the clock.

        Raises:
            ValueError: there is no such assistance, or another server plays in the folder.
        """
        assistance(assist, setup)
        self._lock = tries.locked(folder)
        self.setup, self.assist, self.folder = setup.called, assist, folder
        self.seats: list[Any] = []  # the player is the first
        self.refused: Counter[str] = Counter()
        family, _, kind = setup.called.rpartition("-")
        names = [f"{family}-{each}" for each in COUPLINGS if setup.shipped and kind in COUPLINGS] or [setup.called]
        self.setups = {name: about(playable(name)) for name in names}
        self.busy, self._speeds = False, (-1.0, 1.0)  # whether a try is under way, and how fast its arm may be, m/s
        self._seen_at, self._shown = 0.0, -1  # s, by the loop: when its last frame is seen; its newest that was shown
        self.history: deque[dict[str, Any]] = deque(maxlen=SHOWN)
        self.left_out = tries.recover(folder)  # why files in the folder are not shown
        for path in sorted(folder.glob("*.json")):
            try:
                name = identifier(f"name of {path}", path.stem)
                self.history.append(clock.entry_of(name, tries.read(path)))
            except ValueError as problem:
                self.left_out.append(str(problem))
        self.pipe, theirs = multiprocessing.Pipe()
        fork = multiprocessing.get_context("fork")
        self._clock = fork.Process(target=clock.run, args=(theirs, self.pipe), daemon=True)
        self._clock.start()
        theirs.close()

    def hear(self, seat: Any, said: Any) -> None:
        """Do what the page of a seat asks for.

        Raises:
            ValueError: it is nothing that can be asked for; says what can.
        """
        one_of("message", said, dict)
        if len(said) != 1:
            raise ValueError("a message must have one key")
        ((word, value),) = said.items()
        choice("message", word, ("v", "begin", "done", "take"))
        if word == "take":
            self._send("stop", "another tab took the stick")
            self.seats.sort(key=lambda each: each is not seat)
            self._tell_roles()
        elif seat is not self.seats[0]:
            return  # who watches has no stick
        elif word == "v":
            share = number("v", value, "(of full speed)", at_least=-1.0, at_most=1.0)
            self._send("v", abs(share) * self._speeds[share >= 0.0])
        elif word == "done":
            self._send("stop", "")
        elif not self.busy:
            self._begin(value)

    def _begin(self, options: Any) -> None:
        """Begin a try with what the page's controls say."""
        one_of("begin", options, dict)
        choice("setup", options.get("setup"), list(self.setups))
        choice("assist", options.get("assist"), list(NAMES))
        flag("seen", options.get("seen"))
        chosen, sliders = self.setups[options["setup"]], {}
        for name, at in chosen["usual"].items():
            unit, low, high = SLIDERS[name]
            sliders[name] = number(name, options.get(name, at), unit, at_least=low, at_most=high)
        slow = number("slow", options.get("slow"), "(times)", at_least=1.0, at_most=tries.SLOWEST)
        self._speeds, self._shown, self.busy = chosen["speeds"], -1, True
        wanted = tries.Try(options["setup"], options["assist"], secrets.randbelow(2**31), record_of(sliders), slow=slow)
        self._send("play", (wanted, self.folder / f"{datetime.now():%Y%m%d-%H%M%S-%f}.json", options["seen"]))

    def sit(self, seat: Any) -> None:
        """A page has come: tell it all that it has to know at first."""
        self.seats.append(seat)
        seat.tell({
            "kind": "hello", "setups": self.setups, "setup": self.setup, "assists": NAMES, "assist": self.assist,
            "tries": list(self.history), **{name: limits for name, (_, *limits) in SLIDERS.items()},
        })  # fmt: skip
        self._tell_roles()

    def leave(self, seat: Any, why: str) -> None:
        """A page has gone: if it had the stick, the arm stops."""
        if seat is self.seats[0]:
            self._send("stop", why)
        self.seats.remove(seat)
        self._tell_roles()

    def _tell_roles(self) -> None:
        """Tell each page whether it has the stick."""
        for seat in self.seats:
            seat.tell({"kind": "role", "player": seat is self.seats[0], "others": len(self.seats) - 1})

    def _send(self, word: str, value: Any = None) -> None:
        with suppress(OSError):
            self.pipe.send((word, value))

    def listen(self) -> None:
        """Pass on what the clock says when it reaches the player's eyes: the result of a try after its last frame."""
        loop = asyncio.get_running_loop()
        try:
            while self.pipe.poll():
                message = self.pipe.recv()
                at = loop.time() + message.pop("wait", 0.0)
                if message["kind"] == "frame":
                    self._seen_at = max(self._seen_at, at)
                elif message["kind"] in ("ended", "failed"):
                    at = max(at, self._seen_at + 1e-6)  # of equal ones any might come first
                loop.call_at(at, self._pass_on, message)
        except (EOFError, OSError):
            loop.remove_reader(self.pipe.fileno())
            self._pass_on({"kind": "failed", "text": "the clock has stopped: start impact-gym play again"})

    def _pass_on(self, message: dict[str, Any]) -> None:
        """Tell the pages; of a try's frames none that comes behind a newer one."""
        if message["kind"] == "frame":
            if message["n"] <= self._shown:
                return
            self._shown = message["n"]
            if message["touched"]:
                self._send("touched")
        elif message["kind"] in ("ended", "failed"):
            self.busy = False
        if message["kind"] == "ended":
            self.history.append(message["entry"])
        for seat in self.seats:
            seat.tell(message)

    def close(self) -> None:
        """Stop what is under way, have it kept, and end."""
        self.pipe.close()
        self._clock.join(20.0)
        self._lock.close()

    def film(self, name: str) -> str:
        """Return the film of a try by its name, beside rule and policy; the first film where there is no name.

        Raises:
            ValueError: there is no such try.
        """
        if not name:
            counts = [self.folder / f"{entry['name']}.json" for entry in tuple(self.history) if not entry["marks"]]
            return contest.first_film(self.setup, tries.read(counts[-1]) if counts else None)
        return contest.film(tries.read(self.folder / f"{name}.json"))
