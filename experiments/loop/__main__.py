"""`python -m experiments.loop NAME --out DIR`: export a controller, compile its loop, and play it at 1 kHz."""

import json
import multiprocessing
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from agents.command_line import run_command
from agents.evaluate import evaluate
from agents.export.c_header import c_text, identifier, write_header
from agents.export.contract import Subject, of_name
from agents.setups import load_setup
from experiments.loop import MAGIC, PERIOD, SILENCE
from experiments.loop.arm import serve
from experiments.loop.faults import CHANGES, DELAY, Wire
from impact_gym.envs.batch import Batch
from impact_gym.files import write_file
from impact_gym.validation import number

KILLED = ("kill the controller", "kill the arm")
SEED = 8_000_000  # of the first approach
LATEST = 0.02  # s, that a busy machine may add


@dataclass(frozen=True)
class Loop:
    """Play an exported controller at 1 kHz beside a simulated arm in another process, over UDP."""

    controller: tyro.conf.Positional[str]
    """Name of a policy or baseline, or its file, as for export."""
    out: Path
    """Folder for the header, the loop in C, its program, and what was measured."""
    setup: str | None = None
    """Set-up of a rule without tuning."""
    seconds: float = 60.0
    """How long approaches are begun."""
    time_weight: float = 2.0
    """What a second of approach costs, m/s per s."""
    faults: bool = False
    """Inject faults instead, one after the other, and say how soon the arm stops."""

    def __post_init__(self) -> None:
        number("seconds", self.seconds, "s", above=0.0, at_most=900.0)
        number("time_weight", self.time_weight, "m/s per s", above=0.0)


def compiled(subject: Subject, name: str, out: Path) -> Path:
    """Write header and loop.c to `out`, compile them, and return the program.

    Raises:
        ValueError: the arm of this loop lacks what the controller needs, or there is no C compiler.
    """
    task = subject.task
    if task.operator or task.range_sensor or task.past_readings or task.alarm != "force":
        raise ValueError(f"{name} needs an operator, a range sensor, past readings or an alarm by readings: "
                         "the arm of this loop has none")  # fmt: skip
    if (compiler := shutil.which("cc") or shutil.which("gcc")) is None:
        raise ValueError("the loop needs a C compiler: there is no cc and no gcc")
    write_header(subject, out / f"{identifier(name)}.h")
    words = {"name": identifier(name), "cycle": task.control_period, "top": task.acceleration_range[1]}
    text = c_text("loop.c.jinja", Path(__file__).parent, magic=MAGIC.decode(), silence=SILENCE, **words)
    source = write_file(out / "loop.c", text)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, str(source), "-lm", "-o", str(out / "loop")], check=True)
    return out / "loop"


def play(program: Path, subject: Subject, options: Loop, fault: str = "") -> dict[str, Any]:
    """Run controller and arm, with a fault or without one, and return what both have said."""
    told, started = multiprocessing.Pipe(duplex=False)
    with tempfile.TemporaryDirectory() as folder:
        written, wire = Path(folder) / "arm.json", None
        seconds = 2.0 if fault else options.seconds
        given = dict(subject.task.arguments()), options.time_weight, SEED, seconds, written, started
        arm = multiprocessing.get_context("spawn").Process(target=serve, args=given)
        arm.start()
        port = told.recv()
        if fault:
            wire = Wire(port, CHANGES.get(fault), DELAY if fault == "delay" else 0.0)
            wire.start()
        loop = subprocess.Popen([program, str(wire.port if wire else port)], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)  # fmt: skip
        if wire:
            wire.act = {KILLED[0]: loop.kill, KILLED[1]: arm.kill}.get(fault, wire.act)
        arm.join()
        printed, errors = loop.communicate(timeout=10.0)
        ended = time.monotonic()
        if wire:
            wire.closed.set()
        played = json.loads(written.read_text()) if written.is_file() else []
    return {"played": played, "timing": json.loads(printed or "{}"), "errors": errors.strip(), "ended": ended,
            "failed_at": wire.failed_at if wire else 0.0, "status": loop.returncode}  # fmt: skip


def in_lockstep(subject: Subject, weight: float, count: int, late: int) -> NDArray[np.float64]:
    """Return V_p (m/s) of approaches at 1 kHz without clocks, where a command acts `late` periods after its reading."""
    task = subject.task.changed({"control_period": PERIOD, "time_weight": weight})
    batch, controller = Batch(count, task), subject.at(np.full(count, weight))
    batch.begin_seeded(SEED, {"time_weight": weight})
    standing = np.tile(batch.action_spec.encode(0.0, task.acceleration_range[1]), (count, 1))
    due, heard, queue = np.full(count, -1.0), np.zeros(count, np.bool_), [standing] * late
    while not (ended := batch.ended).all():
        now = batch.sensors()
        alarm = (now["alarm"] > 0.5) & ~heard
        call = alarm | (now["time"] > due - 1e-6)
        grid = np.where(alarm | (due < 0.0), now["time"], due) + subject.task.control_period
        due, heard = np.where(call, grid, due), heard | alarm
        standing = np.where(call[:, None], controller.predict(batch.observations)[0], standing)
        queue.append(standing)
        batch.step(queue.pop(0), ended)
    return np.asarray(batch.info()["object_velocity"])


def measured(subject: Subject, options: Loop, run: Mapping[str, Any]) -> dict[str, float]:
    """Return figures of a run: its timing (s), and V_p (m/s) beside the environment's in the same scenarios.

    Raises:
        RuntimeError: the arm was stopped, or played no approach.
    """
    played, weight = run["played"], options.time_weight
    if not played or played[-1]["stop"]:
        why = played[-1]["stop"]["why"] if played else "no controller said hello"
        raise RuntimeError(f"the arm stopped: {why}; {run['errors'] or 'the controller says nothing'}")
    ages = np.concatenate([each["ages"] for each in played])
    velocity = np.array([each["object_velocity"] for each in played])
    arguments = {**subject.task.arguments(), "scenario": subject.task.scenario, "time_weight": weight}
    there = evaluate(subject.at(weight), SEED, len(played), **arguments).object_velocity
    late = round(float(np.median(ages)) / PERIOD)
    delayed = in_lockstep(subject, weight, len(played), late)
    return run["timing"] | {
        "approaches": len(played), "age_median": float(np.median(ages)), "age_99": float(np.quantile(ages, 0.99)),
        "age_most": float(ages.max()), "arm_late_99": float(np.quantile([t for each in played for t in each["late"]], 0.99)),
        "object_velocity": float(velocity.mean()), "environment": float(there.mean()), "late": late,
        "environment_late": float(delayed.mean()), "difference": float(velocity.mean() / there.mean() - 1.0),
    }  # fmt: skip


def judged(fault: str, run: Mapping[str, Any], top: float) -> str:
    """Return a sentence on how soon a fault stopped the arm, whose deceleration is `top` (m/s^2).

    Raises:
        RuntimeError: it did not stop, or not in time.
    """
    if fault == KILLED[1]:
        after, why = run["ended"] - run["failed_at"], run["errors"]
        if run["status"] != 3:
            raise RuntimeError(f"{fault}: the controller ended with {run['status']} and said {why!r}")
        return f"{fault}: the controller said after {after:.3f} s: {why}"
    stop = run["played"][-1]["stop"] if run["played"] else None
    if stop is None or "rest" not in stop:
        raise RuntimeError(f"{fault}: the arm did not stop")
    after, braking = stop["at"] - run["failed_at"], stop["rest"] - stop["at"]
    if after > SILENCE + LATEST or braking > abs(stop["velocity"]) / top + LATEST:
        raise RuntimeError(f"{fault}: the arm braked after {after:.3f} s, and for {braking:.3f} s")
    return f"{fault}: braked after {after:.3f} s from {stop['velocity']:.2f} m/s, at rest {braking:.3f} s later: {stop['why']}"


def run(options: Loop) -> None:
    """Play, print and keep what was measured; or inject each fault.

    Raises:
        RuntimeError: the arm stopped without a fault, or did not stop with one.
    """
    subject = of_name(options.controller, load_setup(options.setup) if options.setup else None)
    program = compiled(subject, Path(options.controller).stem, options.out)
    if options.faults:
        for fault in (*KILLED, *CHANGES):
            print(judged(fault, play(program, subject, options, fault), subject.task.acceleration_range[1]), flush=True)
        return
    found = measured(subject, options, play(program, subject, options))
    write_file(options.out / "loop.json", json.dumps(found, indent=2) + "\n")
    ms = {name: f"{1e3 * found[name]:.3f}" for name in found if name.startswith(("error_", "age_", "arm_late"))}
    print(
        f"{found['periods']:,} periods of 1 ms: error {ms['error_median']} ms in the median, 99 % below "
        f"{ms['error_99']} ms, at most {ms['error_most']} ms, {found['missed']} missed; real-time priority: "
        f"{found['real_time']}\nage of the arm's commands: {ms['age_median']} ms in the median, 99 % below "
        f"{ms['age_99']} ms, at most {ms['age_most']} ms\n"
        f"V_p in {found['approaches']} approaches: {found['object_velocity']:.4f} m/s; the environment's "
        f"{found['environment']:.4f} m/s ({100 * found['difference']:+.1f} %), with commands {found['late']} ms late "
        f"{found['environment_late']:.4f} m/s"
    )


if __name__ == "__main__":
    run_command("loop", Loop, run)
