"""A policy as a C header: plain C99, no allocation, nothing beside math.h. Made for a controller's cycle."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.networks import Affine
from agents.policy import ACTIONS, Policy
from impact_gym.files import whole_file

C_ACTIVATIONS = {"tanh": "tanhf((float)sum)", "relu": "sum > 0.0 ? (float)sum : 0.0f", "none": "(float)sum"}


def identifier(name: str) -> str:
    """Return `name` as C can call something."""
    return re.sub(r"\W", "_", re.sub(r"^(?=\d)", "policy_", name), flags=re.ASCII)


def write_header(policy: Policy, path: Path) -> Path:
    """Write the header to `path`; its stem names what is in it."""
    with whole_file(path) as file:
        file.write(header(policy, identifier(path.stem)).encode("ascii", "replace"))
    return path


def header(policy: Policy, name: str) -> str:
    """Return the text of the header, every name in which begins with `name`."""
    network = policy.network
    layers = [layer for layer in network.layers() if layer.name != "log_std"]
    width, widest = network.width, max(max(layer.inputs, layer.outputs) for layer in layers)
    state = f"{name}_state *state, " if width else ""
    lines = [
        "/*",
        *_comment(policy, name),
        "*/",
        f"#ifndef {name.upper()}_H",
        f"#define {name.upper()}_H",
        "#include <math.h>",
        "",
    ]
    for layer in layers:
        lines += [_array(f"{name}_{layer.name}_weight", layer.weight), _array(f"{name}_{layer.name}_bias", layer.bias)]
    used = {network.activation} if network.hidden else set()
    for activation in sorted(used | {"none"}):
        lines += [
            f"static void {name}_affine_{activation}(const float *weight, const float *bias, int outputs, int inputs,",
            "    const float *in, float *out)",
            "{",
            "    for (int k = 0; k < outputs; k++) {",
            "        double sum = (double)bias[k];",
            "        for (int j = 0; j < inputs; j++) sum += (double)weight[k * inputs + j] * (double)in[j];",
            f"        out[k] = {C_ACTIVATIONS[activation]};",
            "    }",
            "}",
            "",
        ]
    if width:
        lines += [
            f"typedef struct {{ float output[{width}]; float cell[{width}]; }} {name}_state;",
            "",
            f"static float {name}_sigmoid(float value) {{ return 0.5f * (1.0f + tanhf(0.5f * value)); }}",
            "",
        ]
    lines += [
        f"static void {name}_act({state}const float observation[{network.inputs}], float action[{ACTIONS}])",
        "{",
        f"    float a[{widest}], b[{widest}];",
    ]
    lines += _recurrence(name, network.gates, width) if network.gates else [_copy("a", "observation", network.inputs)]
    into, out = "a", "b"
    for layer in network.hidden:
        lines.append(_call(name, layer, network.activation, into, out))
        into, out = out, into
    lines += [
        _call(name, network.mean, "none", into, out),
        f"    for (int k = 0; k < {ACTIONS}; k++)",
        f"        action[k] = tanhf({out}[k]);"
        if network.squash
        else f"        action[k] = {out}[k] < -1.0f ? -1.0f : {out}[k] > 1.0f ? 1.0f : {out}[k];",
        "}",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _recurrence(name: str, gates: Affine, width: int) -> list[str]:
    """Return the step of the LSTM, which leaves its output in `a`."""
    inputs = gates.inputs - width
    return [
        _copy("a", "observation", inputs),
        _copy(f"a + {inputs}", "state->output", width).replace("a + ", "(a + ", 1).replace("[k] =", ")[k] =", 1),
        _call(name, gates, "none", "a", "b"),
        f"    for (int k = 0; k < {width}; k++) {{",
        f"        float into = {name}_sigmoid(b[k]), forget = {name}_sigmoid(b[k + {width}]);",
        f"        state->cell[k] = forget * state->cell[k] + into * tanhf(b[k + {2 * width}]);",
        f"        state->output[k] = {name}_sigmoid(b[k + {3 * width}]) * tanhf(state->cell[k]);",
        "        a[k] = state->output[k];",
        "    }",
    ]


def _copy(to: str, source: str, count: int) -> str:
    return f"    for (int k = 0; k < {count}; k++) {to}[k] = {source}[k];"


def _call(name: str, layer: Affine, activation: str, into: str, out: str) -> str:
    arrays = f"{name}_{layer.name}_weight, {name}_{layer.name}_bias"
    return f"    {name}_affine_{activation}({arrays}, {layer.outputs}, {layer.inputs}, {into}, {out});"


def _array(name: str, values: NDArray[np.float32]) -> str:
    """Return the definition of an array; nine digits give a float32 back exactly."""
    numbers = [f"{float(value):.8e}f" for value in values.ravel()]
    rows = [", ".join(numbers[first : first + 6]) for first in range(0, len(numbers), 6)]
    return f"static const float {name}[{len(numbers)}] = {{\n    " + ",\n    ".join(rows) + "\n};\n"


def _comment(policy: Policy, name: str) -> list[str]:
    """Return what one must know to call it."""
    lines = [f"Policy {name}: call {name}_act once in each control cycle of 16 ms, and when the alarm comes."]
    if policy.network.width:
        lines.append(f"Set {name}_state to zero where an episode begins; the call carries it on.")
    lines += ["", "observation[k], each scaled affinely and cut to the range given:"]
    for place, entry in enumerate(policy.observation_table):
        scale = f"{entry['low']:g} ... {entry['high']:g} to {entry['scaled_low']:g} ... 1"
        lines.append(f"  [{place}] {entry['name']}, {entry['unit']}: {scale}")
    lines += ["", "action[k] in -1 ... 1:"]
    for place, command in enumerate(policy.action_table):
        lines.append(f"  [{place}] {command['name']}: {command['low']:g} ... {command['high']:g} {command['unit']}")
    lines += ["", f"Made by: {policy.provenance.get('command', 'unknown')}"]
    return [line.replace("*/", "* /") for line in lines]
