"""Drive an engine through a case, step by step, and measure the blow.

Each engine has a module here with its PACKAGE, a function `build`, and VARIANTS: the ways to ask it for a restitution.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from math import isfinite, sqrt
from statistics import fmean
from time import process_time
from typing import Any, NamedTuple

from experiments.lab.study import Row
from experiments.reference.command import Command
from experiments.studies.engines.cases import Case
from impact_gym.support.validation import number

Step = Callable[[float], tuple[float, float, float]]
"""Make a step under a push (N) on the tool; return the tool's way from the start (m), its and the object's velocity."""
Build = Callable[[Case, float], Step]
"""Place the bodies of a case, and return the function that advances them by a step of so many seconds."""
DAMPER, CROSSLEY, SAME = (1.0, 0.0), (1.0, 1.0), (1.5, 1.5)  # exponents of penetration and damping, see ig.Contact
PHASES = (0.0, 0.25, 0.5, 0.75)  # of a step, by which the touch of a free tool moves; the measures are means
LONGEST = 5.0  # s, of processor time, that the runs of a cell may take
TOUCHING = 1e-4  # part of the peak force above which a step counts as contact


class Variant(NamedTuple):
    """One way to ask an engine for the restitution of a case."""

    asked: str  # what is asked of the engine
    law: tuple[float, float] | None = None  # exponents of its law; None: velocities jump, or the numbers are defaults
    options: Mapping[str, Any] = {}  # arguments of `build`


def drive(case: Case, build: Build, step: float) -> dict[str, float]:
    """Return the measures of a case at a step (s), SI.

    The contact force of a step is the object's change of momentum divided by the step, in every engine. The energy that
    the law would not have is relative to that of the approach. `momentum_error` is relative to the impulse of the
    answer, `seconds` is processor time per simulated second, this loop included. `spread` is the range of `delivered`.
    """
    number("step", step, "s", above=0.0)
    build(case, step)(0.0)  # the first step of an engine may compile
    phases = (0.0,) if case.spring else PHASES
    runs = [_run(replace(case, distance=case.distance + each * case.speed * step), build, step) for each in phases]
    found = {name: fmean(run[name] for run in runs) for name in runs[0]}
    if not case.spring:
        found["spread"] = max(run["delivered"] for run in runs) - min(run["delivered"] for run in runs)
    return found


def _run(case: Case, build: Build, step: float) -> dict[str, float]:
    advance, command, count = build(case, step), Command(case.motion), round(case.duration / step)
    m_t, m_p, k = case.tool_mass, case.object_mass, case.spring or 0.0
    x, v, v_p, pushed, push, forces = 0.0, case.start_speed, 0.0, 0.0, 0.0, list[float]()
    c, begun = 2.0 * sqrt(k * m_t), process_time()
    for i in range(count):
        if k:  # implicit midpoint rule: the force of the spring at the middle of a step without contact
            x_f, v_f, _, _ = command.at((i + 0.5) * step)
            push = (k * (x_f - x - step / 2 * v) + c * (v_f - v)) / (1 + c * step / (2 * m_t) + k * step**2 / (4 * m_t))
        x, v, after = advance(push)
        force, v_p, pushed = m_p * (after - v_p) / step, after, pushed + push * step
        forces.append(force)
        if force > command.threshold and command.detection_time is None:
            command.detect((i + 1) * step)
        if i == 99 and (whole := (process_time() - begun) * count / 100 * (1 if k else len(PHASES))) > LONGEST:
            raise TimeoutError(f"would take {whole:.0f} s of processor time, more than {LONGEST:.0f} s")
    took, peak, energy = process_time() - begun, max(forces), m_t * case.start_speed**2 / 2
    found = {"object_velocity": v_p, "impulse": m_p * v_p, "peak_force": peak, "seconds": took / case.duration}
    found["duration"] = step * sum(force > TOUCHING * peak for force in forces)
    found["momentum_error"] = abs(m_t * (v - case.start_speed) + m_p * v_p - pushed) / case.answers["impulse"]
    if not k:
        lost = case.reduced_mass * case.speed**2 / 2 * (1 - case.restitution**2)
        found["delivered"] = (v_p - v) / case.speed
        found["energy"] = (m_t * v * v / 2 + m_p * v_p * v_p / 2 - energy + lost) / energy
    return found


def engine(name: str) -> tuple[Any, str]:
    """Return the module of an engine, here or with a dot in its name, and its package's version ("": none)."""
    module = import_module(name if "." in name else f"{__package__}.{name}")
    try:
        return module, version(module.PACKAGE)
    except PackageNotFoundError:
        return module, ""


def measured(name: str, variant: str, case: Mapping[str, Any], step: float | None, installed: str) -> list[Row]:
    """Return the row of a cell: the measures of `drive`, and numbers relative to the law's.

    Without a step, the cell is the exact solution by impact_gym. `off` is the relative error of V_p, `peak` the ratio
    of the peak forces; `peak_law` compares the peak force of a free tool with that of the engine's own law.
    """
    module, _ = engine(name)
    if not installed:
        raise ModuleNotFoundError(f"not installed: pip install {module.PACKAGE}")
    blow, way = Case(**case), module.VARIANTS.get(variant, Variant("", SAME))
    if step is None:
        blow.solved()  # the first call loads tables
        begun, found = process_time(), blow.solved(rtol=1e-11)
        found |= {"seconds": (process_time() - begun) / blow.duration, "duration": found["contact_duration"]}
        if not blow.spring:
            found["delivered"] = found["impulse"] / blow.reduced_mass / blow.speed - 1.0
    else:
        found = drive(blow, lambda case, step: module.build(case, step, **way.options), step)
    if not all(map(isfinite, found.values())):
        raise ArithmeticError("a measure is not finite")
    found["off"] = found["object_velocity"] / blow.answers["object_velocity"] - 1.0
    if blow.answers["peak_force"]:
        found["peak"] = found["peak_force"] / blow.answers["peak_force"]
    if way.law and not blow.spring:
        found["peak_law"] = found["peak_force"] / blow.solved(exponents=way.law)["peak_force"]
    return [found]
