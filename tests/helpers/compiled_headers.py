"""Many controllers in one shared library, made by one run of the compiler."""

import ctypes
import subprocess
from typing import Any, NamedTuple

import numpy as np

from agents.export.c_header import c_text, has_controller, write_header
from agents.export.replay import LANGUAGES, WARNINGS


class Functions(NamedTuple):
    """The functions of one header, under the names that `agents.export.replay` calls."""

    play: Any
    clocked: Any


def compiled_together(subjects, folder, *how, language="C99"):
    """Return the functions of each of `subjects`, a mapping; a warning of the compiler is an error."""
    text = []
    for place, subject in enumerate(subjects.values()):
        name = f"c{place}"
        text += [f"#define {each} {each}_{place}" for each in ("act", *Functions._fields)]
        text.append(f'#include "{write_header(subject, folder / f"{name}.h")}"')
        text.append(c_text(
            "program.c.jinja", name=name, controlled=has_controller(subject), network=subject.policy,
            fields=len(subject.spec.sensors), inputs=len(subject.spec), actions=subject.actions,
            operator=subject.task.operator,
        ))  # fmt: skip
        text += [f"#undef {each}" for each in ("act", *Functions._fields)]
    library, part = folder / f"{len(subjects)}{language}{''.join(how)}.so", folder / "part.o"
    flags = [*LANGUAGES[language], "-ffp-contract=off", *WARNINGS, *how, "-fPIC", "-D_POSIX_C_SOURCE=199309L"]
    compiler = "g++" if language == "C++17" else "gcc"
    subprocess.run([compiler, *flags, "-c", "-", "-o", part], input="\n".join(text), text=True, check=True)
    subprocess.run([compiler, "-shared", part, "-o", library, "-lm"], check=True)  # see `compiled`
    made = ctypes.CDLL(str(library))
    return {
        key: Functions(*(getattr(made, f"{each}_{place}") for each in Functions._fields))
        for place, key in enumerate(subjects)
    }


def commands_of(program, sensors, weights, late=None, steps=None):
    """Return the commands (steps, rows, 2) of a compiled controller for readings (steps, rows, fields)."""
    commands = np.zeros((*sensors.shape[:2], 2))
    late = np.full(sensors.shape[:2], np.nan) if late is None else late
    steps = np.full(len(weights), len(sensors)) if steps is None else steps
    arrays = np.ascontiguousarray(sensors), np.asarray(steps, np.int32), np.asarray(weights, float), late, commands
    program.play(len(weights), *(array.ctypes for array in arrays))
    return commands
