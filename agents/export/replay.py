"""Check an exported header: compile it, and let the compiled controller replay episodes."""

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.export.c_header import c_text, has_controller, identifier
from agents.export.documentation import Exported
from impact_gym.envs.batch import Batch

Floats = NDArray[np.float64]
SEED = 7_000_000  # seed of the random numbers of the episodes
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic", "-Werror"]
LANGUAGES = {"C99": ["-x", "c", "-std=c99"], "C++17": ["-x", "c++", "-std=c++17"]}


class Log(NamedTuple):
    """Sensors and commands of episodes, step by step; a row is an episode."""

    sensors: Floats  # (steps, rows, fields), readings in SI units
    commands: Floats  # (steps, rows, 2), velocity (m/s), acceleration (m/s^2); with an operator, at the step's end
    late: Floats  # (steps, rows), m/s, an operator's command that arrived within the step; nan: none
    steps: NDArray[np.int64]  # (rows,), number of steps of each episode
    time_weight: Floats  # (rows,), m/s per s


def logged(exported: Exported, episodes: int) -> Log:
    """Play episodes and return the log. The time weights of a rule are drawn from a range wider than the tuned one."""
    task = exported.task
    if exported.policy is None:
        task = task.changed({"time_weight": (0.8 * exported.weights[0], 1.25 * exported.weights[-1])})
    batch = Batch(episodes, task)
    batch.begin(np.arange(episodes), [np.random.default_rng(SEED)] * episodes)
    controller, state, start = exported.at(batch.info()["time_weight"]), None, np.ones(episodes, np.bool_)
    spec = task.action
    steps, sensors, commands, late = np.zeros(episodes, np.int64), [], [], []
    while not (ended := batch.ended).all():
        now = batch.sensors()
        sensors.append(np.stack(list(now.values()), axis=-1))
        actions, state = controller.predict(batch.observations, state, start)
        start = np.zeros(episodes, np.bool_)
        command = spec.decode(actions)
        steps += ~ended
        begun = np.where(batch.links["expired"], 0.0, now["command"]) if task.operator else np.zeros(episodes)
        obeyed = begun
        batch.step(actions, ended)
        if task.operator:
            obeyed, executed = (batch.step_columns()[name][:, 0] for name in ("teleop_action", "intervene_action"))
            stop = np.where(obeyed == 0.0, task.acceleration_range[1], command[:, 1])
            command = np.stack([executed, stop], axis=-1)
        commands.append(command)
        late.append(np.where(obeyed == begun, np.nan, obeyed))
    return Log(np.array(sensors), np.array(commands), np.array(late), steps, batch.info()["time_weight"])


def compiled(exported: Exported, header: Path, folder: Path, *how: str, language: str = "C99") -> ctypes.CDLL | None:
    """Compile program.c.jinja and the header with the compiler flags `how`; None: there is no compiler."""
    compiler = shutil.which("g++" if language == "C++17" else "gcc") or shutil.which("cc")
    if compiler is None:
        return None
    source = c_text(
        "program.c.jinja", name=identifier(header.stem), controlled=has_controller(exported), network=exported.policy,
        fields=len(exported.spec.sensors), inputs=len(exported.spec), actions=exported.actions,
        operator=exported.task.operator,
    )  # fmt: skip
    library = folder / f"policy-{language}{''.join(how)}.so"
    flags = [*LANGUAGES[language], "-O2", "-ffp-contract=off", *WARNINGS, *how, "-fPIC", "-"]
    included = ["-D_POSIX_C_SOURCE=199309L", "-include", str(header.resolve())]
    made = ["-c", "-o", str(library.with_suffix(".o"))]
    subprocess.run([compiler, *flags, *included, *made], input=source, text=True, check=True)
    # linked without flags: with -Ofast, the linked code would make this process round subnormals to 0
    subprocess.run([compiler, "-shared", str(library.with_suffix(".o")), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def replay(exported: Exported, program: ctypes.CDLL, log: Log, calls: int) -> tuple[float, Floats]:
    """Replay a log; return the largest error of a command (fraction of the range), and times (s) of `calls` calls."""
    steps = log.steps.astype(np.int32)
    commands, seconds = np.zeros_like(log.commands), np.zeros(calls)
    arrays = log.sensors.ctypes, steps.ctypes, log.time_weight.ctypes
    program.play(len(steps), *arrays, log.late.ctypes, commands.ctypes)
    program.clocked(len(steps), *arrays, calls, seconds.ctypes)
    task = exported.task
    span = np.ptp([task.velocity_range, task.acceleration_range], axis=1)
    played = np.arange(len(commands))[:, None] < steps
    return float(np.abs((commands - log.commands) / span)[played].max()), seconds
