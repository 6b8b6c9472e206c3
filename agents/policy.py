"""Policies as plain arrays: what training leaves behind, and what runs without torch.

A policy file is a NumPy archive without pickled objects: the weights of a small network and, as JSON text, how they
came about. Reading one runs no code.
"""

import json
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.files import whole_file

SHIPPED = Path(__file__).parent / "policies"
FORMAT = "impact_gym policy 1"
DAMAGE = (ValueError, TypeError, AttributeError, LookupError, RuntimeError, OSError, EOFError)
DAMAGE += (zipfile.BadZipFile, zlib.error, struct.error)
"""What reading a file can raise that is not a policy, or no longer."""


class Policy:
    """A network of tanh layers with a Gaussian action around its output, cut to [-1, 1]."""

    def __init__(
        self,
        weights: list[NDArray[np.float32]],
        biases: list[NDArray[np.float32]],
        log_std: NDArray[np.float32],
        provenance: Mapping[str, Any],
    ) -> None:
        """Make a policy.

        Args:
            weights: one array (outputs, inputs) per layer, as torch has them.
            biases: one array (outputs,) per layer.
            log_std: (actions,), logarithm of the noise's standard deviation.
            provenance: how the policy came about: command, seed, versions, anything that JSON holds.

        Raises:
            ValueError: the arrays do not fit together, or are not finite.
        """
        if not weights or len(weights) != len(biases):
            raise ValueError(f"a policy needs as many weights as biases, got {len(weights)} and {len(biases)}")
        for layer, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            if weight.ndim != 2 or bias.shape != weight.shape[:1]:
                raise ValueError(f"layer {layer}: weight {weight.shape} and bias {bias.shape} do not fit")
            if layer and weight.shape[1] != weights[layer - 1].shape[0]:
                raise ValueError(f"layer {layer} takes {weight.shape[1]} numbers, the one before gives another count")
        if log_std.shape != biases[-1].shape:
            raise ValueError(f"log_std {log_std.shape} must be as long as the action {biases[-1].shape}")
        if not all(array.dtype.kind == "f" for array in (*weights, *biases, log_std)):
            raise ValueError("a policy's arrays must hold real numbers")
        if not all(np.isfinite(array).all() for array in (*weights, *biases, log_std)):
            raise ValueError("a policy's arrays must be finite")
        self.weights, self.biases, self.log_std = weights, biases, log_std
        self.provenance = dict(provenance)
        self._noise = np.random.default_rng()

    @property
    def inputs(self) -> int:
        """Length of the observation."""
        return int(self.weights[0].shape[1])

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation (n_obs,) or the actions for a batch of them (n, n_obs).

        Unlike in stable-baselines3, deterministic is the default: it is what the policy was judged by.
        """
        hidden = np.asarray(observation, np.float32)
        if hidden.ndim == 0 or hidden.shape[-1] != self.inputs:
            raise ValueError(f"the policy takes {self.inputs} numbers, the observation has the shape {hidden.shape}")
        if not np.isfinite(hidden).all():
            raise ValueError("the observation must be finite")
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            hidden = np.tanh(_affine(weight, bias, hidden))
        action = _affine(self.weights[-1], self.biases[-1], hidden)
        if not deterministic:
            action = action + np.exp(self.log_std) * self._noise.standard_normal(action.shape, np.float32)
        return np.clip(action, -1.0, 1.0), state

    def save(self, path: Path | str) -> Path:
        """Write the policy to `path`, whole or not at all."""
        arrays = {f"weight_{i}": array for i, array in enumerate(self.weights)}
        arrays |= {f"bias_{i}": array for i, array in enumerate(self.biases)}
        header = json.dumps({"format": FORMAT, "layers": len(self.weights), "provenance": self.provenance}, indent=1)
        with whole_file(Path(path)) as file:
            np.savez(file, header=np.array(header), log_std=self.log_std, **arrays)
        return Path(path)


def _affine(weight: NDArray[np.float32], bias: NDArray[np.float32], inputs: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return weight @ inputs + bias for each row of `inputs`, the same to the bit however many rows there are.

    A matrix product of BLAS sums in another order for another number of rows.
    """
    return np.einsum("...j,kj->...k", inputs, weight) + bias


def load_policy(name: str | Path) -> Policy:
    """Return a policy shipped with the project, by name, or from a file, or from a run folder.

    Raises:
        FileNotFoundError: neither a shipped policy nor a file; lists what is shipped.
        ValueError: the file is not a policy, or is damaged.
    """
    path = SHIPPED / f"{name}.npz"
    if not path.is_file():
        path = Path(name)
    if path.is_dir():
        path = path / "policy.npz"
    if not path.is_file():
        shipped = sorted(file.stem for file in SHIPPED.glob("*.npz"))
        raise FileNotFoundError(f"no policy {str(name)!r}: it is no file, and shipped are {shipped}")
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            header = json.loads(str(archive["header"]))
            if header["format"] != FORMAT:
                raise ValueError(f"its format is {header['format']!r}, this version reads {FORMAT!r}")
            layers = range(header["layers"])
            return Policy(
                [archive[f"weight_{i}"] for i in layers],
                [archive[f"bias_{i}"] for i in layers],
                archive["log_std"],
                header["provenance"],
            )
    except DAMAGE as error:
        reason = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else error
        raise ValueError(f"{path} is not a policy file, or is damaged: {reason}") from error
