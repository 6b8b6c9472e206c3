"""`python -m experiments.loop NAME --out DIR`: export a controller, and let it steer a simulated arm over UDP."""

import json
import multiprocessing
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from agents.evaluate.scenario_batch import ScenarioBatch
from agents.export.c_header import c_text, identifier, write_header
from agents.export.documentation import Exported, of_name
from experiments.loop.arm import MAGIC, SILENCE, serve
from impact_gym.parameters import SI, Options
from impact_gym.support.command_line import run_command
from impact_gym.support.files import write_file

SEED = 8_000_000  # seed of the first approach


@dataclass(frozen=True)
class Loop(Options):
    """Export a controller to C, and let it steer a simulated arm in another process at 1 kHz, over UDP."""

    controller: tyro.conf.Positional[str]
    """Name of a policy or baseline, or its file, as for impact-gym export."""
    out: Path
    """Folder for the header, the loop in C, the compiled program, and the measurements."""
    seconds: Annotated[float, SI("s", above=0, at_most=900)] = 60.0
    """Duration, s. An approach that begins within this time is played to its end."""
    time_weight: Annotated[float, SI("m/s per s", above=0)] = 2.0
    """Cost of a second of approach, m/s per s."""


def compiled(exported: Exported, name: str, out: Path) -> Path:
    """Write the controller's header and loop.c to `out`, compile both, and return the path of the program.

    ValueError: the controller needs an operator or an input that the arm lacks, or there is no C compiler.
    """
    task, name = exported.task, identifier(name)
    if task.operator or task.range_sensor or task.past_readings or task.alarm != "force":
        raise ValueError(f"{name} needs an operator, a range sensor, past readings or an alarm from readings. "
                         "The arm of this loop has none of these: name another controller")  # fmt: skip
    if (compiler := shutil.which("cc") or shutil.which("gcc")) is None:
        raise ValueError("the loop needs a C compiler: install cc or gcc")
    write_header(exported, out / f"{name}.h")
    names = {"name": name, "magic": MAGIC.decode(), "silence": SILENCE, "cycle": task.control_period,
             "top": task.acceleration_range[1]}  # fmt: skip
    source = write_file(out / "loop.c", c_text("loop.c.jinja", Path(__file__).parent, **names))
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, str(source), "-lm", "-o", str(out / "loop")], check=True)
    return out / "loop"


def measured(exported: Exported, weight: float, played: list[Mapping[str, Any]]) -> dict[str, float]:
    """Return statistics of the commands' ages (s), mean V_p (m/s), and mean V_p in the same scenarios without UDP."""
    ages, velocity = (np.hstack([each[name] for each in played]) for name in ("ages", "object_velocity"))
    batch = ScenarioBatch(SEED, len(played), exported.task.changed({"time_weight": weight}))
    there = batch.play(exported.at(weight)).object_velocity.mean()
    figures = {"approaches": len(played), "age_median": np.median(ages), "age_99": np.quantile(ages, 0.99),
               "age_most": ages.max(), "object_velocity": velocity.mean(), "environment": there}  # fmt: skip
    return {name: float(value) for name, value in figures.items()}


def run(options: Loop) -> None:
    """Run the loop, print and write measurements; RuntimeError: the arm or the controller stopped early."""
    exported = of_name(options.controller)
    program = compiled(exported, Path(options.controller).stem, options.out)
    written = options.out / "arm.json"
    written.unlink(missing_ok=True)
    ours, theirs = multiprocessing.Pipe(duplex=False)
    arguments = exported.task.arguments(), options.time_weight, SEED, options.seconds, written, theirs, SILENCE
    arm = multiprocessing.get_context("spawn").Process(target=serve, args=arguments)
    arm.start()
    theirs.close()
    controller = subprocess.run([program, str(ours.recv())], capture_output=True, text=True, check=False)
    arm.join()
    played = json.loads(written.read_text()) if written.is_file() else []
    if controller.returncode or not played or played[-1]["stop"]:
        raise RuntimeError(controller.stderr.strip() or "the watchdog stopped the arm, or the controller or arm failed")
    found = json.loads(controller.stdout) | measured(exported, options.time_weight, played)
    print(write_file(options.out / "loop.json", json.dumps(found, indent=2) + "\n"))
    print("V_p: mean {object_velocity:.4f} m/s; environment: {environment:.4f} m/s".format(**found))


if __name__ == "__main__":
    run_command("loop", Loop, run)
