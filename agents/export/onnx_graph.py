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
    values = "observation"
    for layer in network.hidden:
        values = graph.add(network.activation.capitalize(), [graph.affine(layer, values)], layer.name)
    graph.weights |= {"low": np.float32(-1.0), "high": np.float32(1.0)}
    graph.add("Clip", [graph.affine(network.mean, values), "low", "high"], "action")
    shapes = {"observation": network.inputs, "action": ACTIONS}
    ends = [[helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", shapes[name]])] for name in shapes]
    initial = [numpy_helper.from_array(np.asarray(value), name) for name, value in graph.weights.items()]
    whole = helper.make_graph(graph.nodes, path.stem, *ends, initial)
    model = helper.make_model(whole, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {"command": str(policy.provenance.get("command", "unknown"))})
    onnx.checker.check_model(model)
    with whole_file(path) as file:
        file.write(model.SerializeToString())
    return path
