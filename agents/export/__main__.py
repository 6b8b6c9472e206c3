"""Export controllers: `impact-gym export linear-blind --out DIR` writes a C header, of a policy ONNX, too, and checks.

A network is checked against the policy on NumPy over 10,000 observations drawn evenly from the observation space, a
header in replayed episodes; how long one call takes is printed beside the control period. What cannot be checked here
is said.
"""

import ctypes
import importlib
import timeit
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

from agents.command_line import run_command
from agents.export.c_header import has_controller, write_header
from agents.export.contract import Subject, of_name, of_setup
from agents.export.onnx_graph import write_onnx
from agents.export.replay import Replay, address, compiled, logged, replay
from agents.policies.policy import Policy
from agents.setups import load_setup
from impact_gym.validation import whole

Floats = NDArray[np.float32]
AGREEMENT = 1e-6
"""Difference of actions in -1 ... 1 that is allowed beyond what rounding to float32 makes of the policy itself."""
SAME_COMMANDS = 1e-6  # of their range
OBSERVATIONS = 10_000


@dataclass(frozen=True)
class Export:
    """Write a controller as a C header, and a policy as ONNX, too."""

    controller: tyro.conf.Positional[str]
    """Name of a shipped policy or of a baseline, or the file of one, or a run folder; with --all a set-up. A
    tuned baseline is written for all time weights it was tuned for: the header takes one at reset."""
    out: Path
    """Folder for the files."""
    setup: str | None = None
    """Set-up, by name or file, for which a rule without tuning is written, and whose own baselines have names."""
    all: bool = False
    """Write all controllers of a set-up: its policy, its tuned baselines, and the rules without tuning."""
    folder: Path | None = None
    """With --all: folder with `policies` and `tuned` of the set-up. Default: where train and tune write them."""
    episodes: int = 10_000
    """How many the controller in C replays."""
    calls: int = 1_000_000
    """How many calls of it are timed."""

    def __post_init__(self) -> None:
        for name in ("episodes", "calls"):
            whole(name, getattr(self, name), at_least=1)


class Form(NamedTuple):
    """A policy's actions as a form of it computes them, in C or ONNX, and how fast."""

    actions: Floats  # (n, numbers of an action)
    seconds: float  # for one call with one observation


def observations(policy: Policy) -> Floats:
    """Return OBSERVATIONS of them, (n, n_obs)."""
    drawn = np.random.default_rng(0).uniform(policy.spec.scaled_low, 1.0, (OBSERVATIONS, policy.inputs))
    return drawn.astype(np.float32)


def with_onnx(path: Path, observed: Floats) -> Form | None:
    """Play the ONNX file with onnxruntime; None where that is missing."""
    try:
        onnxruntime = importlib.import_module("onnxruntime")  # has no types
    except ModuleNotFoundError:
        return None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    (actions,) = session.run(None, {"observation": observed})
    return Form(actions, _time(lambda: session.run(None, {"observation": observed[:1]})))


def with_c(program: ctypes.CDLL, observed: Floats, actions: int) -> Form:
    """Play the network of a compiled header, with so many numbers of an action."""
    acted = np.empty((len(observed), actions), np.float32)
    arrays = address(observed), address(acted)
    return Form(acted, timeit.timeit(lambda: program.act(len(observed), *arrays), number=1) / len(observed))


def rounding(policy: Policy, observed: Floats, actions: Floats) -> float:
    """Return the largest difference of the policy's `actions` (n, 2) from its network in double precision."""
    values, network = observed.astype(np.float64), policy.network
    for layer in network.hidden:
        sums = values @ layer.weight.T.astype(np.float64) + layer.bias
        values = np.tanh(sums) if network.activation == "tanh" else np.maximum(sums, 0.0)
    exact = np.clip(values @ network.mean.weight.T.astype(np.float64) + network.mean.bias, -1.0, 1.0)
    return float(np.abs(actions - exact).max())


def _time(call: Callable[[], Any]) -> float:
    """Return the median time of a call, s."""
    return float(np.median(timeit.repeat(call, number=1, repeat=1000)))


def run(options: Export) -> list[Path]:
    """Write the files, check them, and return their paths.

    Raises:
        ValueError: no such controller, a package is missing, or a file computes something else than the controller.
    """
    if options.all:
        found = of_setup(load_setup(options.controller), options.folder)
    else:
        setup = load_setup(options.setup) if options.setup else None
        found = {Path(options.controller).stem: of_name(options.controller, setup)}
    return [path for name, subject in found.items() for path in export(subject, options, name)]


def export(subject: Subject, options: Export, name: str) -> list[Path]:
    """Write and check the files of one controller, and return their paths."""
    period, policy, header = subject.task.control_period, subject.policy, options.out / f"{name}.h"
    write_header(subject, header)
    with TemporaryDirectory() as folder:
        program = compiled(subject, header, Path(folder))
        controller = program if has_controller(subject) else None
        played = replay(subject, controller, logged(subject, options.episodes), options.calls) if controller else None
        print(judged_replay(header, played, period))
        if policy is None:
            return [header]
        observed = observations(policy)
        actions, seconds = policy.predict(observed)[0], _time(lambda: policy.predict(observed[0]))
        in_c = with_c(program, observed, policy.actions) if program else None
    allowed = AGREEMENT + rounding(policy, observed, actions)
    print(f"a call of the policy on NumPy takes {_beside(seconds, period)}")
    graph = write_onnx(subject, options.out / f"{name}.onnx")
    print(judged(header, in_c, "no C compiler is here", actions, allowed, period))
    print(judged(graph, with_onnx(graph, observed), "the package onnxruntime is missing", actions, allowed, period))
    return [header, graph]


def judged(path: Path, form: Form | None, missing: str, actions: Floats, allowed: float, period: float) -> str:
    """Return a sentence about the form in a file, or that something is `missing`; the control period is `period` (s).

    Raises:
        ValueError: it differs from the policy's `actions` (n, 2) by more than is allowed.
    """
    if form is None:
        return f"{path}: not checked, {missing}"
    difference = float(np.abs(form.actions - actions).max())
    if not difference <= allowed:
        raise ValueError(f"{path} differs from the policy by {difference:.1e}, more than {allowed:.1e}")
    return f"{path}: differs by at most {difference:.1e}; a call takes {_beside(form.seconds, period)}"


def judged_replay(header: Path, played: Replay | None, period: float) -> str:
    """Return a sentence about episodes that were replayed through the controller in C.

    Raises:
        ValueError: its commands differ from the policy's.
    """
    if played is None:
        return f"{header}: its controller is not checked: no C compiler, or a policy that sees what no sensor tells"
    difference = f"{played.difference:.1e}"
    if not played.difference <= SAME_COMMANDS:
        raise ValueError(f"{header} commands otherwise, by {difference} of the range, more than {SAME_COMMANDS:g}")
    return (f"{header}: {played.episodes:,} episodes replayed, commands differ by at most {difference} of their range; "
            f"of {played.calls:,} calls 99.9 % take at most {1e6 * played.usual:.1f} us, the worst "
            f"{1e6 * played.worst:.0f} us, where the control period is {1e6 * period:,.0f} us")  # fmt: skip


def _beside(seconds: float, period: float) -> str:
    """Return the time of a call beside the control period."""
    return f"{1e6 * seconds:.1f} us, 1/{period / seconds:,.0f} of the controller's cycle of {1e3 * period:g} ms"


if __name__ == "__main__":
    run_command("export", Export, run)
