"""How long compiling takes, in processes of their own with an empty cache and then with a filled one."""

import os
import subprocess
import sys
import tempfile

RIGID, SPRING, BISTABLE = "rigid", "spring and damper", "bistable"
PROGRAM = """
import time
import impact_gym as ig
coupling = {coupling}
scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.2505), ig.Contact(1e5, 0.5), coupling)
motion = ig.Trapezoid(1.0, 8.0, ig.Brake())
begun = time.perf_counter()
ig.simulate(scene, motion)
print(time.perf_counter() - begun)
"""
BY_HAND = """
import time
from experiments.speed_vs_error import by_hand
begun = time.perf_counter()
by_hand.compile_now()
print(time.perf_counter() - begun)
"""
PROGRAMS = {
    f"impact_gym, {RIGID}": PROGRAM.format(coupling="ig.Rigid()"),
    f"impact_gym, {SPRING}": PROGRAM.format(coupling="ig.SpringDamper(50.0)"),
    f"impact_gym, {BISTABLE}": PROGRAM.format(coupling="ig.Bistable()"),
    "by hand": BY_HAND,
}


def measured() -> dict[str, dict[str, float]]:
    """Return seconds of the first call by program: compiled, and loaded from what was compiled before."""
    found: dict[str, dict[str, float]] = {}
    for name, program in PROGRAMS.items():
        with tempfile.TemporaryDirectory() as cache:
            environment = os.environ | {"NUMBA_CACHE_DIR": cache}

            def first_call(program: str = program, environment: dict[str, str] = environment) -> float:
                command = [sys.executable, "-c", program]
                run = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
                return float(run.stdout.split()[-1])

            found[name] = {"compiled_s": first_call(), "loaded_s": first_call()}
    return found
