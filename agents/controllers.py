"""Controllers from plain data, so that a job can name one on another machine.

`{"policy": ...}` holds a policy's file in base 64, `{"shipped": ...}` names one of the project's; `{"baseline": ...}`
names one that is shipped or was tuned; `{"speed": ...}` is a constant speed, reached and left at 20 m/s^2;
`{"clairvoyant": ...}` what was found for each scenario of a preset; `{"object": "module:name"}` anything with
`predict`, or a function or class that returns it.
"""

import base64
import importlib
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from agents import load_policy
from agents.baselines import ConstantSpeed
from agents.baselines.tuned import load_baseline
from agents.clairvoyance import load_clairvoyant
from agents.policy import Policy
from agents.validation import Controller


def controller_of(spec: Mapping[str, Any], time_weight: float) -> Controller:
    """Return the controller that `spec` describes, for a time weight (m/s per s).

    Raises:
        ValueError: there is none, or it cannot `predict`; says why.
    """
    ((kind, value),) = spec.items()
    if kind == "policy":
        return _policy(value)
    if kind == "shipped":
        return load_policy(value)
    if kind == "baseline":
        return load_baseline(value, time_weight)
    if kind == "speed":
        return ConstantSpeed(value, 20.0)
    if kind == "clairvoyant":
        return load_clairvoyant(value, time_weight)
    if kind == "object":
        return _object(value)
    raise ValueError(f"no controller of the kind {kind!r}")


@lru_cache(maxsize=64)
def _policy(content: str) -> Policy:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.npz"
        path.write_bytes(base64.b64decode(content))
        return load_policy(path)


def _object(name: str) -> Controller:
    module, _, attribute = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
        found = found() if isinstance(found, type) or not hasattr(found, "predict") else found
    except Exception as error:
        raise ValueError(f"no controller {name!r}: {error!r}") from error
    if not callable(getattr(found, "predict", None)):
        raise ValueError(f"{name!r} is no controller: it has no method `predict`")
    return found
