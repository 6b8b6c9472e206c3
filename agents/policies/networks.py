"""The small networks of policies, computed with NumPy.

An observation is a row. The result of a row has the same bits in every batch, because rows are multiplied in blocks of
one size. Zeros fill the last block.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.support.validation import choice

Floats = NDArray[np.float32]
BLOCKS = (16, 8, 4, 2, 1)  # block sizes, in rows, that `Network.block` tries in this order
CHUNK = 512  # number of rows that `Network.read` computes together, few enough for the processor's cache
ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "tanh": np.tanh,
    "relu": lambda values: np.maximum(values, np.float32(0.0)),
}


class Affine:
    """A layer: inputs @ weight.T + bias."""

    def __init__(self, name: str, weight: Floats, bias: Floats) -> None:
        """Make a layer from `weight` (outputs, inputs), in torch's order, and `bias` (outputs,)."""
        if weight.ndim != 2 or bias.shape != weight.shape[:1]:
            raise ValueError(f"{name}: weight must be (m, n) and bias (m,), got {weight.shape} and {bias.shape}")
        if weight.dtype != np.float32 or bias.dtype != np.float32:
            raise ValueError(f"{name}: weight and bias must be float32, got {weight.dtype} and {bias.dtype}")
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ValueError(f"{name}: weight and bias must be finite")
        self.name, self.weight, self.bias = name, weight, bias
        self.outputs, self.inputs = weight.shape
        self._columns = np.ascontiguousarray(weight.T)

    def __call__(self, inputs: Floats) -> Floats:
        """Return the layer's outputs (blocks, rows, outputs) for `inputs` (blocks, rows, inputs)."""
        return np.matmul(inputs, self._columns) + self.bias

    def rounds_alike(self, block: int) -> bool:
        """Whether a row's result has the same bits at every position in a block of this many rows."""
        row = np.random.default_rng(0).standard_normal((1, 1, self.inputs), np.float32)
        outputs = self(np.repeat(row, block, axis=1))[0]
        return bool((outputs == outputs[0]).all())


@dataclass(frozen=True, eq=False)
class Network:
    """Hidden layers, then mean and noise of an action in [-1, 1]; all hidden layers have the same activation."""

    hidden: tuple[Affine, ...]
    mean: Affine
    log_std: Affine  # logarithm of the noise's standard deviation; `log_std.weight` is 0 if the noise is constant
    activation: str = "tanh"

    def __post_init__(self) -> None:
        choice("activation", self.activation, sorted(ACTIVATIONS))
        if self.log_std.weight.shape != self.mean.weight.shape:
            shapes = self.log_std.weight.shape, self.mean.weight.shape
            raise ValueError(f"log_std {shapes[0]} must have the shape of mean {shapes[1]}")
        for before, layer in pairwise((*self.hidden, self.mean)):
            if layer.inputs != before.outputs:
                raise ValueError(f"{layer.name} takes {layer.inputs} numbers, the layer before gives {before.outputs}")

    @cached_property
    def block(self) -> int:
        """Number of rows in a block: the largest in BLOCKS for which a row's position changes no result."""
        return next(rows for rows in BLOCKS if all(layer.rounds_alike(rows) for layer in self.layers()))

    def read(self, head: Affine, inputs: Floats) -> Floats:
        """Return the outputs (..., outputs) of `head`, mean or log_std, for `inputs` (..., inputs)."""
        rows = np.asarray(inputs).reshape(-1, np.shape(inputs)[-1])
        blocks = np.zeros((-(-len(rows) // self.block), self.block, rows.shape[-1]), np.float32)
        blocks.reshape(-1, rows.shape[-1])[: len(rows)] = rows
        many = CHUNK // self.block
        outputs = []
        for first in range(0, len(blocks), many):
            values = blocks[first : first + many]
            for layer in self.hidden:
                values = ACTIVATIONS[self.activation](layer(values))
            outputs.append(head(values))
        flat = np.concatenate(outputs).reshape(-1, head.outputs)[: len(rows)]
        return flat.reshape(*np.shape(inputs)[:-1], head.outputs)

    def layers(self) -> tuple[Affine, ...]:
        """Return all layers."""
        return (*self.hidden, self.mean, self.log_std)

    def description(self) -> dict[str, Any]:
        """Return the activation and the names of the layers in their order, for JSON."""
        return {"activation": self.activation, "layers": [layer.name for layer in self.layers()]}


def from_arrays(description: Mapping[str, Any], arrays: Mapping[str, Floats]) -> Network:
    """Return the network with this `description` and with arrays named as in `to_arrays`."""
    # layers get new names: exported C code contains the names, and must not contain text of a policy's file
    places = {name: f"hidden_{place}" for place, name in enumerate(description["layers"])}
    places |= {name: name for name in ("mean", "log_std")}
    made = {name: Affine(place, arrays[f"{name}.weight"], arrays[f"{name}.bias"]) for name, place in places.items()}
    mean, log_std = made.pop("mean"), made.pop("log_std")
    return Network(tuple(made.values()), mean, log_std, description["activation"])


def to_arrays(network: Network) -> dict[str, Floats]:
    """Return the weights and biases by name."""
    return {f"{layer.name}.{part}": getattr(layer, part) for part in ("weight", "bias") for layer in network.layers()}
