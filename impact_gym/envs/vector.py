"""The batch as a Gymnasium vector environment; compiled code steps all environments."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Space
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from impact_gym.envs.batch import Batch
from impact_gym.envs.single import TRACE_POINTS, ImpactApproachEnv, steps_per_second
from impact_gym.support.validation import array, choice, one_of, shown, whole
from impact_gym.task.episodes import reset_options
from impact_gym.task.task import Task

MOST_DRAWN = 16  # largest number of environments in a batch with a render_mode

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


class ImpactApproachVectorEnv(VectorEnv[Floats, Floats, NDArray[Any]]):
    """`num_envs` environments (slots) like `ImpactApproachEnv`; a reset with seed s gives slot i the seed s + i.

    The class takes the arguments of `ImpactApproachEnv`, except `record_trace`, and these:

    - `autoreset_mode`: with NEXT_STEP, the default, the step after the last step of an episode ignores the action,
      starts the next episode and has the reward 0. With SAME_STEP the last step itself starts the next episode; the
      last observation and info, with `cost`, are in `infos["final_obs"]` and `infos["final_info"]`. With DISABLED the
      user resets slots by `reset(options={"reset_mask": ...})`.
    - `render_mode`: None or, for at most 16 environments, "rgb_array".
    - `threads`: number of threads, which changes no result.
    - `per_slot`: for each slot a mapping of arguments that differ in this slot. Slots must observe the same numbers.
    - `max_episode_steps`: number of control steps after which an episode is truncated.

    `set_scenario` and `sensors` are methods of `Batch`, and `command` is its method `set_operator_velocity`.
    `call`, `get_attr` and `set_attr` are those of Gymnasium's vector environments.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        per_slot: Sequence[Mapping[str, Any]] | None = None,
        **arguments: Any,  # arguments of `Task`
    ) -> None:
        choice("render_mode", render_mode, (None, "rgb_array"))
        self.num_envs = whole("num_envs", num_envs, at_least=1)
        if render_mode is not None and self.num_envs > MOST_DRAWN:
            raise ValueError(f"num_envs must be at most {MOST_DRAWN} with a render_mode, got {self.num_envs}")
        self.render_mode = render_mode
        if not isinstance(autoreset_mode, AutoresetMode):
            choice("autoreset_mode", autoreset_mode, [mode.value for mode in AutoresetMode])
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        own = {"render_modes": ["rgb_array"], "autoreset_mode": self.autoreset_mode}
        self.metadata = ImpactApproachEnv.metadata | own
        one_of("per_slot", per_slot, Sequence, type(None))
        if per_slot is not None and len(per_slot) != self.num_envs:
            raise ValueError(f"per_slot must have {self.num_envs} mappings, one for each slot, got {len(per_slot)}")
        others = ("num_envs", "render_mode", "autoreset_mode", "threads", "per_slot")
        tasks = [] if per_slot else [Task.of("environment", arguments, *others)]
        for slot, changes in enumerate(per_slot or ()):
            one_of(f"per_slot[{slot}]", changes, Mapping)
            tasks.append(Task.of(f"per_slot[{slot}]", {**arguments, **changes}))
        longest = max(task.horizon for task in tasks)
        for slot, changes in enumerate(per_slot or ()):  # all slots must observe the time alike
            if tasks[slot].horizon < longest:
                tasks[slot] = Task(**{"horizon": longest, **arguments, **changes})
        self.batch = batch = Batch(self.num_envs, tasks, threads, 0 if render_mode is None else TRACE_POINTS)
        self.set_scenario, self.sensors, self.command = batch.set_scenario, batch.sensors, batch.set_operator_velocity
        self.metadata["render_fps"] = steps_per_second(tasks[0])
        self.observation_spec, self.action_spec = self.batch.spec, self.batch.action_spec
        self.single_observation_space = Box(self.observation_spec.scaled_low, 1.0, dtype=np.float32)
        self.single_action_space = Box(-1.0, 1.0, (len(self.action_spec),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._generators: list[Any] = []  # random generators of NumPy
        self._attributes: dict[str, tuple[Any, ...]] = {}  # what `set_attr` has set
        self._ended, self._skipped = np.zeros((2, self.num_envs), np.bool_)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]  # as in SyncVectorEnv
        """The seed of each slot's random generator."""
        self._seed(None, self._ended)
        return tuple(each.bit_generator.seed_seq.entropy for each in self._generators)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode in every slot, or in the slots of `options["reset_mask"]` (num_envs,).

        A value in `options["scenario"]` or `options["record"]` may be a number for all slots or a sequence (num_envs,).
        A number of the set-up is ignored in slots that do not draw this number.
        """
        one_of("options", options, Mapping, type(None))
        rest = dict(options or {})
        words = f"{self.num_envs} booleans with at least one True"
        given = rest.pop("reset_mask", None)
        given = np.ones(self.num_envs, np.bool_) if given is None else given
        mask = array("options['reset_mask']", given, (self.num_envs,), "b", words)
        if not mask.any():
            raise ValueError(f"options['reset_mask'] must hold {words}, got none")
        return self.begin(seed, mask, reset_options(rest, self.batch.tasks, self.num_envs)[mask]), {}

    def begin(self, seed: Any, mask: Flags, fixed: NDArray[Any] | None = None) -> Floats:
        """Begin an episode in the k slots of `mask`; return the observations. For `fixed` (k,) see `Batch.begin`."""
        self._seed(seed, mask)
        self.batch.begin(mask.nonzero()[0], self._generators, fixed)
        self._ended[mask] = False
        return self.batch.observations.copy()

    def play(self, actions: NDArray[Any]) -> tuple[Flags, Flags]:
        """Step every slot; return whether each slot's episode terminated, and whether it was truncated."""
        batch = self.batch
        batch.check_begun("step")
        skip = self._ended
        if self.autoreset_mode is not AutoresetMode.NEXT_STEP and skip.any():
            raise ResetNeeded("some episodes have ended: call reset with options={'reset_mask': ...}")
        batch.step(actions, skip)
        if skip.any():
            batch.begin(skip.nonzero()[0], self._generators)
            batch.rewards[skip] = 0.0
        self._skipped = skip
        terminated, truncated = batch.episodes["terminated"] == 1, batch.episodes["truncated"] == 1
        self._ended = terminated | truncated
        return terminated, truncated

    def step(self, actions: NDArray[Any]) -> tuple[Floats, NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Step every slot: play one control step, or begin the next episode, see `autoreset_mode`."""
        terminated, truncated = self.play(actions)
        batch, ended = self.batch, self._ended
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        acted = ~self._skipped & ~(ended & same_step)
        entries, (rewards, scalar) = batch.step_columns(), self._rewards()
        infos = masked(scalar, np.ones_like(ended)) | (masked(of_rows(entries, acted), acted) if acted.any() else {})
        if ended.any():
            rows = ended.nonzero()[0]
            finals = masked(batch.info(terminated.nonzero()[0]), terminated) if terminated.any() else {}
            if not same_step:
                infos |= finals
            else:
                final = np.full(self.num_envs, None, object)
                for row in rows:
                    final[row] = batch.observations[row].copy()
                finals |= masked(of_rows(entries, ended), ended)
                infos |= {"final_obs": final, "_final_obs": ended, "final_info": finals, "_final_info": ended.copy()}
                batch.begin(rows, self._generators)
                self._ended = np.zeros_like(ended)
        return batch.observations.copy(), rewards, terminated, truncated, infos

    def _rewards(self) -> tuple[NDArray[np.float64], dict[str, Any]]:
        return self.batch.rewards.copy(), {}

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture (540, 960, 3) of each slot, or None without a `render_mode`."""
        if self.render_mode is None:
            logger.warn("render() draws nothing without gym.make_vec(..., render_mode='rgb_array')")
            return None
        self.batch.check_begun("render")
        from impact_gym.render import Renderer

        renderer = Renderer(self.render_mode, self.metadata["render_fps"])
        return tuple(renderer.render(self.batch.history(slot)) for slot in range(self.num_envs))

    def episode_info(self) -> dict[str, Any]:
        """Return the entries of the final `info` with their present values, arrays (num_envs,)."""
        self.batch.check_begun("episode_info")
        return self.batch.info()

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return for each slot an attribute as `ImpactApproachEnv` has it; if it is a method, what it returns.

        Only the batch itself plays: `name` must not be "reset", "step" or "close". Methods that change all slots, such
        as "set_scenario", are called once.
        """
        batch, rows = self.batch, range(self.num_envs)
        if name in ("reset", "step", "close"):
            raise ValueError(f"call must name an attribute or method of one environment, got {name!r}: only all step")
        if name in self._attributes:
            return tuple(each(*args, **kwargs) if callable(each) else each for each in self._attributes[name])
        seeds = self.np_random_seed if name.startswith("np_random") else ()
        own: dict[str, Iterable[Any]] = {
            "task": (batch.tasks[row % len(batch.tasks)] for row in rows), "np_random": self._generators,
            "np_random_seed": seeds, "episode_state": map(batch.episode_state, rows),
        }  # fmt: skip
        if name in own:
            return tuple(own[name])
        value = getattr(self, f"single_{name}" if name.endswith("_space") and name != "reward_space" else name)
        value = value(*args, **kwargs) if callable(value) and not isinstance(value, Space) else value
        if name == "episode_info":
            return tuple(batch.infos(np.arange(self.num_envs)))
        if name == "sensors":
            return tuple({sensor: float(column[row]) for sensor, column in value.items()} for row in rows)
        return value if name == "render" and value else (value,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return the attribute `name` of each slot, see `call`."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set a new attribute of the slots to `values`, a list or tuple (num_envs,), or one value for all slots."""
        if name == "task" or hasattr(self, name):
            raise ValueError(f"set_attr must name an attribute that environments do not have, got {name!r}")
        given = tuple(values) if isinstance(values, (list, tuple)) else (values,) * self.num_envs
        if len(given) != self.num_envs:
            raise ValueError(f"values must be one value or a list of {self.num_envs}, got {shown(values)}")
        self._attributes[name] = given

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, with the random generators, for `set_state`."""
        own = (generator.bit_generator for generator in self._generators)
        return self.batch.get_state(generators=[each.state | {"seed": each.seed_seq.entropy} for each in own])

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state that `get_state` returned, see `Batch.set_state`."""
        one_of("state", state, Mapping)
        generators = state.get("generators")
        if not isinstance(generators, list) or len(generators) not in (0, self.num_envs):
            raise ValueError(f"generators of a state must hold 0 or {self.num_envs} states, got {shown(generators)}")
        self.batch.set_state(state)
        self._generators = [seeding.np_random(there.get("seed"))[0] for there in generators]
        for generator, there in zip(self._generators, generators, strict=True):
            generator.bit_generator.state = there
        self._ended = self.batch.ended

    def _seed(self, seed: Any, mask: Flags) -> None:
        """Seed slot i of `mask` with `seed` + i, or with entry i of a list; None keeps an existing generator."""
        if seed is None and self._generators:
            return
        seeds: Sequence[Any] = [None] * self.num_envs
        if isinstance(seed, (list, tuple)) or getattr(seed, "ndim", 0) == 1:
            seeds = [each if each is None else whole("seed", each, at_least=0) for each in seed]
        elif seed is not None:
            seeds = range(first := whole("seed", seed, at_least=0), first + self.num_envs)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be one whole number or {self.num_envs} whole numbers, got {len(seeds)}")
        fresh = not self._generators
        self._generators = self._generators or [None] * self.num_envs
        for slot in np.flatnonzero(mask | fresh).tolist():
            if fresh or seeds[slot] is not None:
                self._generators[slot] = seeding.np_random(seeds[slot])[0]


def of_rows(columns: Mapping[str, NDArray[Any]], rows: Flags) -> dict[str, Any]:
    """Return copies of `columns` (num_envs, ...) with zeros in the slots where `rows` (num_envs,) is False."""
    return {name: (column.T * rows).T.astype(column.dtype) for name, column in columns.items()}


def masked(info: dict[str, Any], mask: Flags) -> dict[str, Any]:
    """Return `info` and, for each key, a key `_key` with the mask of the slots, as Gymnasium requires."""
    result: dict[str, Any] = {}
    for name, value in info.items():
        result[name] = masked(value, mask) if isinstance(value, dict) else value
        result[f"_{name}"] = mask.copy()
    return result
