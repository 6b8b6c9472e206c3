"""The batch behind every front end: arrays of rows and the kernels that move them."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym import kernels
from impact_gym.envs.infos import Infos, command_columns
from impact_gym.envs.state import check, taken
from impact_gym.operators import Person
from impact_gym.outcome import Trace
from impact_gym.simulation import MAX_STEPS
from impact_gym.task.episodes import first_uniforms, fix, free_records
from impact_gym.task.observation import ObservationSpec
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.steering import packets_under_way
from impact_gym.task.task import PLACES, Task
from impact_gym.threads import cores, over_rows
from impact_gym.validation import array, fits_memory, number, one_of, whole

ROWS_PER_THREAD = 256
"""A batch is cut for several threads only into pieces of at least this many rows: smaller ones do not pay."""

_STATE = ("draws", "laws", "chains", "episodes", "readings", "links", "packets", "observations", "rewards", "traces")
TRACE_INTERVAL = 1e-3  # s, between points of a trace in flight
_SPARE = 4  # readings beyond those under way: some are taken before the oldest is due


class ToolMotion(NamedTuple):
    """How tools move against their flanges, (rows,) each."""

    time: NDArray[np.float64]  # s
    deflection: NDArray[np.float64]  # m
    deflection_rate: NDArray[np.float64]  # m/s
    touched: NDArray[np.bool_]


class Bodies(NamedTuple):
    """Where flanges, tools and objects are (m), and whether an object has been touched, (rows,) each."""

    time: NDArray[np.float64]  # s
    flange: NDArray[np.float64]
    tool: NDArray[np.float64]
    object: NDArray[np.float64]
    touched: NDArray[np.bool_]


class Batch:
    """`size` environments, each a row that no other row can touch.

    The results of a row do not depend on the size of the batch, on its place in it or on the number of threads.
    """

    def __init__(
        self, size: int, task: Task | Sequence[Task], threads: int | None = None, trace_points: int = 0,
        max_steps: int = MAX_STEPS,
    ) -> None:  # fmt: skip
        """Make a batch.

        Args:
            size: how many rows.
            task: of all rows, or one for each: these may differ in tool, coupling, robot, alarm threshold, noise,
                scenarios and whatever else does not change what is observed.
            threads: how many to use, None for all cores; changes no result.
            trace_points: how many are kept of the time histories of each row's episode.
            max_steps: integration steps after which the solver gives up an episode.

        Raises:
            ValueError: there is not one task for each row, or they observe different things.
        """
        tasks = [task] if isinstance(task, Task) else list(task)
        if len(tasks) not in {1, size}:
            raise ValueError(f"a batch of {size} rows needs one task for all or {size} of them, got {len(tasks)}")
        self.tasks = tasks
        self.size = size
        self.threads = cores() if threads is None else whole("threads", threads, at_least=1)
        self.max_steps = max_steps
        self.spec = ObservationSpec.of_rows(tasks)
        slots = max(each.readings_under_way() for each in tasks) + _SPARE
        packets, self.commanded = max(map(packets_under_way, tasks)), len(tasks[0].actions)
        linked = size if packets else 0
        each_row = kernels.CHAIN.itemsize + kernels.EPISODE.itemsize + slots * kernels.READING.itemsize
        each_row += packets * kernels.PACKET.itemsize + 4 * len(self.spec)
        fits_memory("num_envs", size, each_row)
        self.chains = np.zeros(size, kernels.CHAIN)
        self.episodes = np.zeros(size, kernels.EPISODE)
        self.readings = np.zeros((size, slots), kernels.READING)
        self.links, self.packets = np.zeros(linked, kernels.LINK), np.zeros((linked, packets), kernels.PACKET)
        self.observations = np.zeros((size, len(self.spec)), np.float32)
        self.rewards = np.zeros(size)
        self.traces = np.empty((size, trace_points), kernels.TRACE)
        self._lower(tasks)
        self._infos = Infos(tasks)
        self._make_rows()

    def _lower(self, tasks: Sequence[Task]) -> None:
        """Write the tasks for the compiled program: rules, what is drawn, laws of what holds the tools, and tables."""
        records, tables, numbers = [], [], 0
        draws: list[tuple[Any, ...]] = []
        for task in tasks:
            record, table = task.lowered(len(draws), numbers)
            records.append(record)
            draws += task.draws()
            tables.append(table)
            numbers += len(table)
        self._lowered, self.draws = np.concatenate(records), np.array(draws, kernels.DRAW)
        self._tables, self._entries = np.concatenate(tables), self.spec.lowered()
        self.laws = kernels.laws_of(np.ascontiguousarray(self._lowered["mount"]))
        if any(task.draws_mount for task in tasks):
            self.laws = np.resize(self.laws, self.size)

    def _make_rows(self) -> None:
        """Hand the arrays to the kernels."""
        draws, laws, *arrays, traces = (getattr(self, name) for name in _STATE)
        recorder = np.empty(0, kernels.CONTACT), traces, np.empty(0), TRACE_INTERVAL
        shared = self._entries, recorder, self.max_steps, self.commanded
        self._rows = kernels.Rows(self._lowered, draws, laws, self._tables, *arrays, *shared)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_rows"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._make_rows()

    def set_scenario(self, ranges: ScenarioRanges) -> None:
        """Draw scenarios from `ranges` from the next episode on, in all rows.

        Raises:
            ValueError: a row can reach none of their objects.
        """
        for task in self.tasks:
            task.check_distance(ranges.distance[0])
        for name, (low, high) in ranges.by_id().items():
            rows = self.draws["place"] == PLACES[name]
            self.draws["low"][rows], self.draws["high"][rows] = low, high

    def begin(self, rows: NDArray[np.int64], uniforms: NDArray[np.float64], fixed: NDArray[Any]) -> None:
        """Begin an episode in each of `rows` (k,).

        Args:
            rows: which.
            uniforms: numbers in [0, 1) that they draw with (k, UNIFORMS).
            fixed: records (k,), nan where they draw, see `task.episodes`.
        """
        self._rows.begin(rows, np.ascontiguousarray(uniforms), fixed)

    def begin_seeded(self, seed: int, fixed: Mapping[str, ArrayLike], copies: int = 1) -> None:
        """Begin in row k the first episode of the seed `seed` + k, but for what is `fixed`: by id, for all or for each.

        With several `copies` the rows are that many times the same seeds.
        """
        uniforms = np.tile(first_uniforms(seed, self.size // copies), (copies, 1))
        self.begin(np.arange(self.size), uniforms, fix(free_records(self.size), fixed))

    def draw_and_begin(
        self, rows: NDArray[np.int64], generators: list[np.random.Generator], fixed: NDArray[Any] | None = None
    ) -> None:
        """Begin an episode in each of `rows` (k,), each with its own generator; `fixed` (k,) as in `begin`."""
        uniforms = np.empty((len(rows), kernels.UNIFORMS))
        kernels.draw_uniforms(generators, rows, uniforms)
        self.begin(rows, uniforms, free_records(len(rows)) if fixed is None else fixed)

    def step(self, actions: NDArray[Any], skip: NDArray[np.bool_]) -> None:
        """Play a control step with `actions` (size, 2 or 3), of any float type, but where `skip` (size,) is set.

        Leaves `observations`, `rewards` and the fields of `episodes` as they are after it.
        """
        commands = np.ascontiguousarray(actions, np.float64)

        def run(first: int, last: int) -> None:
            self._rows.step(commands, skip, first, last)

        over_rows(run, self.size, self.threads, ROWS_PER_THREAD)

    def commands(self, actions: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return `actions`, which must have `shape`, as an array (size, n), or raise before anything is stepped.

        Raises:
            TypeError, ValueError: not numbers, another shape, or not finite.
        """
        commands = np.ascontiguousarray(array("action", actions, shape), np.float64).reshape(self.size, self.commanded)
        if not np.isfinite(commands).all():
            wrong = commands[~np.isfinite(commands).all(axis=1)][0]
            raise ValueError(f"action must be finite (no unit), got {wrong}: nothing was moved")
        return commands

    def command(self, velocities: ArrayLike) -> None:
        """Have a `Person` command `velocities` (m/s), one for all rows or (size,), from the next ticks on.

        Raises:
            TypeError, ValueError: somebody else commands, or not numbers that the arm can follow.
        """
        for task in self.tasks:
            one_of("operator", task.operator, Person)
        lows, highs = zip(*(task.velocity_range for task in self.tasks), strict=True)
        limits: Any = {"at_least": max(lows), "at_most": min(highs)}
        for velocity in np.atleast_1d(array("command", velocities)):
            number("command", velocity, "m/s", **limits)
        self.links["given"] = velocities

    def get_state(self) -> dict[str, Any]:
        """Return a copy of all that `step` and `begin` go on from."""
        return {name: getattr(self, name).copy() for name in _STATE}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from what `get_state` of a batch of this size and task returned, to the bit.

        Raises:
            ValueError: an array is not one that this batch can come to; it is as it was then.
        """
        here = {name: getattr(self, name) for name in _STATE}
        check(here, {name: taken(state, name, here[name]) for name in _STATE}, self._lowered, self.max_steps)
        for name in _STATE:
            getattr(self, name)[:] = state[name]

    def info(self, row: int | None = None) -> dict[str, Any]:
        """Return the entries of the final info as they stand: plain numbers of one row, or arrays (size,) of all."""
        return self.info_columns(np.arange(self.size)) if row is None else self.infos(np.array([row]))[0]

    def infos(self, rows: NDArray[np.int64]) -> list[dict[str, Any]]:
        """Return the info of each of `rows`."""
        return self._infos.infos(self.episodes, self.chains, rows)

    def info_columns(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        """Return the infos of `rows` as arrays (size,), blank elsewhere."""
        return self._infos.columns(self.episodes, self.chains, rows)

    def link_columns(self) -> dict[str, NDArray[Any]]:
        """Return the entries of the info of every step, arrays (size, ...); none without an operator."""
        return command_columns(self.episodes, self.links) if len(self.links) else {}

    def link_infos(self) -> list[dict[str, Any]]:
        """Return these entries of each row, plain numbers and arrays (1,)."""
        columns = self.link_columns()
        lists = (list(column) if column.ndim > 1 else column.tolist() for column in columns.values())
        rows = zip(*lists, strict=True) if columns else iter([()] * self.size)
        return [dict(zip(columns, row, strict=True)) for row in rows]

    def sensors(self) -> dict[str, NDArray[np.float64]]:
        """Return what the controllers may know now, in SI units (size,) each; see `ImpactApproachEnv.sensors`."""
        now = self.episodes.view(np.float64).reshape(self.size, -1)
        places = {name: self.spec.entries[self.spec.index(name)].place for name in self.spec.sensors}
        return {name: now[:, place].copy() for name, place in places.items()}

    def trace(self, row: int) -> Trace:
        """Return the time histories of the episode of `row` so far, as many points as are kept."""
        return Trace.of(self.traces[row, : int(self.chains["traced"][row])])

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Whether the episode of each row (size,) has terminated or was truncated."""
        return np.asarray((self.episodes["terminated"] == 1) | (self.episodes["truncated"] == 1))

    def bodies(self) -> Bodies:
        """Return where everything is now; with a compliant robot and a rigid coupling the flange is with the tool."""
        chains, with_tool = self.chains, np.resize(self.laws["with_tool"], self.size)
        tool = chains["flange_position"] + chains["deflection"]
        flange = np.where(with_tool, tool, chains["flange_position"] + chains["flange_offset"])
        return Bodies(chains["time"].copy(), flange, tool, tool - chains["penetration"], chains["contacts"] > 0)

    def tool_motion(self) -> ToolMotion:
        """Return how the tools move against their flanges, and whether they have touched."""
        chains = self.chains
        return ToolMotion(
            chains["time"].copy(),
            chains["deflection"] - chains["flange_offset"],
            chains["deflection_rate"] - chains["flange_offset_rate"],
            chains["contacts"] > 0,
        )
