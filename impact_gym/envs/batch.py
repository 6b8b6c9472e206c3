"""The batch that every environment class uses: arrays with a row for each environment. Compiled code steps the rows."""

from collections.abc import Mapping, Sequence
from functools import cache, partial
from hashlib import sha256
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from impact_gym import kernels
from impact_gym.envs.infos import Infos
from impact_gym.outcome import Trace
from impact_gym.simulation import MAX_STEPS
from impact_gym.support.threads import CORES, over_rows
from impact_gym.support.validation import array, fits_memory, number, one_of, whole
from impact_gym.task.episodes import EpisodeState, first_uniforms, records_with
from impact_gym.task.observation import ObservationSpec, place
from impact_gym.task.pack_task import pack_task
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import PLACES, Task
from impact_gym.teleop.operators import Person

if TYPE_CHECKING:
    from impact_gym.render.film import History

ROWS_PER_THREAD = 256
"""If several threads share the rows, each gets at least this number; with smaller shares, one thread is faster."""

_STATE = (
    "draws", "models", "chains", "episodes", "readings", "ranges", "links", "packets", "observations", "rewards",
    "traces",
)  # fmt: skip
TRACE_INTERVAL = 1e-3  # s, largest time between two points of a trace while tool and object do not touch
INTERVENTION = 1e-3  # m/s; `is_intervention` is true if commanded and executed velocity differ by more than this
_SPARE = 4  # additional places for readings, because a step stores new readings before it delivers older ones


_dtype_text = cache(str)
"""Text of a dtype. Without the cache, most of the time of `get_state` and `set_state` would be spent on these texts."""


class Bodies(NamedTuple):
    """Present time, positions and deflections of all rows; each array is (rows,)."""

    time: NDArray[np.float64]  # s
    flange: NDArray[np.float64]  # m, position
    tool: NDArray[np.float64]  # m, position
    object: NDArray[np.float64]  # m, position
    deflection: NDArray[np.float64]  # m, displacement of the tool relative to its flange
    deflection_rate: NDArray[np.float64]  # m/s
    touched: NDArray[np.bool_]


class Batch:
    """`size` independent environments, one for each row of the arrays; `size` and `threads` do not change results."""

    def __init__(
        self, size: int, task: Task | Sequence[Task], threads: int | None = None, trace_points: int = 0,
        max_steps: int = MAX_STEPS,
    ) -> None:  # fmt: skip
        """Make a batch.

        Args:
            size: number of rows.
            task: one task for all rows, or one for each row; all must observe the same numbers, scaled equally.
            threads: number of threads; None: one for each core.
            trace_points: largest number of points in the time histories of a row; 0: no time histories.
            max_steps: integration steps after which the solver gives up an episode.
        """
        tasks = [task] if isinstance(task, Task) else list(task)
        if len(tasks) not in {1, size}:
            raise ValueError(f"a batch of {size} rows needs one task for all rows, or {size} tasks, got {len(tasks)}")
        self.tasks, self.size = tasks, size
        self.threads = CORES if threads is None else whole("threads", threads, at_least=1)
        self.max_steps = max_steps
        self.spec = ObservationSpec.of_rows(tasks)
        delays = [(each.longest("reaction_delay"), each.control_period) for each in tasks]
        slots = max(int(kernels.readings_in_transit(*each)) for each in delays) + _SPARE
        sensing = [each for each in tasks if each.range_sensor]
        periods = (each.longest("range_sensor.delay") / each.control_period for each in sensing)
        range_slots = int(max(periods, default=0.0)) + _SPARE
        packets = max(each.link.packets(each.horizon, each.control_period) if each.link else 0 for each in tasks)
        self.action_spec, linked = tasks[0].action, size if packets else 0
        each_row = kernels.CHAIN.itemsize + kernels.EPISODE.itemsize + slots * kernels.READING.itemsize
        each_row += packets * kernels.PACKET.itemsize + 4 * len(self.spec)
        each_row += range_slots * kernels.RANGE_READING.itemsize if sensing else 0
        fits_memory("num_envs", size, each_row)
        self.chains = np.zeros(size, kernels.CHAIN)
        self.episodes = np.zeros(size, kernels.EPISODE)
        self.readings = np.zeros((size, slots), kernels.READING)
        self.ranges = np.zeros((size if sensing else 0, range_slots), kernels.RANGE_READING)
        self.links, self.packets = np.zeros(linked, kernels.LINK), np.zeros((linked, packets), kernels.PACKET)
        self.observations = np.zeros((size, len(self.spec)), np.float32)
        self.rewards = np.zeros(size)
        self.traces = np.empty((size, trace_points), kernels.TRACE)
        self._begun = False  # whether each row is known to have had an episode
        self._pack(tasks)
        self._infos = Infos(tasks)
        self._make_rows()

    def _pack(self, tasks: Sequence[Task]) -> None:
        records, draws, tables, numbers = [], list[tuple[Any, ...]](), [], 0
        for task in tasks:
            record, its_draws, table = pack_task(task, len(draws), numbers)
            records.append(record)
            draws += its_draws
            tables.append(table)
            numbers += len(table)
        self._tasks, self.draws = np.concatenate(records), np.array(draws, kernels.DRAW)
        self._limits = np.array([(task.force_limit, task.velocity_limit) for task in tasks], np.float64)
        self._drawn = self.draws.copy()  # `set_scenario` changes `draws`
        self._tables, self._entries = np.concatenate(tables), self.spec.pack()
        self.models = kernels.models_of(np.ascontiguousarray(self._tasks["mount"]))
        if self._tasks["mount_drawn"].any():
            self.models = np.resize(self.models, self.size)

    def _make_rows(self) -> None:
        draws, models, *arrays, traces = (getattr(self, name) for name in _STATE)
        recorder = np.empty(0, kernels.CONTACT), traces, np.empty(0), TRACE_INTERVAL
        shared = self._entries, recorder, self.max_steps, len(self.action_spec)
        self._rows = kernels.Rows(self._tasks, draws, models, self._tables, *arrays, *shared)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_rows"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._make_rows()

    def set_scenario(self, scenario: ScenarioRanges | Mapping[str, Any] | str) -> None:
        """From the next episode on, draw scenarios from these ranges; ValueError if all distances are out of reach."""
        ranges = ScenarioRanges.of(scenario)
        for task in self.tasks:
            task.check_distance(ranges.distance[0])
        for name, (low, high) in ranges.by_id().items():
            rows = self.draws["index"] == PLACES[name]
            self.draws["low"][rows], self.draws["high"][rows] = low, high

    def begin(
        self, rows: NDArray[np.int64], draws: NDArray[np.float64] | list[np.random.Generator],
        fixed: NDArray[Any] | None = None,
    ) -> None:  # fmt: skip
        """Begin an episode in each of `rows` (k,).

        Args:
            rows: indices of the rows.
            draws: uniform numbers in [0, 1) for each of `rows` (k, UNIFORMS); or the random generators of all rows of
                the batch.
            fixed: records (k,) of fixed numbers, see `task.episodes`; numbers that are nan are drawn; None: draw all.
        """
        if isinstance(draws, list):
            generators, draws = draws, np.empty((len(rows), kernels.UNIFORMS))
            kernels.draw_uniforms(generators, rows, draws)
        self._rows.begin(rows, np.ascontiguousarray(draws), fixed)

    def begin_seeded(self, seed: int, fixed: Mapping[str, ArrayLike], copies: int = 1) -> None:
        """Begin an episode in every row, with the random numbers of an environment's first episode after seeding.

        The rows are `copies` groups of equal size; row k of each group has the seed `seed` + k. Numbers in `fixed`, by
        id, are not drawn; a value is one number for all rows or an array (size,).
        """
        uniforms = np.tile(first_uniforms(seed, self.size // copies), (copies, 1))
        self.begin(np.arange(self.size), uniforms, records_with(self.size, fixed))

    def step(self, actions: Any, skip: NDArray[np.bool_], shape: tuple[int, ...] | None = None) -> None:
        """Play a control step in all rows but those in `skip`; results are in `observations`, `rewards`, `episodes`.

        Args:
            actions: floats or integers, clipped to [-1, 1]; for their meaning see `action_spec`.
            skip: flags (size,), True for a row that is not stepped.
            shape: required shape of `actions`; None: (size, `len(action_spec)`).

        Raises:
            TypeError, ValueError: `actions` are not numbers, not finite or of another shape; no row was stepped.
        """
        given = array("action", actions, shape or (self.size, len(self.action_spec)))
        values = given.astype(np.float64, "C").reshape(self.size, -1)
        if not np.isfinite(values).all():
            row = np.isfinite(values).all(axis=1).argmin()
            field = "action" if shape else f"action[{row}]"
            raise ValueError(f"{field} must be finite (no unit), got {values[row]}: no step was made")
        over_rows(partial(self._rows.step, values, skip), self.size, self.threads, ROWS_PER_THREAD)

    def check_begun(self, call: str) -> None:
        """Raise ResetNeeded, which names `call`, if a row has had no episode; its object then has no mass."""
        self._begun = self._begun or bool(self.episodes["drawn"]["object_mass"].all())
        if not self._begun:
            raise ResetNeeded(f"there is no episode yet: call reset before {call}")

    def set_operator_velocity(self, velocities: ArrayLike) -> None:
        """Let the operators, each a `Person`, command `velocities` (m/s), a number or (size,), in this episode."""
        for task in self.tasks:
            one_of("operator", task.operator, Person)
        self.check_begun("command")
        lows, highs = zip(*(task.velocity_range for task in self.tasks), strict=True)
        given = array("command", velocities)
        for velocity in np.atleast_1d(array("command", given, (self.size,) * given.ndim, what="velocities (m/s)")):
            number("command", velocity, "m/s", at_least=max(lows), at_most=min(highs))
        self.links["person_command"] = velocities

    def get_state(self, **more: Any) -> dict[str, Any]:
        """Return a copy of the state for `set_state`, with the additional entries `more`."""
        state = {name: getattr(self, name).copy() for name in _STATE} | more
        return state | {"sha256": self._digest(state)}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state that `get_state` returned.

        Raises:
            ValueError: the state was altered, or its batch has another size, task or trace length; nothing was changed.
        """
        one_of("state", state, Mapping)
        for name in _STATE:
            own = getattr(self, name)
            array(f"{name} of a state", state.get(name), own.shape, own.dtype.kind, _dtype_text(own.dtype))
        if state.get("sha256") != self._digest(state):
            about = "must match its arrays, generators and tasks: the state was altered, or belongs to another batch"
            raise ValueError(f"sha256 of a state {about}")
        self._begun = False
        for name in _STATE:
            getattr(self, name)[:] = state[name]

    def _digest(self, state: Mapping[str, Any]) -> str:
        rest = {name: value for name, value in state.items() if name not in (*_STATE, "sha256")}
        total = sha256(repr(rest).encode())
        of_tasks = self._tasks, self._limits, self._drawn, self._tables, self._entries
        for values in (*of_tasks, *(np.asarray(state[name]) for name in _STATE)):
            total.update(_dtype_text(values.dtype).encode() + values.tobytes())
        return total.hexdigest()

    def info(self, rows: int | NDArray[np.int64] | None = None) -> dict[str, Any]:
        """Return the entries of the final info with their present values.

        For a single row, given as an int, the values are Python values. For several rows (None: all) the values are
        arrays (size,), with 0, False or None in other rows.
        """
        if isinstance(rows, int):
            return self.infos(np.array([rows]))[0]
        return self._infos.columns(self.episodes, self.chains, np.arange(self.size) if rows is None else rows)

    def infos(self, rows: NDArray[np.int64]) -> list[dict[str, Any]]:
        """Return the info of each of `rows`, with Python values."""
        return self._infos.infos(self.episodes, self.chains, rows)

    def step_columns(self) -> dict[str, NDArray[Any]]:
        """Return the entries that limits and an operator add to a step's info, (size,) or (size, 1)."""
        costs = self._infos.costs(self.episodes)
        if not len(self.links):
            return costs
        sensors, obeyed = self.episodes["sensors"], self.links["effective"].copy()
        executed = sensors["executed"].copy()
        return costs | {
            "command": sensors["command"].copy(), "command_age": sensors["command_age"].copy(),
            "is_intervention": np.abs(executed - obeyed) > INTERVENTION,
            "teleop_action": obeyed[:, None], "intervene_action": executed[:, None],
        }  # fmt: skip

    def step_infos(self) -> list[dict[str, Any]]:
        """Return the entries of `step_columns` for each row, as Python values and arrays (1,)."""
        if not (columns := self.step_columns()):
            return [{} for _ in range(self.size)]
        lists = {name: list(column) if column.ndim > 1 else column.tolist() for name, column in columns.items()}
        return [{name: values[row] for name, values in lists.items()} for row in range(self.size)]

    def sensors(self) -> dict[str, NDArray[np.float64]]:
        """Return the sensor values of all rows in SI units, each (size,); see `ImpactApproachEnv.sensors`."""
        self.check_begun("sensors")
        now = self.episodes.view(np.float64).reshape(self.size, -1)
        return {name: now[:, place(name)].copy() for name in self.spec.sensors}

    def trace(self, row: int) -> Trace:
        """Return the time histories of the episode of `row` so far, at most `trace_points` points."""
        return Trace.of(self.traces[row, : int(self.chains["traced"][row])])

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Whether the episode of each row (size,) has terminated or was truncated."""
        return np.asarray((self.episodes["terminated"] == 1) | (self.episodes["truncated"] == 1))

    def episode_state(self, row: int) -> EpisodeState:
        """Return the times (s) of detection, alarm, end of the alarm and end of the episode in `row`."""
        task, episode = self.tasks[row % len(self.tasks)], self.episodes[row]
        detection, alarm, over = float(self.chains["detection"][row]), float(episode["last_alarm"]), np.inf
        if task.alarm == "force":
            alarm = detection + float(episode["drawn"]["reaction_delay"])
        else:
            over = alarm + task.after_alarm
        return EpisodeState(detection, alarm, over, float(episode["done_time"]) if self.ended[row] else np.inf)

    def bodies(self) -> Bodies:
        """Return the present `Bodies`; with a compliant robot and a rigid coupling the flange moves with the tool."""
        chains, with_tool = self.chains, np.resize(self.models["with_tool"], self.size)
        tool = chains["flange_position"] + chains["deflection"]
        flange = np.where(with_tool, tool, chains["flange_position"] + chains["flange_offset"])
        deflection = chains["deflection"] - chains["flange_offset"]
        rate = chains["deflection_rate"] - chains["flange_offset_rate"]
        object_position = tool - chains["penetration"]
        return Bodies(chains["time"].copy(), flange, tool, object_position, deflection, rate, chains["contacts"] > 0)

    def history(self, row: int) -> "History":
        """Return the episode of `row` so far, for `impact_gym.render`."""
        from impact_gym.render.film import History

        task, ended = self.tasks[row % len(self.tasks)], bool(self.episodes["terminated"][row])
        return History(self.trace(row), self.info(row), task, self.episode_state(row), ended)
