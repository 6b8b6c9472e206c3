"""A policy as a C header: plain C99 or C++, no allocation, nothing beside math.h. Made for a controller's cycle.

The header holds the network, `NAME_act`, and around it the whole controller, `NAME_reset` and `NAME_step`: from what
the sensors say, in SI units, to the command.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from impact_gym.kernels import LINEAR, LOGARITHM
from numpy.typing import NDArray

from agents.policies.networks import Affine
from agents.policies.policy import ACTIONS, Policy
from impact_gym.envs.observation import Entry, entries, sensor_fields
from impact_gym.envs.task import COMMAND_RESOLUTION, Task
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
    memory = f"{name}_memory *memory, " if width else ""
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
            f"typedef struct {{ float output[{width}]; float cell[{width}]; }} {name}_memory;",
            "",
            f"static float {name}_sigmoid(float value) {{ return 0.5f * (1.0f + tanhf(0.5f * value)); }}",
            "",
        ]
    lines += [
        f"static inline void {name}_act({memory}const float observation[{network.inputs}], float action[{ACTIONS}])",
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
        *controller(policy, name),
        "#endif",
        "",
    ]
    return "\n".join(lines)


def controller(policy: Policy, name: str) -> list[str]:
    """Return the lines of the controller around the network; none for a policy that sees what no sensor tells."""
    task = Task(**policy.environment)
    seen, fields = entries(task), sensor_fields(task)
    told = {field: key for key, field in fields.items()}
    if not {one.sensor for one in seen} <= {*told, "time_weight"}:
        return []
    width, lightest = policy.network.width, next(one.low for one in seen if one.sensor == "time_weight")
    low, high = zip(task.velocity_range, task.acceleration_range, strict=True)
    numbers = " ".join(f"double {key};" for key in fields)
    zero = f"for (int k = 0; k < {width}; k++) state->memory.output[k] = state->memory.cell[k] = 0.0f;"
    lines = [
        "typedef struct {  /* SI units; force_peak is 0 where the sensor holds no peak of its own */",
        f"    {numbers}",
        f"}} {name}_sensors;",
        f"typedef struct {{ double velocity, acceleration; }} {name}_command;  /* m/s, m/s^2 */",
        "typedef struct {",
        f"    {name}_sensors last;",
        f"    {name}_command command;",
        "    double time_weight, heard_at;",
        "    int begun, heard;",
        *([f"    {name}_memory memory;"] if width else []),
        f"}} {name}_state;",
        "",
        f"static inline double {name}_kept(double now, double last) {{ return now - now == 0.0 ? now : last; }}",
        "",
        f"static inline float {name}_scaled(double value, double low, double gain, double scaled_low)",
        "{",
        "    value = scaled_low + gain * (value - low);",
        "    return (float)(value < scaled_low ? scaled_low : value > 1.0 ? 1.0 : value);",
        "}",
        "",
        f"static inline double {name}_decoded(float action, double low, double high)",
        "{",
        "    double share = 0.5 * ((double)(action < -1.0f ? -1.0f : action > 1.0f ? 1.0f : action) + 1.0);",
        f"    return rint((low + share * (high - low)) / {COMMAND_RESOLUTION!r}) * {COMMAND_RESOLUTION!r};",
        "}",
        "",
        f"static inline void {name}_reset({name}_state *state, double time_weight)",
        "{",
        f"    {name}_sensors none = {{{', '.join('0.0' for _ in fields)}}};",
        "    state->last = none;",
        "    state->command.velocity = 0.0;",
        f"    state->command.acceleration = {high[1]!r};",
        f"    state->time_weight = time_weight > {lightest!r} ? time_weight : {lightest!r};",
        "    state->heard_at = 0.0;",
        "    state->begun = state->heard = 0;",
        *([f"    {zero}"] if width else []),
        "}",
        "",
        f"static inline void {name}_step({name}_state *state, const {name}_sensors *sensors, {name}_command *command)",
        "{",
        f"    {name}_sensors *now = &state->last;",
        f"    float observation[{len(seen)}], action[{ACTIONS}];",
        "    *command = state->command;",
        "    if (sensors->time - sensors->time != 0.0 || (state->begun && sensors->time <= now->time)) return;",
        "    state->begun = 1;",
        "    now->time = sensors->time;",
        *(
            f"    now->{key} = {name}_kept(sensors->{key}, now->{key});"
            for key in fields
            if key not in ("time", "alarm", "time_since_alarm", "force_peak")
        ),
        "    now->force = fmax(now->force, 0.0);",
        f"    now->force_peak = fmax(now->force_peak, fmax(now->force, {name}_kept(sensors->force_peak, 0.0)));",
        f"    if (!state->heard && {name}_kept(sensors->alarm, 0.0) > 0.5) {{",
        "        state->heard = 1;",
        f"        state->heard_at = now->time - {name}_kept(sensors->time_since_alarm, 0.0);",
        "    }",
        "    now->alarm = state->heard;",
        "    now->time_since_alarm = state->heard ? now->time - state->heard_at : 0.0;",
        *(f"    observation[{place}] = {_scaled(name, one, told)};" for place, one in enumerate(seen)),
        f"    {name}_act({'&state->memory, ' if width else ''}observation, action);",
        f"    command->velocity = {name}_decoded(action[0], {low[0]!r}, {high[0]!r});",
        f"    command->acceleration = {name}_decoded(action[1], {low[1]!r}, {high[1]!r});",
        "    state->command = *command;",
        "}",
        "",
    ]
    return lines


def _scaled(name: str, entry: Entry, told: Mapping[str, str]) -> str:
    """Return the expression of one entry of the observation."""
    value = f"now->{told[entry.sensor]}" if entry.sensor in told else "state->time_weight"
    if entry.curve != LINEAR:
        value = f"{'log' if entry.curve == LOGARITHM else 'log1p'}({value})"
    _, _, low, scaled_low, gain = entry.record()
    return f"{name}_scaled({value}, {low!r}, {gain!r}, {scaled_low!r})"


def _recurrence(name: str, gates: Affine, width: int) -> list[str]:
    """Return the step of the LSTM, which leaves its output in `a`."""
    inputs = gates.inputs - width
    return [
        _copy("a", "observation", inputs),
        _copy(f"a + {inputs}", "memory->output", width).replace("a + ", "(a + ", 1).replace("[k] =", ")[k] =", 1),
        _call(name, gates, "none", "a", "b"),
        f"    for (int k = 0; k < {width}; k++) {{",
        f"        float into = {name}_sigmoid(b[k]), forget = {name}_sigmoid(b[k + {width}]);",
        f"        memory->cell[k] = forget * memory->cell[k] + into * tanhf(b[k + {2 * width}]);",
        f"        memory->output[k] = {name}_sigmoid(b[k + {3 * width}]) * tanhf(memory->cell[k]);",
        "        a[k] = memory->output[k];",
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
    task = Task(**policy.environment)
    cycle = f"{1e3 * task.control_period:g} ms"
    lines = [f"Policy {name}: call {name}_step once in each control cycle of {cycle}, and when the alarm comes;"]
    lines += [f"{name}_reset where an episode begins. The command holds until the next call.", ""]
    lines += [
        "A reading that is not later than the last one, or has no time, changes nothing: the last command stands, at",
        "first to stay at rest. A number that is missing (NaN or infinite) keeps its last value, at first 0; an alarm",
        "once heard stays, and its clock goes on by the time.",
        "",
        f"{name}_act is the network alone.",
    ]
    if policy.network.width:
        lines.append(f"Set {name}_memory to zero where an episode begins; the call carries it on.")
    lines += ["", "observation[k], each scaled affinely and cut to the range given:"]
    for place, entry in enumerate(policy.observation_table):
        scale = f"{entry['low']:g} ... {entry['high']:g} to {entry['scaled_low']:g} ... 1"
        lines.append(f"  [{place}] {entry['name']}, {entry['unit']}: {scale}")
    lines += ["", "action[k] in -1 ... 1:"]
    for place, command in enumerate(policy.action_table):
        lines.append(f"  [{place}] {command['name']}: {command['low']:g} ... {command['high']:g} {command['unit']}")
    lines += ["", f"Made by: {policy.provenance.get('command', 'unknown')}"]
    return [line.replace("*/", "* /") for line in lines]
