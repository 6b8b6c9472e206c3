"""Export a policy: `python -m agents.export linear-blind --out DIR` writes ONNX and a C header and checks both.

Checked against the policy on NumPy over 10,000 observations drawn evenly from the observation space; how long one call
takes is printed beside the controller's cycle. What cannot be checked here is said.
"""

import importlib
import time
import timeit
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

from agents.command_line import command_line
from agents.export.c_header import write_header
from agents.export.onnx_graph import write_onnx
from agents.export.replay import CALLS, EPISODES, address, compiled, logged, replay
from agents.policies.policy import ACTIONS, Policy, load_policy
from impact_gym.envs.observation import space
from impact_gym.envs.task import Task

Floats = NDArray[np.float32]
AGREEMENT = 1e-6  # of actions in -1 ... 1
SAME_COMMANDS = 1e-5  # of their range
OBSERVATIONS = 10_000


@dataclass(frozen=True)
class Export:
    """Write a policy as ONNX and as a C header."""

    policy: tyro.conf.Positional[str]
    """Name of a shipped policy, or a file, or a run folder."""
    out: Path
    """Folder for the files."""


@dataclass(frozen=True)
class Implementation:
    """What one implementation of a policy, in NumPy, C or ONNX, computes, and how fast."""

    actions: Floats  # (n, 2)
    seconds: float  # for one call with one observation


def observations(policy: Policy) -> Floats:
    """Return OBSERVATIONS of them, (n, n_obs)."""
    box: Any = space(Task(**policy.environment))
    drawn = np.random.default_rng(0).uniform(box.low, box.high, (OBSERVATIONS, policy.inputs))
    return drawn.astype(np.float32)


def with_numpy(policy: Policy, seen: Floats) -> Implementation:
    """Play the policy itself."""
    return Implementation(policy.predict(seen)[0], _time(lambda: policy.predict(seen[0])))


def with_onnx(policy: Policy, path: Path, seen: Floats) -> Implementation | None:
    """Play the ONNX file with onnxruntime; None where that is missing."""
    try:
        onnxruntime = importlib.import_module("onnxruntime")  # has no types
    except ModuleNotFoundError:
        return None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    (actions,) = session.run(None, {"observation": seen})
    return Implementation(actions, _time(lambda: session.run(None, {"observation": seen[:1]})))


def with_c(policy: Policy, path: Path, seen: Floats) -> Implementation | None:
    """Compile the header and play it; None where there is no C compiler."""
    with TemporaryDirectory() as folder:
        program = compiled(policy, path, Path(folder), program="network.c.jinja")
    if program is None:
        return None
    actions = np.empty((len(seen), ACTIONS), np.float32)
    begun = time.perf_counter()
    program.play(len(seen), address(seen), address(actions))
    return Implementation(actions, (time.perf_counter() - begun) / OBSERVATIONS)


def _time(call: Callable[[], Any]) -> float:
    """Return the median time of a call, s."""
    return float(np.median(timeit.repeat(call, number=1, repeat=1000)))


def export(options: Export) -> list[Path]:
    """Write both files, check them, and return their paths.

    Raises:
        ValueError: no such policy, a package is missing, or a file computes something else than the policy.
    """
    policy = load_policy(options.policy)
    stem, period = Path(options.policy).stem, Task(**policy.environment).control_period
    seen = observations(policy)
    original = with_numpy(policy, seen)
    print(f"a call of the policy on NumPy takes {_beside(original.seconds, period)}")
    paths = [write_header(policy, options.out / f"{stem}.h"), write_onnx(policy, options.out / f"{stem}.onnx")]
    forms = [with_c(policy, paths[0], seen), with_onnx(policy, paths[1], seen)]
    missing = ["no C compiler is here", "the package onnxruntime is missing"]
    _check_controller(policy, paths[0], period)
    for path, form, reason in zip(paths, forms, missing, strict=True):
        if form is None:
            print(f"{path}: not checked, {reason}")
            continue
        difference = float(np.abs(form.actions - original.actions).max())
        if not difference <= AGREEMENT:
            raise ValueError(f"{path} differs from the policy by {difference:.1e}, more than {AGREEMENT:g}")
        print(f"{path}: differs by at most {difference:.1e}; a call takes {_beside(form.seconds, period)}")
    return paths


def _check_controller(policy: Policy, header: Path, period: float) -> None:
    """Play episodes through the controller in C, and say how it compares and how long it takes."""
    found = replay(policy, header, logged(policy))
    if found is None:
        print(f"{header}: its controller is not checked: no C compiler, or a policy that sees what no sensor tells")
        return
    difference = f"{found.difference:.1e}"
    if not found.difference <= SAME_COMMANDS:
        raise ValueError(f"{header} commands otherwise, by {difference} of the range, more than {SAME_COMMANDS:g}")
    print(
        f"{header}: {EPISODES:,} episodes replayed, commands differ by at most {difference} of their range; "
        f"of {CALLS:,} calls 99.9 % take at most {1e6 * found.usual:.1f} us, the worst {1e6 * found.worst:.0f} us, "
        f"where the control period is {1e6 * period:,.0f} us"
    )


def _beside(seconds: float, period: float) -> str:
    """Return the time of a call beside the control period."""
    return f"{1e6 * seconds:.1f} us, 1/{period / seconds:,.0f} of the controller's cycle of {1e3 * period:g} ms"


def main() -> None:
    """Read from the command line what to export, and export it."""
    with command_line("agents.export"):
        export(tyro.cli(Export, prog="python -m agents.export"))


if __name__ == "__main__":
    main()
