"""The exported controller played again: episodes of the environment through the compiled header, call by call."""

import ctypes
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from impact_gym.kernels import UNIFORMS
from numpy.typing import NDArray

from agents.export.c_header import controller, identifier
from agents.policies.policy import ACTIONS, Policy
from impact_gym.envs.batch import Batch
from impact_gym.envs.records import DRAWS
from impact_gym.envs.task import COMMAND_RESOLUTION, Task

Floats = NDArray[np.float64]
EPISODES, CALLS = 10_000, 1_000_000
SEED = 7_000_000  # of the episodes
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic", "-Werror"]
LANGUAGES = {"C99": ["-x", "c", "-std=c99"], "C++17": ["-x", "c++", "-std=c++17"]}


class Log(NamedTuple):
    """What the controller was told and what it commanded, step by step."""

    sensors: Floats  # (steps, rows, fields), SI units
    commands: Floats  # (steps, rows, 2), m/s and m/s^2
    steps: NDArray[np.int64]  # (rows,), of each episode
    time_weight: Floats  # (rows,)


class Replay(NamedTuple):
    """How the compiled controller compares."""

    difference: float  # largest, of commands over their range
    usual: float  # s, what 99.9 % of the calls take at the most
    worst: float  # s


def logged(policy: Policy, episodes: int = EPISODES) -> Log:
    """Play episodes of the policy's own environment."""
    task = Task(**policy.environment)
    batch = Batch(episodes, task)
    uniforms = np.random.default_rng(SEED).random((episodes, DRAWS)).view(UNIFORMS)[:, 0]
    free = np.full((episodes, batch.episodes["drawn"].dtype.itemsize // 8), np.nan).view(batch.episodes["drawn"].dtype)
    batch.begin(np.arange(episodes), uniforms, free[:, 0])
    low, high = np.array([task.velocity_range, task.acceleration_range]).T
    ended, start, state = np.zeros(episodes, np.bool_), np.ones(episodes, np.bool_), None
    steps, sensors, commands = np.zeros(episodes, np.int64), [], []
    while not ended.all():
        sensors.append(np.stack(list(batch.sensors().values()), axis=-1))
        actions, state = policy.predict(batch.observations.copy(), state=state, episode_start=start)
        share = 0.5 * (np.clip(actions.astype(np.float64), -1.0, 1.0) + 1.0)
        commands.append(np.rint((low + share * (high - low)) / COMMAND_RESOLUTION) * COMMAND_RESOLUTION)
        steps += ~ended
        batch.step(batch.commands(actions, (episodes, ACTIONS)), ended)
        ended = (batch.episodes["terminated"] == 1) | (batch.episodes["truncated"] == 1)
        start = np.zeros(episodes, np.bool_)
    return Log(np.array(sensors), np.array(commands), steps, batch.episodes["drawn"]["time_weight"].copy())


def source(header: str, name: str, fields: int) -> str:
    """Return a program that plays a log through the controller of `header`, and times calls of it."""
    return f"""
#ifdef __cplusplus
extern "C"
#endif
void play(int rows, const double *sensors, const int *steps, const double *weights, double *commands);
#ifdef __cplusplus
extern "C"
#endif
void clocked(int rows, const double *sensors, const int *steps, const double *weights, int calls, double *seconds);
#define _POSIX_C_SOURCE 199309L
#include <string.h>
#include <time.h>
#include "{header}"
void play(int rows, const double *sensors, const int *steps, const double *weights, double *commands)
{{
    for (int row = 0; row < rows; row++) {{
        {name}_state state;
        {name}_reset(&state, weights[row]);
        for (int step = 0; step < steps[row]; step++) {{
            int at = step * rows + row;
            {name}_sensors now;
            {name}_command command;
            memcpy(&now, sensors + at * {fields}, sizeof now);
            {name}_step(&state, &now, &command);
            commands[2 * at] = command.velocity;
            commands[2 * at + 1] = command.acceleration;
        }}
    }}
}}
void clocked(int rows, const double *sensors, const int *steps, const double *weights, int calls, double *seconds)
{{
    {name}_state state;
    int row = 0, step = 0;
    volatile double sink = 0.0;
    for (int call = 0; call < calls; call++) {{
        struct timespec begun, ended;
        {name}_sensors now;
        {name}_command command;
        if (step == 0) {name}_reset(&state, weights[row]);
        memcpy(&now, sensors + (step * rows + row) * {fields}, sizeof now);
        clock_gettime(CLOCK_MONOTONIC, &begun);
        {name}_step(&state, &now, &command);
        clock_gettime(CLOCK_MONOTONIC, &ended);
        sink = command.velocity;
        seconds[call] = (double)(ended.tv_sec - begun.tv_sec) + 1e-9 * (double)(ended.tv_nsec - begun.tv_nsec);
        if (++step == steps[row]) {{ step = 0; row = (row + 1) % rows; }}
    }}
    (void)sink;
}}
"""


def compiled(policy: Policy, header: Path, folder: Path, language: str = "C99") -> ctypes.CDLL | None:
    """Compile that program without a warning; None where there is no compiler.

    Raises:
        CalledProcessError: the compiler warned, or worse.
    """
    compiler = shutil.which("g++" if language == "C++17" else "gcc") or shutil.which("cc")
    if compiler is None:
        return None
    fields = len(Batch(1, Task(**policy.environment)).sensors())
    library = folder / f"{header.stem}-{len(language)}.so"
    flags = [*LANGUAGES[language], "-O2", "-ffp-contract=off", *WARNINGS, "-shared", "-fPIC", "-"]
    command = [compiler, *flags, "-I", str(header.parent.resolve()), "-o", str(library), "-lm"]
    subprocess.run(command, input=source(header.name, identifier(header.stem), fields), text=True, check=True)
    return ctypes.CDLL(str(library))


def address(array: NDArray[Any]) -> ctypes.c_void_p:
    """Where the numbers of a contiguous array lie, for C."""
    return array.ctypes.data_as(ctypes.c_void_p)


def replay(policy: Policy, header: Path, log: Log, calls: int = CALLS) -> Replay | None:
    """Play a log through the header; None where it holds no controller, or there is no compiler."""
    if not controller(policy, "any"):
        return None
    with TemporaryDirectory() as folder:
        program = compiled(policy, header, Path(folder))
        if program is None:
            return None
        steps = log.steps.astype(np.int32)
        commands, seconds = np.zeros_like(log.commands), np.zeros(calls)
        told = [address(one) for one in (log.sensors, steps, log.time_weight)]
        program.play(len(steps), *told, address(commands))
        program.clocked(len(steps), *told, calls, address(seconds))
    task = Task(**policy.environment)
    span = np.diff([task.velocity_range, task.acceleration_range])[:, 0]
    played = np.arange(len(commands))[:, None] < steps
    difference = np.abs((commands - log.commands) / span)[played].max()
    return Replay(float(difference), float(np.quantile(seconds, 0.999)), float(seconds.max()))
