"""A policy as an ONNX graph, written node by node: no torch, no tracing."""

from pathlib import Path
from typing import Any

import numpy as np

from agents.policies.networks import Affine
from agents.policies.policy import ACTIONS, Policy
from impact_gym.files import whole_file

OPSET = 17
IR_VERSION = 8  # what runtimes of 2022 and later read


class _Graph:
    """Nodes in the order they are computed, each with the one output it is named by."""

    def __init__(self, helper: Any) -> None:
        self.helper = helper
        self.nodes: list[Any] = []
        self.weights: dict[str, Any] = {}

    def add(self, kind: str, inputs: list[str], name: str, **attributes: Any) -> str:
        self.nodes.append(self.helper.make_node(kind, inputs, [name], name=name, **attributes))
        return name

    def affine(self, layer: Affine, into: str) -> str:
        self.weights |= {f"{layer.name}.weight": layer.weight, f"{layer.name}.bias": layer.bias}
        return self.add("Gemm", [into, f"{layer.name}.weight", f"{layer.name}.bias"], f"{layer.name}.sum", transB=1)


def write_onnx(policy: Policy, path: Path) -> Path:
    """Write the graph to `path`: `observation` (n, n_obs) to `action` (n, 2), for any n.

    A recurrent policy also takes `output` and `cell` (n, cells), zero where an episode begins, and gives `next_output`
    and `next_cell`.

    Raises:
        ValueError: the package onnx is missing.
    """
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ModuleNotFoundError as error:
        raise ValueError("ONNX needs the package onnx: pip install -c constraints.txt onnx") from error
    network = policy.network
    graph = _Graph(helper)
    shapes = {"observation": network.inputs, "action": ACTIONS}
    inputs, outputs, values = ["observation"], ["action"], "observation"
    if network.gates:
        shapes |= dict.fromkeys(("output", "cell", "next_output", "next_cell"), network.width)
        inputs, outputs = [*inputs, "output", "cell"], [*outputs, "next_output", "next_cell"]
        values = _recurrence(graph, network.gates)
    for layer in network.hidden:
        values = graph.add(network.activation.capitalize(), [graph.affine(layer, values)], layer.name)
    mean = graph.affine(network.mean, values)
    if network.squash:
        graph.add("Tanh", [mean], "action")
    else:
        graph.weights |= {"low": np.float32(-1.0), "high": np.float32(1.0)}
        graph.add("Clip", [mean, "low", "high"], "action")

    def described(names: list[str]) -> list[Any]:
        return [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", shapes[name]]) for name in names]

    initial = [numpy_helper.from_array(np.asarray(value), name) for name, value in graph.weights.items()]
    whole = helper.make_graph(graph.nodes, path.stem, described(inputs), described(outputs), initial)
    model = helper.make_model(whole, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {"command": str(policy.provenance.get("command", "unknown"))})
    onnx.checker.check_model(model)
    with whole_file(path) as file:
        file.write(model.SerializeToString())
    return path


def _recurrence(graph: _Graph, gates: Affine) -> str:
    """Add the step of the LSTM and return its output's name."""
    together = graph.add("Concat", ["observation", "output"], "together", axis=1)
    names = ["into", "forget", "new", "out"]
    graph.nodes.append(graph.helper.make_node("Split", [graph.affine(gates, together)], names, name="split", axis=1))
    open_gates = {name: graph.add("Sigmoid", [name], f"{name}.gate") for name in ("into", "forget", "out")}
    kept = graph.add("Mul", [open_gates["forget"], "cell"], "kept")
    added = graph.add("Mul", [open_gates["into"], graph.add("Tanh", ["new"], "new.value")], "added")
    cell = graph.add("Tanh", [graph.add("Add", [kept, added], "next_cell")], "cell.value")
    return graph.add("Mul", [open_gates["out"], cell], "next_output")
