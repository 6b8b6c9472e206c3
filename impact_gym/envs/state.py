"""Checks of a batch's state that a caller sets, before it reaches the compiled program."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym import kernels
from impact_gym.quantities import QUANTITIES
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import PLACES
from impact_gym.to_kernel import STATUS_MESSAGES
from impact_gym.validation import shown

LARGEST = 2**53  # of whole numbers
LONGEST = 1e4  # s, of an episode with its settling
WHOLE = {
    "chains.pressed": (-1, 1), "chains.side": (-1, 1), "episodes.status": (min(STATUS_MESSAGES), max(STATUS_MESSAGES)),
    **dict.fromkeys(("chains.status", "chains.memory.method"), (-2, 5)),
    **dict.fromkeys(("chains.object_state", "chains.touching", "chains.holding", "episodes.terminated"), (0, 1)),
    **dict.fromkeys(("episodes.truncated", "links.expired", "links.stopped"), (0, 1)),
    **dict.fromkeys(("links.uplink_lost", "links.downlink_lost"), (0, 1)),
}  # fmt: skip
"""Least and largest whole numbers of a state; of others 0 and LARGEST."""


def taken(state: Any, name: str, like: NDArray[Any]) -> NDArray[Any]:
    """Return the array `name` of a state, which must have the shape and dtype of `like`, or raise ValueError."""
    value = state.get(name) if isinstance(state, Mapping) else None
    if not isinstance(value, np.ndarray) or value.shape != like.shape or value.dtype != like.dtype:
        got = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else shown(value)
        raise ValueError(f"{name} of a state must be an array {like.dtype} {like.shape}, got {got}")
    return value


def require(field: str, values: NDArray[Any], good: Any, allowed: str) -> None:
    """Raise ValueError with the first of `values` that is not `good`; both of one shape."""
    if not np.all(good):
        place = tuple(np.argwhere(~np.asarray(good))[0].tolist())
        raise ValueError(f"{field}{list(place)} of a state must be {allowed}, got {shown(values[place], 40)}")


def numbers(name: str, array: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the fields of an array of records, with dotted names."""
    if array.dtype.names is None:
        yield name, array
    for field in array.dtype.names or ():
        yield from numbers(f"{name}.{field}", array[field])


def check(here: Mapping[str, NDArray[Any]], there: Mapping[str, NDArray[Any]], tasks: Any, max_steps: int) -> None:
    """Check the arrays of a state `there` for a batch with the arrays `here` and `tasks` (n,), TASK.

    Raises:
        ValueError: a number is out of range; names field, value and the allowed range.
    """
    draws, episodes, chains, links = (there[name] for name in ("draws", "episodes", "chains", "links"))
    drawn, failed = episodes["drawn"], episodes["status"] < 0
    begun = drawn["object_mass"] != 0.0
    columns, fixed = (
        np.array(records).view(np.float64).reshape(len(drawn), -1)
        for records in (drawn, np.resize(tasks["numbers"], len(drawn)))
    )
    for name in ("episodes", "chains", "readings", "ranges", "links", "packets", "observations", "rewards"):
        for field, values in numbers(name, there[name]):
            least, largest = WHOLE.get(field, (0, LARGEST))
            if values.dtype == np.int64:
                require(field, values, (values >= least) & (values <= largest), f"{least} to {largest}")
            elif len(values):
                require(field, values.T, ~np.isnan(values.T) | failed, "a number")
    for name in draws.dtype.names or ():
        free = np.isin(draws["place"], [PLACES[field] for field in FIELDS]) & (name in ("low", "high"))
        require(f"draws.{name}", draws[name], free | (draws[name] == here["draws"][name]), "that of this batch")
    for field in [field for field, place in PLACES.items() if place in draws["place"]]:
        (above, least, largest), unit = QUANTITIES[field].limits, QUANTITIES[field].unit
        values, ways = columns[:, PLACES[field]], draws["place"] == PLACES[field]
        for what, low, high in (("episodes.drawn", values, values), ("draws", draws["low"][ways], draws["high"][ways])):
            inside = (low > above) & (low >= least) & (low <= high) & (high <= largest)
            good = inside | ~begun | (values == fixed[:, PLACES[field]]) if what != "draws" else inside
            require(f"{what}.{field}", low, good, f"above {above:g} and {least:g} to {largest:g} {unit}")
    under_way, slots = episodes["pushed"] - episodes["popped"], there["readings"].shape[1]
    kept = (under_way >= 0) & (under_way <= slots)
    require("episodes.popped", episodes["popped"], kept, f"up to {slots} below pushed")
    if len(there["ranges"]):
        under_way, slots = episodes["ranges_taken"] - episodes["ranges_delivered"], there["ranges"].shape[1]
        kept = (under_way >= 0) & (under_way <= slots)
        require("episodes.ranges_delivered", episodes["ranges_delivered"], kept, f"up to {slots} below ranges_taken")
    require("chains.steps", chains["steps"], chains["steps"] <= 2 * max_steps, f"at most {2 * max_steps}")
    require("chains.time", chains["time"], failed | (np.abs(chains["time"]) <= LONGEST), f"at most {LONGEST:g} s")
    for name in ("oldest", "seen_packet"):
        require(f"links.{name}", links[name], links[name] <= links["packets"], "at most links.packets")
    laws, mounts = np.ascontiguousarray(there["laws"]), np.resize(tasks["mount"], len(there["laws"])).copy()
    if len(laws) == len(begun):
        for name in ("tool_mass", "coupling", "robot"):
            mounts[name][begun] = drawn[name][begun]
    same = laws.view(np.uint8) == kernels.laws_of(np.ascontiguousarray(mounts)).view(np.uint8)
    require("laws", laws, same.reshape(len(laws), -1).all(axis=1), "those of the mounts in episodes.drawn")
