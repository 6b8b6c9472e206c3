"""What goes on between the sockets and the environment: who has the stick, the clock of a try, and its file."""

import asyncio
import random
import secrets
import threading
import time
from collections import Counter, deque
from contextlib import suppress
from pathlib import Path
from typing import Any

from agents.setups import load_setup
from experiments.lab.player.films import chain_of, radius_of
from experiments.play import contest, tries
from experiments.play.assistance import LONGEST, MOST_JITTER, NAMES, STIFFNESS, environment_of, playable, usual
from experiments.play.live import INTERRUPTED, Asked, Live, recovered
from experiments.play.plan import Study
from experiments.play.tries import PERIOD, Try
from impact_gym.envs.batch import Bodies
from impact_gym.files import DiskFullError
from impact_gym.operators import CUT
from impact_gym.task import Task
from impact_gym.validation import choice, flag, number, one_of

SILENT = 0.25  # s, without a message a stick is let go
HOLD = 1e-5  # m/s, of a stick that is let go before a touch was seen: a pause does not end the try, as 0 would
SLOWEST = 16.0  # times slower than life
SHOWN = 200  # tries on the chart
COUPLINGS = ("rigid", "spring", "bistable")


class Stick:
    """What has been put in, with the times at which it came."""

    def __init__(self) -> None:
        self._inputs: deque[tuple[float, float]] = deque([(-1e9, 0.0)], maxlen=256)
        self.touched = self.let_go = False  # a touch has been seen; the try is to end

    def put(self, velocity: float) -> None:
        """Take a velocity (m/s) that has just come in."""
        self._inputs.append((time.perf_counter(), velocity))

    def at(self, moment: float) -> tuple[float, float]:
        """Return the velocity (m/s) that counts at a moment of the clock (s), and when it came (s)."""
        came, velocity = next((each for each in reversed(tuple(self._inputs)) if each[0] <= moment), self._inputs[0])
        if self.let_go or moment - came > SILENT:
            return 0.0, came
        return (HOLD if velocity == 0.0 and not self.touched else velocity), came


class Session:
    """One player at a time, watchers, one try at a time."""

    def __init__(self, setup: str, assist: str, folder: Path, study: Study | None = None) -> None:
        self.setup, self.assist, self.folder, self.study = playable(setup).called, assist, folder, study
        self.stick, self.marks = Stick(), list[str]()
        self.seats: list[Any] = []  # the player is the first
        self.refused: Counter[str] = Counter()
        self.loop: Any = None
        self.unsaved: list[tuple[Path, Try]] = []
        self.hurry = False  # the server stops: nothing is waited for
        self._thread: threading.Thread | None = None
        self._shown = -1
        self.history: deque[dict[str, Any]] = deque(maxlen=SHOWN)
        self.latest: Try | None = None
        self._recover()

    def _recover(self) -> None:
        """Make tries of what a killed server left under way, and read what there is."""
        for journal in sorted(self.folder.glob("*.journal")):
            with suppress(ValueError, LookupError, TypeError, RuntimeError):
                tries.write(journal.with_suffix(".json"), recovered(journal))
            journal.unlink()
        for path, this in tries.folder_of(self.folder):
            self._note(path.stem, this, {})

    def _note(self, name: str, this: Try, beside: dict[str, Any]) -> dict[str, Any]:
        """Enter a try into what the page's chart shows."""
        entry = {"name": name, "setup": this.setup, "assist": this.assist, "delay": 2.0 * this.record["uplink.delay"],
                 "slow": this.slow, "marks": this.marks, "beside": beside, **this.result}  # fmt: skip
        self.history.append(entry)
        if not this.marks:
            self.latest = this
        return entry

    # what a page is told

    def hello(self) -> dict[str, Any]:
        """Return all that a page has to know at first."""
        return {
            "kind": "hello", "setups": {name: self._about(name) for name in self.setups}, "setup": self.setup,
            "assists": NAMES, "assist": self.assist, "period": PERIOD, "tries": list(self.history),
            "longest": 2.0 * LONGEST, "jitter": MOST_JITTER, "stiffness": STIFFNESS, "slowest": SLOWEST,
            "study": self.study.now() if self.study else None, "busy": self.busy,
        }  # fmt: skip

    @property
    def setups(self) -> list[str]:
        """What may be chosen for a coupling: the set-ups of its family that are shipped, or what was asked for alone."""
        family, dash, kind = self.setup.rpartition("-")
        if self.study or not load_setup(self.setup).shipped or kind not in COUPLINGS:
            return [self.setup]
        return [f"{family}{dash}{each}" for each in COUPLINGS]

    def _about(self, name: str) -> dict[str, Any]:
        """Return what a page knows of a set-up: title, what holds the tool, how fast the arm is, where objects stand."""
        setup = playable(name)
        task = Task(**environment_of(setup), operator={"type": "Person"})
        return {"title": setup.title, "usual": usual(setup), "chain": chain_of(task), "speeds": task.velocity_range,
                "distance": task.scenario.distance, "horizon": task.horizon}  # fmt: skip

    @property
    def busy(self) -> bool:
        """Whether a try is under way."""
        return self._thread is not None and self._thread.is_alive()

    def tell(self, message: dict[str, Any]) -> None:
        """Tell all pages."""
        for seat in self.seats:
            seat.tell(message)

    # what a page says

    def hear(self, seat: Any, said: dict[str, Any]) -> None:
        """Do what the page of a seat asks for.

        Raises:
            ValueError: it is nothing that can be asked for; says what can.
        """
        if len(said) != 1:
            raise ValueError("a message must have one key")
        ((word, value),) = said.items()
        choice("message", word, ("v", "begin", "done", "take", "agree"))
        if word == "take":
            self.take(seat)
        elif seat is not self.seats[0]:
            return  # who watches has no stick
        elif word == "v":
            speeds: Any = {"at_least": -1.0, "at_most": 1.0}
            self.stick.put(self.share_to_speed(number("v", value, "(of full speed)", **speeds)))
        elif word == "done":
            self.stick.let_go = True
        elif word == "agree" and self.study:
            self.study.agree()
            self.tell({"kind": "study", "study": self.study.now()})
        elif word == "begin":
            self.begin(value)

    def share_to_speed(self, share: float) -> float:
        """Return the velocity (m/s) of a stick's deflection, -1 to 1."""
        low, high = self._speeds
        return share * high if share >= 0.0 else -share * max(low, -high)

    _speeds = (-0.3, 0.5)

    def take(self, seat: Any) -> None:
        """Give the stick to another seat; what was under way is marked, and the arm stops."""
        self.stop(f"{INTERRUPTED}another tab took the stick")
        self.seats.remove(seat)
        self.seats.insert(0, seat)
        self.roles()

    def roles(self) -> None:
        """Tell each page whether it has the stick."""
        for seat in self.seats:
            seat.tell({"kind": "role", "player": seat is self.seats[0], "others": len(self.seats) - 1})

    def leave(self, seat: Any, why: str) -> None:
        """A page has gone: if it had the stick, the arm stops."""
        if seat in self.seats:
            if seat is self.seats[0]:
                self.stop(f"{INTERRUPTED}{why}")
            self.seats.remove(seat)
            self.roles()

    def stop(self, mark: str) -> None:
        """Stop the arm of a try under way, which is kept and marked."""
        if self.busy and not self.stick.let_go:
            self.stick.let_go = True
            self.marks.append(mark)

    def begin(self, options: Any) -> None:
        """Begin a try with what the page's controls say, or with what the plan says.

        Raises:
            ValueError: a control is out of its range.
        """
        if self.busy:
            return
        asked, seen = (self.study.asked(), False) if self.study else self._asked(options)
        self._speeds = Task(**environment_of(playable(asked.setup)), operator={"type": "Person"}).velocity_range
        self.stick, self.marks, self._shown = Stick(), [], -1
        self._thread = threading.Thread(
            target=self._play, args=(asked, self._name(asked), seen, self.stick), daemon=True
        )
        self._thread.start()

    def _asked(self, options: Any) -> tuple[Asked, bool]:
        """Return what the page's controls ask for, and whether the object is to be seen."""
        one_of("begin", options, dict)
        choice("setup", options.get("setup"), self.setups)
        choice("assist", options.get("assist"), list(NAMES))
        flag("seen", options.get("seen"))
        setup = playable(options["setup"])
        limits = {
            "delay": ("s", 0.0, 2.0 * LONGEST),
            "jitter": ("s", 0.0, MOST_JITTER),
            "stiffness": ("N/m", *STIFFNESS),
        }
        chosen = {
            name: number(
                name, options.get(name, value), limits[name][0], at_least=limits[name][1], at_most=limits[name][2]
            )
            for name, value in usual(setup).items()
        }
        slow = number("slow", options.get("slow"), "(times)", at_least=1.0, at_most=SLOWEST)
        return Asked(setup.called, options["assist"], chosen, secrets.randbelow(2**31), slow), options["seen"]

    def _name(self, asked: Asked) -> Path:
        """Return where a try goes: by its time, in a study by person and number alone."""
        if asked.study:
            return self.folder / f"{asked.study['person']:06d}-{asked.study['number']:04d}.json"
        return self.folder / f"{time.strftime('%Y%m%d-%H%M%S')}-{time.time_ns() // 1000 % 1_000_000:06d}.json"

    # the clock, in a thread of its own

    def _play(self, asked: Asked, path: Path, seen: bool, stick: Stick) -> None:
        """Play a try on the clock, then keep it and tell what came of it."""
        said = self.loop.call_soon_threadsafe
        try:
            live = Live(asked, path.with_suffix(".journal"))
        except (OSError, RuntimeError, ValueError) as problem:
            said(self.tell, {"kind": "failed", "text": str(problem)})
            return
        said(self.tell, {"kind": "began", "setup": asked.setup, "radius": radius_of(live.record["object_mass"]), "seen": seen,
                         "study": bool(self.study)})  # fmt: skip
        self._run(live, stick, seen, random.Random(asked.seed))
        this = None
        try:
            live.marks += self.marks
            this = live.finished()
            self._keep(path, this)
            live.close()
        except (OSError, RuntimeError, ValueError) as problem:  # the journal stays, or the try waits for room
            live.close(keep=True)
            said(self.tell, {"kind": "failed", "text": str(problem)})
        if this is not None:
            self._tell_result(path.stem, this)

    def _run(self, live: Live, stick: Stick, seen: bool, chance: random.Random) -> None:
        """Play the steps of a try, each when it is due."""
        slow, start, count = live.asked.slow, time.perf_counter(), 0
        behind = 0.0  # s, of the step before
        full = False
        self._show(live, count, seen, chance)
        while not live.ended:
            due = start + slow * (live.time + PERIOD)
            if not self.hurry:
                time.sleep(max(due - time.perf_counter(), 0.0))
            now = time.perf_counter()
            velocity, came = stick.at(now - slow * (live.time + PERIOD - live.next_tick))
            try:
                live.step(velocity, min(now - came, 1e3), now - due - behind)
            except DiskFullError as problem:
                if not full:
                    self.stop(f"{INTERRUPTED}no room for the journal")
                    self.loop.call_soon_threadsafe(self.tell, {"kind": "failed", "text": str(problem)})
                full = True
            behind = now - due
            if behind > slow * PERIOD:  # the machine slept: the clock goes on from here
                start, behind = start + behind, 0.0
            count += 1
            self._show(live, count, seen, chance)

    def _show(self, live: Live, count: int, seen: bool, chance: random.Random) -> None:
        """Send what is so now, and one step on, on its way to the eyes."""
        record, now = live.record, live.batch.bodies()
        then = now if live.ended else live.ahead()
        late = record["downlink.delay"]
        if mean := record["downlink.jitter"]:
            late += mean * min(chance.expovariate(1.0), CUT)
        touched = bool(then.touched[0])
        frame = {
            "kind": "frame", "n": count, "t": round(float(now.time[0]), 4), "touched": touched,
            "dt": round(float(then.time[0] - now.time[0]) * live.asked.slow, 5),
            "from": places(now, seen or touched), "to": places(then, seen or touched),
        }  # fmt: skip
        wait = 0.0 if self.hurry else late * live.asked.slow
        self.loop.call_soon_threadsafe(self._frame_later, wait, frame)

    def _frame_later(self, wait: float, frame: dict[str, Any]) -> None:
        if wait > 0.0:
            self.loop.call_later(wait, self._frame, frame)
        else:
            self._frame(frame)

    def _frame(self, frame: dict[str, Any]) -> None:
        """Show a frame, if no newer one has come before it."""
        if frame["n"] > self._shown or frame["n"] == 0:
            self._shown = frame["n"]
            self.stick.touched |= frame["touched"]
            for seat in self.seats:
                seat.show(frame)

    def _keep(self, path: Path, this: Try) -> None:
        """Write a try, and those that found no room before."""
        self.unsaved.append((path, this))
        while self.unsaved:
            tries.write(*self.unsaved[0])
            self.unsaved.pop(0)

    def _tell_result(self, name: str, this: Try) -> None:
        """Tell all pages what came of a try; in a study only that it is over."""
        if self.study:
            self.study.enter(this)
            message = {"kind": "study", "study": self.study.now()}
        else:
            beside = {who: played.result for who, played in contest.beside(this).items() if played is not this}
            message = {"kind": "ended", "try": self._note(name, this, beside)}
        self.loop.call_soon_threadsafe(self.tell, message)

    def close(self) -> None:
        """Stop what is under way, keep it, and end."""
        self.stop(f"{INTERRUPTED}the server was stopped")
        self.hurry = True
        if self._thread is not None:
            self._thread.join(20.0)

    async def closed(self) -> None:
        """`close` for a loop that goes on meanwhile."""
        await asyncio.to_thread(self.close)

    def film(self, name: str) -> str:
        """Return the film of a try by its name, beside rule and policy; the first film where there is no name.

        Raises:
            ValueError: there is no such try.
        """
        if not name:
            return contest.first_film(self.setup, self.latest)
        if name not in {entry["name"] for entry in self.history}:
            raise ValueError(f"there is no try {name!r:.60}")
        this = tries.read(self.folder / f"{name}.json")
        return contest.film(contest.beside(this), "this scenario, the same for all")


def places(bodies: Bodies, seen: bool) -> list[float | None]:
    """Return where flange, tool and object are, m; the object only if it is `seen`."""
    found = [round(float(each[0]), 6) for each in (bodies.flange, bodies.tool, bodies.object)]
    return [*found[:2], found[2] if seen else None]
