"""`python -m experiments.films`: short films of several controllers with the same object, one below the other.

The object is the middle of the ranges that the set-ups draw from. All rows have one scale and one clock, which runs
slower around each touch.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from PIL import Image
from tyro.conf import Positional, arg

from agents import load_policy, load_setup
from agents.baselines import LocalBrake, OperatorAlone, PaperTrapezoid, load_baseline
from agents.command_line import run_command
from agents.policies import Controller
from experiments.lab.player.films import Run, clock, play
from impact_gym.files import write_file
from impact_gym.render import chain
from impact_gym.render.canvas import Canvas
from impact_gym.render.palette import FAINT, LIGHT
from impact_gym.validation import choice

OBJECT = {"object_mass": 0.5, "contact_stiffness": 3.16e4, "restitution": 0.55, "distance": 0.25}  # kg, N/m^1.5, -, m
WEIGHT = 1.2  # m/s per s, at which the tuned profile arrives as late as the paper's rule
HAND = {
    "friction": 0.3, "uplink": {"delay": 0.1}, "downlink": {"delay": 0.1},
    "operator": {"type": "Trapezoid", "speed": 0.4},
}  # fmt: skip
"""A steady hand with 200 ms of delay (100 ms each way), which stops as soon as it can once it sees the touch."""
SHIPPED = Path("docs/films")
SECONDS, HOLD, RATE = 6.0, 2.0, 20  # s of motion, s for which the result stays, pictures per s
AFTER = 0.25  # s, shown after the last touch
WIDTH, ROW, HEAD = 960, 254, 80  # pixels
ABOUT = {
    "rule": "constant speed; brakes once it senses the touch",
    "blind-profile": "velocity as a function of position, tuned on many objects",
    "ranged-profile": "velocity as a function of the estimated distance, tuned",
    "policy": "neural network, trained on many objects",
    "alone": "lets go 0.2 s after the touch, plus its reaction time",
    "brake": "the arm itself stops the tool at the touch",
}
"""What each controller does, in a line below its name."""
EFFORT = 80  # 0 to 100, effort of the lossless compression


class Row(NamedTuple):
    """A contestant of a film."""

    label: str
    colour: str  # its name in the palette
    setup: str
    controller: str  # a key of ABOUT

    def run(self) -> Run:
        """Play the episode."""
        setup = load_setup(self.setup)
        options = {name: value for name, value in setup.environment.items() if name != "time_weight"}
        options |= HAND if "operator" in options else {}
        controllers: dict[str, Any] = {
            "rule": PaperTrapezoid, "alone": OperatorAlone, "brake": LocalBrake,
            "policy": lambda: load_policy(self.setup),
        }  # fmt: skip
        load = controllers.get(self.controller, lambda: load_baseline(self.controller, WEIGHT))
        controller: Controller = load()
        if hasattr(controller, "for_environment"):
            controller = controller.for_environment(options)
        return play(controller, 0, 0, {"time_weight": WEIGHT, **OBJECT}, options)


FILMS: Mapping[str, tuple[Row, ...]] = {
    "rule-and-profile": (
        Row("paper's rule", "rule", "linear-blind", "rule"),
        Row("tuned profile", "profile", "linear-blind", "blind-profile"),
    ),
    "rule-profile-policy": (
        Row("paper's rule", "rule", "linear-blind", "rule"),
        Row("tuned profile", "profile", "linear-blind", "blind-profile"),
        Row("learned policy", "policy", "linear-blind", "policy"),
    ),
    "hand-and-brake": (
        Row("hand alone", "person", "teleop-rigid", "alone"),
        Row("same hand, brake on", "warning", "teleop-rigid", "brake"),
    ),
    "hand-and-spring": (
        Row("hand, rigid tool", "person", "teleop-rigid", "alone"),
        Row("hand, tool on a spring", "person", "teleop-spring", "alone"),
        Row("spring and brake", "warning", "teleop-spring", "brake"),
    ),
    "couplings": (
        Row("rigid", "rule", "rigid-blind", "rule"),
        Row("spring and damper", "rule", "linear-blind", "rule"),
        Row("bistable mechanism", "rule", "bistable-blind", "rule"),
    ),
    "distance-estimated": (
        Row("paper's rule", "rule", "linear-ranged", "rule"),
        Row("profile, blind", "profile", "linear-blind", "blind-profile"),
        Row("profile, distance estimated", "profile", "linear-ranged", "ranged-profile"),
    ),
}  # fmt: skip
"""Sentence and rows of each film, by name; the first row is at the top."""


@dataclass(frozen=True)
class Films:
    """Make WebP films, each of several controllers that approach the same object."""

    names: Annotated[Positional[tuple[str, ...]], arg(metavar="[NAME ...]")] = field(default=tuple(FILMS))
    """Names of the films. Default: all films."""
    out: Annotated[Path, arg(metavar="FOLDER")] = SHIPPED
    """Folder for the films."""


def instants(runs: list[Run]) -> Iterator[tuple[float, float]]:
    """Yield time (s) and slow-motion factor of each picture: the largest factor of all runs, scaled to last SECONDS."""
    touches = [run.contacts[0][0] for run in runs if run.contacts]
    end = min(max(run.history.now for run in runs), max(touches, default=np.inf) + AFTER)
    if runs[0].history.task.operator:
        end = max(run.info["done_time"] for run in runs)
    stretches = np.array([*clock(runs, end), [end, 1.0]])
    starts, slower = stretches.T
    begins = np.append(0.0, np.cumsum(np.diff(starts) * slower[:-1]))
    pace = SECONDS / begins[-1]
    for at in np.arange(0.0, SECONDS, 1.0 / RATE):
        place = max(int(np.searchsorted(begins * pace, at, side="right")) - 1, 0)
        yield float(starts[place] + (at - begins[place] * pace) / (slower[place] * pace)), float(slower[place] * pace)
    yield end, 1.0


def pictures(rows: tuple[Row, ...]) -> Iterator[Image.Image]:
    """Yield the pictures of a film."""
    runs = [row.run() for row in rows]
    canvas = Canvas(WIDTH, ROW * len(rows) + 8)
    boxes = [(0.0, float(ROW * k + HEAD), float(WIDTH), float(ROW - HEAD)) for k in range(len(rows))]
    views = [chain.camera(run.history, box) for run, box in zip(runs, boxes, strict=True)]
    widest = min(views, key=lambda view: view.scale)  # one scale for all rows
    views = [
        view._replace(scale=widest.scale, left=widest.left, axis=view.ground - (widest.ground - widest.axis))
        for view in views
    ]
    every = list(instants(runs))
    for time, slower in every:
        canvas.clear()
        for row, run, view in zip(rows, runs, views, strict=True):
            _draw(canvas, row, run, view, time, slower, last=time == every[-1][0])
        yield Image.fromarray(canvas.pixels())


def _draw(canvas: Canvas, row: Row, run: Run, view: chain.Camera, time: float, slower: float, last: bool) -> None:
    """Draw a row: name, caption, time and the object's velocity, at the end the result, and the chain."""
    state = run.history.at(min(time, run.history.now))
    coast = run.farthest(time) - run.history.at(run.history.now).object_position if time > run.history.now else 0.0
    state = state._replace(object_position=state.object_position + coast)
    chain.draw(canvas, run.history, state, view)
    top, colour = view.box[1] - HEAD, LIGHT[row.colour]
    canvas.rectangle((0.0, top + 6.0, 12.0, float(ROW - 6)), colour)
    canvas.text(row.label, (26.0, top + 30.0), 38, colour)
    touched = f"touch after {run.contacts[0][0]:.2f} s" if run.contacts and run.contacts[0][0] <= time else ""
    pace = f"{time:.2f} s, {slower:.0f} x slower" if slower > 1.4 else f"{time:.2f} s"
    canvas.text(touched if last else pace, (0.5 * WIDTH, top + 30.0), 28, FAINT, "center")
    canvas.text(ABOUT[row.controller], (26.0, top + 62.0), 26, FAINT)
    words, note = f"object {state.object_velocity:.2f} m/s", ""
    if last and "slide" in run.info:
        words, note = f"slid {chain.length(run.info['slide'])}", "path of the object; shorter is gentler"
    elif last:
        words, note = f"{run.info['object_velocity']:.2f} m/s", "final speed of the object; slower is gentler"
    canvas.text(words, (WIDTH - 14.0, top + 28.0), 48, anchor="midright")
    canvas.text(note, (WIDTH - 14.0, top + 62.0), 26, FAINT, "midright")


def film(rows: tuple[Row, ...]) -> bytes:
    """Return a film of these rows as WebP, which plays in a loop."""
    first, *rest = pictures(rows)
    lengths = [round(1000 / RATE)] * len(rest) + [round(1000 * HOLD)]
    file = io.BytesIO()
    small = {"lossless": True, "quality": EFFORT, "method": 6}
    first.save(file, "webp", save_all=True, append_images=rest, duration=lengths, loop=0, **small)
    return file.getvalue()


def work(options: Films) -> None:
    """Write the films and print their paths."""
    for name in options.names:
        choice("film", name, list(FILMS))
    for name in options.names:
        path = options.out / f"{name}.webp"
        write_file(path, film(FILMS[name]))
        print(f"{path} ({path.stat().st_size / 1000:.0f} kB)", flush=True)


if __name__ == "__main__":
    run_command("films", Films, work)
