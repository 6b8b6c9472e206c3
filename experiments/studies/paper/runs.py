"""The paper's model and wrong models, which change every scene and motion; simulated runs, and their pictures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure as Sheet
from numpy.typing import NDArray

import impact_gym as ig
from experiments.lab.parts import Picture
from experiments.lab.scenes import DURATION, MOTION, OBJECT_MASS, ROBOT, TOOL_MASS
from impact_gym.physics import impact
from impact_gym.render.palette import FLANGE, FORCE, OBJECT, PERSON, TOOL

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Model:
    """A model that simulates the scenes of this study after a change of scene and motion."""

    scene: Callable[[ig.Scene], ig.Scene] = lambda scene: scene
    motion: Callable[[ig.Trapezoid], ig.Trapezoid] = lambda motion: motion

    def trace(
        self, scene: ig.Scene, motion: ig.Trapezoid = MOTION, duration: float = DURATION
    ) -> tuple[ig.Outcome, ig.Trace]:
        """Simulate one approach for `duration` (s); return outcome and time histories."""
        outcome = ig.simulate(self.scene(scene), self.motion(motion), duration, trace=True)
        assert outcome.trace is not None
        return outcome, outcome.trace

    def simulate(self, scene: ig.Scene, motion: ig.Trapezoid = MOTION, duration: float = DURATION) -> ig.Outcome:
        """Simulate one approach for `duration` (s)."""
        return ig.simulate(self.scene(scene), self.motion(motion), duration)

    def sweep(self, scene: ig.Scene, varied: Mapping[str, Any], duration: float) -> ig.Outcomes:
        """Simulate approaches for `duration` (s) that differ in the numbers of `varied`."""
        return ig.sweep(self.scene(scene), self.motion(MOTION), varied, duration)


PAPER = Model()


def _with(name: str, new: Any = None, only: type[Any] = object, **fields: Any) -> Model:
    """Return a model with a new part of the scene, or new fields of the part, if the part has the type `only`."""

    def changed(scene: ig.Scene) -> ig.Scene:
        part: Any = getattr(scene, name)
        parts: dict[str, Any] = {name: replace(part, **fields) if fields else new} if isinstance(part, only) else {}
        return replace(scene, **parts)

    return Model(changed)


WRONG = {
    "damping of Hunt and Crossley": _with("contact", dissipation="hunt-crossley"),
    "linear damper (n = 0)": _with("contact", dissipation="exact", damping_exponent=0.0),
    "linear spring (m = 1)": _with("contact", stiffness_exponent=1.0),
    "elastic contact (e = 1)": _with("contact", restitution=1.0),
    "e has no effect (0.1)": _with("contact", restitution=0.1),
    "k_c has no effect (1e4)": _with("contact", stiffness=1e4),
    "soft contact (10)": _with("contact", stiffness=10.0),
    "tool 4 times as heavy": _with("tool", mass=4.0 * TOOL_MASS),
    "no brake": Model(motion=lambda motion: replace(motion, brake=None)),
    "half the speed": Model(motion=lambda motion: replace(motion, speed=0.5 * motion.speed)),
    "rigid robot": _with("robot"),
    "robot 10 times as soft": _with("robot", only=ig.Robot, stiffness=0.1 * ROBOT.stiffness),
    "fixed tool": _with("coupling", ig.Rigid()),
    "spring nearly undamped": _with("coupling", only=ig.SpringDamper, damping_ratio=0.02),
    "mechanism for a spring": _with("coupling", ig.Bistable(), only=ig.SpringDamper),
    "spring for a mechanism": _with("coupling", ig.SpringDamper(50.0), only=ig.Bistable),
}  # by name; stiffnesses of the contact in N/m^1.5


def where(frame: pl.DataFrame, **values: float | str) -> dict[str, NDArray[Any]]:
    """Return the columns, by name, of the rows that have these `values`."""
    return {column.name: column.to_numpy() for column in (frame.filter(**values) if values else frame)}


def histories(model: Model, cases: Mapping[str, ig.Scene], motion: ig.Trapezoid = MOTION) -> pl.DataFrame:
    """Simulate scenes; return a table of traces with `case`, `contact` and `impulse`, see `Run`."""
    parts = []
    for case, scene in cases.items():
        outcome, trace = model.trace(scene, motion)
        number = np.zeros_like(trace.time)
        for count, contact in enumerate(outcome.contacts, start=1):
            end = np.inf if contact.end is None else contact.end
            number[(trace.time >= contact.start) & (trace.time <= end)] = count
        constants = {"case": case, "impulse": outcome.coupling_impulse}
        parts.append(pl.DataFrame({**trace._asdict(), "contact": number, **constants}))
    return pl.concat(parts)


class Run:
    """One case in a table of `histories`: the trace of the case, and numbers that describe the case."""

    def __init__(self, frame: pl.DataFrame, case: str) -> None:
        rows = where(frame, case=case)
        self.trace = ig.Trace(*(rows[name] for name in ig.Trace._fields))
        self.contact = rows["contact"]  # number of the current contact, 0 in flight
        self.first_contact = first = self.part(self.contact == 1)
        self.during_contact = during = self.part(self.contact > 0)
        self.impulse = rows["impulse"][-1]  # N s, impulse of the coupling (eq. 21)
        self.final_velocity = self.trace.object_velocity[-1]  # m/s, V_p
        self.impact_velocity = first.tool_velocity[0]  # m/s, velocity of the tool at the first touch
        self.duration = 1e3 * np.ptp(first.time)  # ms, duration of the first contact
        self.deceleration = (during.contact_force - during.coupling_force).max() / TOOL_MASS  # m/s^2; paper, eq. 17
        rate = first.tool_velocity - first.object_velocity
        self.restitution = -rate[-1] / rate[0]  # of the first contact
        behind = first.command_position - first.tool_position
        self.deflection = 1e3 * (behind.max() - behind[0])  # mm, how far the contact pushes the tool behind the command
        self.way = 1e3 * np.ptp(first.command_position)  # mm, length of the commanded motion during the first contact

    def part(self, rows: NDArray[np.bool_]) -> ig.Trace:
        """Return the points of the trace at which `rows` is true."""
        return ig.Trace(*(column[rows] for column in self.trace))

    def equation_22(self, restitution: float) -> float:
        """Return V_p (m/s) by eq. 22, from a restitution and the simulated impulse of the coupling."""
        at_rest = float(self.first_contact.object_velocity[0])
        masses = TOOL_MASS, OBJECT_MASS
        return float(impact.free_tool(*masses, self.impact_velocity, at_rest, restitution, self.impulse)[1])


def runs_of(frame: pl.DataFrame) -> tuple[Run, Run]:
    """Return the runs of the cases "a" and "b"."""
    return Run(frame, "a"), Run(frame, "b")


def picture(name: str, sheet: Sheet, caption: str, alternative: str) -> Picture:
    """Return a figure as a part of the page."""
    return Picture(name, sheet, alternative, caption, f"Fig. {int(name[-2:])}", wide=False)


def two_runs(frame: pl.DataFrame, name: str, titles: tuple[str, str], common: str, forces: bool) -> Picture:
    """Draw the velocities of the cases "a" and "b" over time, and the `forces` below around the contact."""
    sheet, runs = Sheet(figsize=(8.32, 5.12 if forces else 3.2)), runs_of(frame)
    axes = np.ravel(sheet.subplots(ncols=2, nrows=1 + forces, sharex=True, sharey="row"))
    for upper, run, title in zip(axes, runs, titles, strict=False):
        trace = run.trace
        robot = trace.flange_velocity if forces else trace.command_velocity
        upper.plot(trace.time, robot, "--", color=FLANGE, label="flange" if forces else "imposed")
        upper.plot(trace.time, trace.tool_velocity, color=TOOL, label="tool")
        upper.plot(trace.time, trace.object_velocity, color=OBJECT, label="object")
        upper.set(title=title, ylabel="velocity (m/s)", xlim=(0.25, 0.75) if forces else (0.0, 0.6))
    for lower, run in zip(axes[2:], runs, strict=False):
        lower.plot(run.trace.time, run.trace.contact_force, color=FORCE, label="contact force on the object")
        lower.plot(run.trace.time, run.trace.coupling_force, color=PERSON, label="force of the coupling on the tool")
        lower.set(ylabel="force (N)")
        lower.set_ylim(top=1.15 * max(each.trace.contact_force.max() for each in runs))  # the stop exceeds it
    for panel in axes:
        panel.set(xlabel="time (s)")
        panel.legend(fontsize=8)
    what = f"Velocities{' and forces' if forces else ''} over time"
    ends = (
        f"{title}: the object leaves at {run.final_velocity:.2f} m/s" for title, run in zip(titles, runs, strict=True)
    )
    return picture(name, sheet, f"{what}; {common}.", f"{what}, in two columns. {'; '.join(ends)}.")
