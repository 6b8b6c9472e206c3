"""A policy as an ONNX graph, made without torch."""

from pathlib import Path
from typing import Any

import numpy as np

from agents.export.documentation import Exported
from impact_gym.support.files import write_file

OPSET = 17
IR_VERSION = 8  # version of ONNX's file format; ONNX runtimes since 2022 read this version


def write_onnx(exported: Exported, path: Path) -> Path:
    """Write a policy's graph, from `observation` (n, n_obs) to `action` (n, k) for any n, with the documentation."""
    if exported.policy is None:
        raise ValueError(f"only a policy has a network for ONNX, got {type(exported.controller).__name__}")
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ModuleNotFoundError as error:
        raise ValueError("ONNX needs the package onnx: pip install -c constraints.txt onnx") from error
    network = exported.policy.network
    nodes: list[Any] = []
    weights: dict[str, Any] = {"low": np.float32(-1.0), "high": np.float32(1.0)}
    values = "observation"
    for layer in (*network.hidden, network.mean):
        names = f"{layer.name}.weight", f"{layer.name}.bias"
        weights |= dict(zip(names, (layer.weight, layer.bias), strict=True))
        total = f"{layer.name}.sum"
        nodes.append(helper.make_node("Gemm", [values, *names], [total], name=total, transB=1))
        kind, inputs, values = network.activation.capitalize(), [total], layer.name
        if layer is network.mean:
            kind, inputs, values = "Clip", [total, "low", "high"], "action"
        nodes.append(helper.make_node(kind, inputs, [values], name=values))
    shapes = {"observation": exported.policy.inputs, "action": exported.policy.actions}
    start, end = (helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", shapes[name]]) for name in shapes)
    initial = [numpy_helper.from_array(np.asarray(value), name) for name, value in weights.items()]
    graph = helper.make_graph(nodes, path.stem, [start], [end], initial)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, exported.documentation)
    onnx.checker.check_model(model)
    return write_file(path, model.SerializeToString())
