"""Approaches solved by plain.c, and by cvode.c, which calls CVODE (SUNDIALS) in contacts; both are compiled here."""

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from impact_gym.support.archive import checksum

FLAGS = ["-O3", "-g0", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off"]  # as in setup.py
POINTS = 16  # of a span of flight at which plain.c looks for a touch
NEAR = 1e-6  # relative change at which the search for a touch ends before a contact of CVODE
PROGRAMS = [Path(__file__).with_name(f"{name}.c") for name in ("plain", "cvode")]
DIGEST = checksum(*(path.read_bytes() for path in PROGRAMS))


@cache
def program(cvode: bool) -> ctypes.CDLL:
    """Return a compiled program; FileNotFoundError: no C compiler, or no libraries of SUNDIALS."""
    compiler, wheel, links = shutil.which("cc"), find_spec("sksundae") if cvode else None, list[str]()
    if compiler is None:
        raise FileNotFoundError("no C compiler cc")
    if cvode:  # the wheel of scikit-sundae has the libraries
        folder = Path(wheel.origin if wheel and wheel.origin else "/").parent.parent / "scikit_sundae.libs"
        links = [str(path) for name in ("cvode", "core", "nvecserial") for path in folder.glob(f"libsundials_{name}-*")]
        if not links:
            raise FileNotFoundError("not installed: pip install scikit-sundae (wheels for Linux)")
        links.append(f"-Wl,-rpath,{folder}")
    with tempfile.TemporaryDirectory() as out:
        command = [compiler, *FLAGS, "-fPIC", "-shared", str(PROGRAMS[cvode]), "-o", f"{out}/program.so", *links, "-lm"]
        subprocess.run(command, check=True, capture_output=True)
        return ctypes.CDLL(f"{out}/program.so")


def approaches(
    cvode: bool, scene: ig.Scene, motion: ig.Trapezoid, masses: NDArray[np.float64], durations: Any, setting: Any
) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """Return the objects' final velocities (m/s), the counts of contacts, and the processor time (s).

    The approaches differ in the mass of the object (kg) and the duration (s). `setting`: of CVODE the relative
    tolerance; else order, step in the units of a contact, and the relative change at which a search ends.
    """
    coupling, contact, brake = scene.coupling, scene.contact, motion.brake
    if not isinstance(coupling, ig.SpringDamper) or coupling.damping_ratio != 1.0 or brake is None:
        raise NotImplementedError("only critically damped springs and brakes")
    row = [scene.tool.mass, coupling.stiffness, 0.0, scene.object.distance, contact.stiffness, contact.restitution,
           motion.speed, motion.acceleration, brake.threshold, brake.delay, motion.deceleration, 0.0]  # fmt: skip
    rows = np.tile(row, (len(masses), 1))
    rows[:, 2], rows[:, -1] = masses, durations
    velocities, counts, call = np.empty(len(rows)), np.empty(len(rows), np.int64), program(cvode)
    order, step, near = (0, setting, NEAR) if cvode else setting
    begun = thread_time()
    call.approaches(rows.ctypes, ctypes.c_long(len(rows)), ctypes.c_double(step), ctypes.c_int(order), POINTS,
                    ctypes.c_double(near), velocities.ctypes, counts.ctypes)  # fmt: skip
    return velocities, counts, thread_time() - begun
