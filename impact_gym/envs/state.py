"""Check saved states: a state has arrays and their digest, so that no altered state reaches the compiled program."""

import hashlib
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.validation import shown


def digest(arrays: Iterable[NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the SHA-256 digest of the contents of arrays, as 32 bytes (32,)."""
    total = hashlib.sha256()
    for array in arrays:
        total.update(array.tobytes())
    return np.frombuffer(total.digest(), np.uint8)


def taken(state: Any, name: str, like: NDArray[Any]) -> NDArray[Any]:
    """Return the array `name` of a state; raise ValueError if its shape or dtype differs from that of `like`."""
    value = state.get(name) if isinstance(state, Mapping) else None
    if not isinstance(value, np.ndarray) or value.shape != like.shape or value.dtype != like.dtype:
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else shown(value)
        raise ValueError(f"{name} of a state must be an array {like.dtype} {like.shape}, got {got}")
    return value
