"""Write and restore checkpoints: a training resumed from one ends as if it had not been interrupted.

A checkpoint is taken between two rollouts, when the rollout buffer is empty. It holds the networks, optimisers and
counters, the random states of torch, NumPy and Python, the environments with their generators, and the values that the
log has not written yet. The file is an archive instead of torch's format: `torch.load(weights_only=True)` would need
private names of NumPy, and does not detect a damaged file.
"""

import json
import random
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.archive import read_archive, write_archive
from agents.setups import Training
from agents.train.scaling import ScaledRewards

FORMAT = "impact_gym checkpoint 3"
# stable-baselines3 2.9 has no public access to these attributes; a test checks that resuming changes no bit
COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")


def write(
    path: Path, model: Any, environment: ScaledRewards, callback_state: Mapping[str, Any], training: Training
) -> None:
    """Write a checkpoint of a model of stable-baselines3, its `environment` and the callback's state atomically."""
    arrays: dict[str, NDArray[Any]] = {}
    state = {
        "model": {
            "parameters": model.get_parameters(),
            "variables": {name: getattr(model, name) for name in model._get_torch_save_params()[1]},
            "counters": {name: getattr(model, name) for name in COUNTERS},
            "last": (model._last_obs, model._last_episode_starts),
        },
        "environment": environment.get_state(),
        "random": {"torch": torch.get_rng_state(), "numpy": np.random.get_state(), "python": random.getstate()},  # noqa: NPY002 - stable-baselines3 draws from it
        "log": [dict(values) for values in _unwritten(model)],
        "callback_state": dict(callback_state),
    }
    write_archive(path, FORMAT, {"settings": asdict(training), "state": _pack(state, arrays)}, arrays)


def restore(path: Path, model: Any, environment: ScaledRewards, training: Training) -> dict[str, Any]:
    """Restore `model` and `environment`, which were made from the same settings; return the state of the callback.

    Raises:
        ValueError: the file is no checkpoint, is damaged, or is a checkpoint of another model.
    """
    content, arrays = read_archive(path, FORMAT)
    state = _unpack(content["state"], arrays)
    try:
        of_model = state["model"]
        model.set_parameters(of_model["parameters"])
        with torch.no_grad():
            for name, value in of_model["variables"].items():
                getattr(model, name).copy_(value)
        for name, value in of_model["counters"].items():
            setattr(model, name, value)
        model._last_obs, model._last_episode_starts = of_model["last"]
        environment.set_state(state["environment"])
        torch.set_rng_state(state["random"]["torch"])
        np.random.set_state(state["random"]["numpy"])  # noqa: NPY002 - stable-baselines3 draws from it
        random.setstate(state["random"]["python"])
    except (LookupError, TypeError, ValueError, RuntimeError) as error:
        before, now = content.get("settings", {}), json.loads(json.dumps(asdict(training)))
        changed = [name for name in now if name in before and before[name] != now[name]]
        differs = ", ".join(f"{name} is {before[name]!r} in the checkpoint, got {now[name]!r}" for name in changed)
        reason = differs or " ".join(str(error).split())  # torch's messages have several lines
        raise ValueError(f"{path} is a checkpoint of another training: {reason}") from error
    for values, kept in zip(_unwritten(model), state["log"], strict=True):
        values.clear()
        values.update(kept)
    return state["callback_state"]


def _unwritten(model: Any) -> tuple[dict[str, Any], ...]:
    return model.logger.name_to_value, model.logger.name_to_count, model.logger.name_to_excluded


def _pack(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return `value` as JSON; its tensors and arrays are put into `arrays`, and their names stand in their place."""
    match value:
        case torch.Tensor():
            name = f"tensor_{len(arrays)}"
            arrays[name] = value.detach().numpy()
            return {"tensor": name}
        case np.ndarray():
            name = f"array_{len(arrays)}"
            arrays[name] = value
            return {"array": name}
        case Mapping():
            return {"items": [[key, _pack(part, arrays)] for key, part in value.items()]}
        case tuple() | list():
            return {type(value).__name__: [_pack(part, arrays) for part in value]}
        case np.generic():
            return {"scalar": _pack(np.asarray(value), arrays)["array"]}
        case None | str() | int() | float():
            return value
    raise TypeError(f"a checkpoint cannot hold {type(value)}")


def _unpack(tree: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    """Return the value that `_pack` turned into `tree`."""
    match tree:
        case {"items": pairs}:
            return {key: _unpack(part, arrays) for key, part in pairs}
        case {"tuple": parts}:
            return tuple(_unpack(part, arrays) for part in parts)
        case {"list": parts}:
            return [_unpack(part, arrays) for part in parts]
        case {"scalar": name}:
            return arrays[name][()]
        case {"tensor": name}:
            return torch.from_numpy(arrays[name])
        case {"array": name}:
            return arrays[name]
    return tree
