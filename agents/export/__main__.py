"""The command `impact-gym export`: write controllers as C headers and ONNX, and check the files."""

import importlib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tyro
from numpy.typing import NDArray

from agents.export.c_header import has_controller, write_header
from agents.export.documentation import Exported, of_name, of_setup
from agents.export.onnx_graph import write_onnx
from agents.export.replay import compiled, logged, replay
from agents.policies.policy import Policy
from agents.setups import load_setup
from impact_gym.parameters import Count, Options
from impact_gym.support.command_line import run_command

Floats = NDArray[np.float32]
AGREEMENT = 1e-6
"""Allowed difference between the actions (-1 ... 1) of a written file and those of the policy. The policy computes in
float32; its rounding errors are allowed in addition."""
SAME_COMMANDS = 1e-5  # allowed difference of commands in C from those in Python, as a fraction of the command's range
OBSERVATIONS = 10_000


@dataclass(frozen=True)
class Export(Options):
    """Write a controller as a C header, and a policy (a neural network) also as an ONNX file."""

    controller: tyro.conf.Positional[str]
    """Name of a shipped policy or baseline, file of a policy or baseline, or folder of a training. With --all: name or
    file of a set-up. The header of a tuned baseline contains the parameters for all tuned time weights. In your C
    code, pass the time weight (cost of a second until the touch, m/s per s) to the header's function NAME_reset."""
    out: Path
    """Folder for the C header and the ONNX file."""
    setup: str | None = None
    """Name or file of a set-up, if CONTROLLER is a baseline of this set-up. An untuned rule, such as the paper's, is
    written for the arm of this set-up."""
    all: bool = False
    """Write all controllers of a set-up: its policy, its tuned baselines, and the untuned rules, such as the paper's
    rule."""
    folder: Path | None = None
    """With --all: folder with the subfolders `policies` and `tuned` of the set-up. The default is the folder into
    which `impact-gym train --seeds` and `impact-gym tune` write."""
    episodes: Count = 10_000
    """Number of episodes in which the command compares the controller in C with the controller in Python."""
    calls: Count = 1_000_000
    """Number of timed calls of the controller in C."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.all and self.setup:
            raise ValueError(f"setup must be left out with --all, which takes a set-up as CONTROLLER, got {self.setup}")
        if self.folder and not self.all:
            raise ValueError(f"folder must be left out without --all, got {self.folder}")


def network_in_onnx(path: Path, observed: Floats) -> Floats | None:
    """Return the actions (n, k) of an ONNX file for observations (n, n_obs); None if onnxruntime is missing."""
    try:
        onnxruntime = importlib.import_module("onnxruntime")  # declares no types
    except ModuleNotFoundError:
        return None
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return session.run(None, {"observation": observed})[0]


def rounding(policy: Policy, observed: Floats, actions: Floats) -> float:
    """Return the largest difference of the policy's `actions` (n, k) from actions in double precision."""
    values, network = observed.astype(np.float64), policy.network
    for layer in network.hidden:
        sums = values @ layer.weight.T.astype(np.float64) + layer.bias
        values = np.tanh(sums) if network.activation == "tanh" else np.maximum(sums, 0.0)
    exact = np.clip(values @ network.mean.weight.T.astype(np.float64) + network.mean.bias, -1.0, 1.0)
    return float(np.abs(actions - exact).max())


def run(options: Export) -> list[Path]:
    """Write the files, check them, and return their paths."""
    if options.all:
        found = of_setup(load_setup(options.controller), options.folder)
    else:
        setup = load_setup(options.setup) if options.setup else None
        found = {Path(options.controller).stem: of_name(options.controller, setup)}
    return [path for name, exported in found.items() for path in export(exported, options, name)]


def export(exported: Exported, options: Export, name: str) -> list[Path]:
    """Write and check the files of one controller, and return their paths."""
    header, policy = options.out / f"{name}.h", exported.policy
    write_header(exported, header)
    with TemporaryDirectory() as folder:
        program = compiled(exported, header, Path(folder))
        controller = program if has_controller(exported) else None
        played = replay(exported, controller, logged(exported, options.episodes), options.calls) if controller else None
        print(judged_replay(header, played, options.episodes, exported.task.control_period))
        if policy is None:
            return [header]
        drawn = np.random.default_rng(0).uniform(policy.spec.scaled_low, 1.0, (OBSERVATIONS, policy.inputs))
        observed = drawn.astype(np.float32)
        actions = policy.predict(observed)[0]
        in_c = np.empty_like(actions)
        if program:
            program.act(len(observed), observed.ctypes, in_c.ctypes)
    allowed = AGREEMENT + rounding(policy, observed, actions)
    graph = write_onnx(exported, options.out / f"{name}.onnx")
    print(judged(header, in_c if program else None, "no C compiler is here", actions, allowed))
    print(judged(graph, network_in_onnx(graph, observed), "the package onnxruntime is missing", actions, allowed))
    return [header, graph]


def judged(path: Path, computed: Floats | None, missing: str, actions: Floats, allowed: float) -> str:
    """Return a sentence on the difference between `computed` and `actions` (n, k); ValueError: it exceeds `allowed`."""
    if computed is None:
        return f"{path}: its network is not checked, {missing}"
    difference = float(np.abs(computed - actions).max())
    if not difference <= allowed:
        raise ValueError(f"{path}: its network differs from the policy by {difference:.1e}, more than {allowed:.1e}")
    return f"{path}: its network differs from the policy by at most {difference:.1e}"


def judged_replay(header: Path, played: tuple[float, NDArray[np.float64]] | None, episodes: int, period: float) -> str:
    """Return a sentence on a result of `replay`; ValueError: commands differ too much. `period`: control period (s)."""
    if played is None:
        return f"{header}: its controller is not checked: no C compiler, or it uses values that no sensor measures"
    difference, seconds = played
    if not difference <= SAME_COMMANDS:
        raise ValueError(f"{header}: commands in C and in Python differ by {difference:.1e} of their range, more than "
                         f"{SAME_COMMANDS:g}")  # fmt: skip
    return (f"{header}: {episodes:,} episodes replayed, commands differ by at most {difference:.1e} of their range; "
            f"of {len(seconds):,} calls here 99.9 % take at most {1e6 * np.quantile(seconds, 0.999):.1f} us "
            f"of the control period of {1e6 * period:,.0f} us")  # fmt: skip


if __name__ == "__main__":
    run_command("export", Export, run)
