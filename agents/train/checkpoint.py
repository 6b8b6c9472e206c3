"""Write and restore checkpoints: a resumed training has the same result as an uninterrupted one.

The callback writes a checkpoint between two rollouts, when the rollout buffer is empty and need not be stored. A
checkpoint contains networks, optimiser, counters, environments, the random states of torch, NumPy and Python, and the
values that the log has not written yet. The file is not in torch's format, because `torch.load(weights_only=True)`
needs private functions of NumPy to read arrays, and does not detect a damaged file.
"""

import json
import random
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.setups import Training
from impact_gym.support.archive import archive_of, read_archive
from impact_gym.support.files import reason, write_file

FORMAT = "impact_gym checkpoint 5"
# attributes of stable-baselines3 2.9, some of them private; a test checks that a resumed training has the same result
COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")
UNWRITTEN = ("name_to_value", "name_to_count", "name_to_excluded")  # logger attributes that hold unwritten values


def write(path: Path, model: Any, callback_state: Mapping[str, Any], training: Training) -> None:
    """Write a checkpoint of a model, the model's environments and the callback's state atomically."""
    arrays: dict[str, NDArray[Any]] = {}
    state = {
        "parameters": model.get_parameters(),
        "counters": {name: getattr(model, name) for name in COUNTERS},
        "last": (model._last_obs, model._last_episode_starts),
        "environment": model.env.get_state(),
        "torch": torch.get_rng_state(),
        "numpy": np.random.get_state(legacy=False),  # noqa: NPY002 - stable-baselines3 uses this generator
        "python": random.getstate(),
        "log": [getattr(model.logger, name) for name in UNWRITTEN],
        "callback_state": callback_state,
        "settings": _settings(model, training),
    }
    content = json.loads(json.dumps(state, default=partial(_pack, arrays)))
    write_file(path, archive_of(FORMAT, content, arrays))


def restore(path: Path, model: Any, training: Training) -> dict[str, Any]:
    """Restore a model; return the state of the callback. ValueError: the checkpoint is not of this training."""
    content, arrays = read_archive(path, FORMAT)
    try:
        before, now = content["settings"], json.loads(json.dumps(_settings(model, training)))
        if changed := [name for name in now if before.get(name) != now[name]]:
            raise ValueError(", ".join(f"{n} is {before.get(n)!r} in the checkpoint, got {now[n]!r}" for n in changed))
        state = json.loads(json.dumps(content), object_hook=partial(_unpack, arrays))
        model.set_parameters(state["parameters"])
        for name in COUNTERS:
            setattr(model, name, state["counters"][name])
        model._last_obs, model._last_episode_starts = state["last"]
        model.env.set_state(state["environment"])
        torch.set_rng_state(state["torch"])
        np.random.set_state(state["numpy"])  # noqa: NPY002 - stable-baselines3 uses this generator
        version, words, gauss = state["python"]
        random.setstate((version, tuple(words), gauss))
        for name, kept in zip(UNWRITTEN, state["log"], strict=True):
            getattr(model.logger, name).clear()
            getattr(model.logger, name).update(kept)
        return dict(state["callback_state"])
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"{path} does not fit this training: {reason(error)}") from error


def _settings(model: Any, training: Training) -> dict[str, Any]:
    return asdict(training) | {"seed": model.seed}


def _pack(arrays: dict[str, NDArray[Any]], value: Any) -> dict[str, str]:
    """Put a tensor or an array into `arrays`; return a JSON value in its place."""
    name = str(len(arrays))
    arrays[name] = np.asarray(value)
    return {"tensor" if isinstance(value, torch.Tensor) else "array": name}


def _unpack(arrays: Mapping[str, NDArray[Any]], table: dict[str, Any]) -> Any:
    """Return the tensor or array that a table of `_pack` stands for. In other tables, convert keys of digits to int."""
    match table:
        case {"tensor": name}:
            return torch.from_numpy(arrays[name])
        case {"array": name}:
            return arrays[name][()]
    return {int(key) if key.isdigit() else key: value for key, value in table.items()}
