"""Small networks on NumPy, as torch computes them: what a policy is made of.

A row's result has the same bits whatever rows stand beside it: each row is a vector-matrix product of its own. One
product for the whole batch would be summed in an order that depends on the batch's size.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
State = tuple[Floats, Floats]
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "tanh": np.tanh,
    "relu": lambda values: np.maximum(values, np.float32(0.0)),
}


class Affine:
    """inputs @ weight.T + bias."""

    def __init__(self, name: str, weight: Floats, bias: Floats) -> None:
        """Make a layer of `weight` (outputs, inputs), as torch has it, and `bias` (outputs,)."""
        if weight.ndim != 2 or bias.shape != weight.shape[:1]:
            raise ValueError(f"{name}: weight {weight.shape} and bias {bias.shape} do not fit")
        if weight.dtype != np.float32 or bias.dtype != np.float32:
            raise ValueError(f"{name}: weight and bias must be float32, got {weight.dtype} and {bias.dtype}")
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ValueError(f"{name}: weight and bias must be finite")
        self.name, self.weight, self.bias = name, weight, bias
        self.outputs, self.inputs = weight.shape
        self._columns = np.ascontiguousarray(weight.T)

    def __call__(self, inputs: Floats) -> Floats:
        """Return the layer's outputs for each row of `inputs`."""
        return np.matmul(inputs[..., None, :], self._columns)[..., 0, :] + self.bias


@dataclass(frozen=True, eq=False)
class Network:
    """Hidden layers, behind a recurrent one if there is one, then mean and noise of an action in [-1, 1]."""

    hidden: tuple[Affine, ...]
    mean: Affine
    log_std: Affine  # logarithm of the noise's standard deviation; weight 0 where it does not depend on anything
    activation: str = "tanh"  # of the hidden layers
    squash: bool = False  # True: action = tanh(mean + noise); False: mean + noise cut to [-1, 1]
    gates: Affine | None = None  # of an LSTM, from inputs and last output; input, forget, cell and output gate

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation must be one of {sorted(ACTIVATIONS)}, got {self.activation!r}")
        if self.log_std.weight.shape != self.mean.weight.shape:
            shapes = self.log_std.weight.shape, self.mean.weight.shape
            raise ValueError(f"log_std {shapes[0]} must have the shape of mean {shapes[1]}")
        if self.gates and (self.gates.outputs % 4 or self.gates.inputs <= self.width):
            raise ValueError(f"gates {self.gates.weight.shape} are no four gates over inputs and outputs")
        before = self.width if self.gates else self.inputs
        for layer in (*self.hidden, self.mean):
            if layer.inputs != before:
                raise ValueError(f"{layer.name} takes {layer.inputs} numbers, what is before it gives {before}")
            before = layer.outputs

    @property
    def width(self) -> int:
        """Cells of the LSTM."""
        return self.gates.outputs // 4 if self.gates else 0

    @property
    def inputs(self) -> int:
        """Length of the observation."""
        return self.gates.inputs - self.width if self.gates else (*self.hidden, self.mean)[0].inputs

    def latent(self, inputs: Floats, state: State | None) -> tuple[Floats, State | None]:
        """Return what mean and noise are read from, for rows of `inputs`, and the next state of the LSTM."""
        values = inputs
        if self.gates:
            output, cell = state or (np.zeros((*inputs.shape[:-1], self.width), np.float32),) * 2
            into, forget, new, out = np.split(self.gates(np.concatenate((inputs, output), axis=-1)), 4, axis=-1)
            cell = _sigmoid(forget) * cell + _sigmoid(into) * np.tanh(new)
            values = _sigmoid(out) * np.tanh(cell)
            state = values, cell
        for layer in self.hidden:
            values = ACTIVATIONS[self.activation](layer(values))
        return values, state

    def action(self, mean: Floats) -> Floats:
        """Return the action for a mean, or for a mean with noise."""
        return np.tanh(mean) if self.squash else np.clip(mean, np.float32(-1.0), np.float32(1.0))

    def layers(self) -> tuple[Affine, ...]:
        """Return every layer that has weights."""
        return (*((self.gates,) if self.gates else ()), *self.hidden, self.mean, self.log_std)

    def description(self) -> dict[str, Any]:
        """Return activation, squashing and the order of the layers, for JSON."""
        return {"activation": self.activation, "squash": self.squash, "layers": [layer.name for layer in self.layers()]}


def from_arrays(description: Mapping[str, Any], arrays: Mapping[str, Floats]) -> Network:
    """Return the network that `layers` and `description` came from; names of arrays as in `to_arrays`."""
    made = {name: Affine(name, arrays[f"{name}.weight"], arrays[f"{name}.bias"]) for name in description["layers"]}
    mean, log_std, gates = made.pop("mean"), made.pop("log_std"), made.pop("gates", None)
    return Network(tuple(made.values()), mean, log_std, description["activation"], bool(description["squash"]), gates)


def to_arrays(network: Network) -> dict[str, Floats]:
    """Return the weights by name."""
    return {f"{layer.name}.{part}": getattr(layer, part) for part in ("weight", "bias") for layer in network.layers()}


def _sigmoid(values: Floats) -> Floats:
    """1 / (1 + exp(-values)), which cannot overflow in this form."""
    half = np.float32(0.5)
    return half * (np.float32(1.0) + np.tanh(half * values))
