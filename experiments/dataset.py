"""`impact-gym dataset`: record episodes of rules, policies or persons as Minari datasets; replay datasets."""

import filecmp
import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import metadata, version
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import gymnasium as gym
import h5py
import minari
import numpy as np
from minari.data_collector.episode_buffer import EpisodeBuffer
from minari.dataset.minari_dataset import parse_dataset_id
from minari.namespace import create_namespace, list_local_namespaces
from minari.storage import get_dataset_path
from tyro.conf import FlagCreatePairsOff, Positional

from agents.baselines import FIXED
from agents.evaluate.specs import controller_of
from agents.policies import Controller, load_policy
from agents.setups import Setup, load_setup, shipped_baselines
from agents.setups.tuned import read_tuned
from experiments.play import attempts
from impact_gym.envs import IDS
from impact_gym.parameters import Count, Index, Options
from impact_gym.support.command_line import progress, run_command
from impact_gym.support.files import UNFINISHED, parsed, reason, remove_unfinished, write_file
from impact_gym.support.provenance import revision
from impact_gym.support.sources import compiled_from
from impact_gym.support.validation import distinct, shown, whole
from impact_gym.teleop.channels import without_files

PLAYERS = {"rule": "the paper's rule", "profile": "the set-up's first baseline", "policy": "the set-up's policy"}
SEED = 70_000_000  # default seed of the first episode; tuning, evaluation and the shipped trainings use other seeds
ROOT = "MINARI_DATASETS_PATH"
MOST_PACKED = 20  # largest ratio of an array's size to that of its file
UNREADABLE = (
    AssertionError, AttributeError, LookupError, OSError, RuntimeError, SystemError, TypeError, ValueError,
    gym.error.Error,
)  # fmt: skip
"""Errors that a damaged or hostile dataset can raise."""
Players = Callable[[float], Controller]  # returns the controller for an episode's time weight, m/s per s


@dataclass(frozen=True)
class DatasetOptions(Options):
    """Record episodes as Minari datasets, or check a dataset.

    From a set-up, the command makes a dataset for each player (controller) in --who. From a folder of tries, which
    impact-gym play writes, the command makes one dataset. With --operator, it makes only a file for an operator. The id
    of a dataset is impact/SETUP/PLAYER-vVERSION. After an interruption, the same command keeps finished datasets.
    """

    source: Positional[str]
    """Name or file of a set-up, folder of tries, or with --check the id of a dataset."""
    who: tuple[str, ...] = tuple(PLAYERS)
    """Players: rule (the paper's rule), profile (the first baseline in the set-up's `against`), policy (the set-up's
    policy), the name of another baseline, or MODULE:OBJECT. OBJECT must have the method `predict`."""
    episodes: Count = 1000
    """Number of episodes that each player plays."""
    seed: Index = SEED
    """Seed of the first episode. Each later episode has the next seed."""
    operator: Path | None = None
    """File to write from a folder of tries, instead of a dataset. It contains the table [environment.operator] of a
    set-up: an operator who replays a randomly chosen try in each episode."""
    include_marked: FlagCreatePairsOff[bool] = False
    """Also use tries that impact-gym play marked as interrupted or not timed right."""
    version: Index = 0
    """Last part of the dataset's id."""
    author: str = metadata("impact-gym")["Author"] or ""
    """Author of the dataset."""
    link: str = ""
    """Public address of the code that made the dataset. The default is version and commit."""
    check: FlagCreatePairsOff[bool] = False
    """Play a dataset's episodes again, and check that observations, rewards, terminations and truncations are equal."""

    def __post_init__(self) -> None:
        super().__post_init__()
        distinct("who", self.who)


def players(name: str, setup: Setup) -> Players:
    """Return a function that makes the player `name` (see `DatasetOptions.who`); ValueError: no such player."""
    if name == "policy":
        policy = load_policy(setup.folder / "policies" / f"{setup.name}.npz")
        return lambda _: policy
    wanted = {"rule": "paper-trapezoid", "profile": (*setup.against, name)[0]}.get(name, name)
    kind = "baseline" if wanted in FIXED else "object" if ":" in wanted else "tuned"
    if kind == "tuned" and wanted not in (*setup.tuned, *shipped_baselines()):
        names = ", ".join(dict.fromkeys((*PLAYERS, *setup.tuned, *FIXED)))
        raise ValueError(f"who must be one of {names}, another tuned baseline or module:object, got {name!r:.80}")
    spec = {kind: read_tuned(wanted, setup=setup) if kind == "tuned" else wanted}
    return lambda weight: controller_of(spec, weight, setup.task)


def recorded(env: gym.Env[Any, Any], seed: int, record: Mapping[str, float], play: Players) -> EpisodeBuffer:
    """Play and return an episode. Its infos hold `sensors` (SI) and the values of `episode_info` except mappings."""
    bare: Any = env.unwrapped

    def info() -> dict[str, Any]:
        flat = {name: value for name, value in bare.episode_info().items() if not isinstance(value, Mapping)}
        return {**bare.sensors(), **flat}

    observation, _ = env.reset(seed=seed, options={"record": dict(record)})
    controller = play(bare.episode_info()["time_weight"])
    state, start, ended = None, np.ones(1, np.bool_), False
    observations, infos, steps = [observation], [info()], list[tuple[Any, ...]]()
    while not ended:
        action, state = controller.predict(observation[None], state=state, episode_start=start, deterministic=True)
        start, action = np.zeros(1, np.bool_), np.asarray(action, np.float32)[0]
        observation, reward, terminated, truncated, _ = env.step(action)
        ended = terminated or truncated
        steps.append((action, float(reward), terminated, truncated))
        observations.append(observation)
        infos.append(info())
    columns = map(list, zip(*steps, strict=True))
    of_steps = {name: [each[name] for each in infos] for name in infos[0]}
    return EpisodeBuffer(None, seed, {"record": bare.episode_info()["record"]}, observations, *columns, of_steps)


def write(
    name: str, env: gym.Env[Any, Any], episodes: Iterator[EpisodeBuffer], options: DatasetOptions, who: str, about: str
) -> Any:
    """Write a dataset atomically and return it; ValueError: there is another of this name, or `name` is invalid."""
    final, (namespace, _, _) = get_dataset_path(name), parse_dataset_id(name)
    code = options.link or f"impact_gym {version('impact-gym')}, commit {revision()['commit'] or 'unknown'}"
    packages = [f"{package}=={version(package)}" for package in ("impact-gym", "gymnasium", "numpy")]
    remove_unfinished(get_dataset_path())  # of killed commands
    with tempfile.TemporaryDirectory(f".{os.getpid()}{UNFINISHED}", ".", get_dataset_path()) as hidden:
        with patch.dict(os.environ, {ROOT: hidden}):
            made = minari.create_dataset_from_buffers(
                name, episodes, env=env, eval_env=env, algorithm_name=who, description=about, author=options.author,
                author_email="none given", code_permalink=code, requirements=packages,
            )  # fmt: skip
            made.storage.update_metadata({"solver": compiled_from()})
        fresh, files = Path(hidden, name), ("main_data.hdf5", "metadata.json")
        if not final.exists():
            if namespace not in list_local_namespaces():
                create_namespace(namespace)
            fresh.rename(final)
        elif len(filecmp.cmpfiles(fresh / "data", final / "data", files, shallow=False)[0]) < len(files):
            raise ValueError(f"there is another dataset {name} already, {final}: delete it, or use another --version")
    return minari.load_dataset(name)


def of_setup(options: DatasetOptions) -> Iterator[Any]:
    """Write and yield a dataset for each player in `options.who`."""
    setup = load_setup(options.source)
    env = setup.make(time_weight=setup.training.time_weight)
    for who, play in {who: players(who, setup) for who in options.who}.items():
        name = f"impact/{setup.name}/{who.rpartition(':')[2]}-v{options.version}"
        seeds = counted(name, range(options.seed, options.seed + options.episodes))
        about = f"{setup.title}: {setup.about}. Plays: {PLAYERS.get(who, who)}"
        yield write(name, env, (recorded(env, seed, {}, play) for seed in seeds), options, who, about)


def of_tries(options: DatasetOptions) -> Any:
    """Write and return a dataset of persons' tries in the folder `options.source`."""
    found = attempts.of_persons(Path(options.source), options.include_marked)
    env = gym.make("impact_gym:ImpactTeleop-v0", **found[0].environment, operator=attempts.operator_of(found))
    name = f"impact/{found[0].setup}/person-v{options.version}"

    def again() -> Iterator[EpisodeBuffer]:
        for number, this in enumerate(counted(name, found)):
            record = {**this.record, "operator.recording": number + 0.5}
            done = recorded(env, this.seed, record, given(this.actions))
            if done.infos["done_time"][-1] != this.result["done_time"]:
                raise ValueError("a try ends at another time when replayed: use the impact-gym version that saved it")
            yield done

    assists = ", ".join(sorted({this.assist for this in found}))
    return write(name, env, again(), options, assists, "persons steer, with assistance")


def counted(title: str, items: Sequence[Any]) -> Iterator[Any]:
    """Yield `items`, and show the progress."""
    with closing(progress(title, len(items))) as bar:
        for item in items:
            yield item
            bar.update()


def given(actions: Sequence[Sequence[float]], *, then_zeros: bool = True) -> Players:
    """Return a function that makes a controller, which plays `actions`, then zeros.

    Without `then_zeros` the controller then raises StopIteration.
    """
    first, *others = np.array(actions, np.float32)
    ahead = chain([first], others, repeat(0.0 * first) if then_zeros else ())
    return lambda _: SimpleNamespace(predict=lambda *_, **__: (next(ahead)[None], None))


def environment_of(about: Mapping[str, Any]) -> gym.Env[Any, Any]:
    """Make a dataset's environment; ValueError: its metadata name a file, a foreign environment or foreign code."""
    spec = json.loads(about["env_spec"])
    if spec["id"] not in IDS:
        raise ValueError(f"the environment's id must be one of {', '.join(IDS)}, got {shown(spec['id'])}")
    ours = json.loads(gym.spec(spec["id"]).to_json())
    for field in ("entry_point", "vector_entry_point", "additional_wrappers"):
        if spec[field] != ours[field]:
            raise ValueError(f"the environment's {field} must be {ours[field]}, got {shown(spec[field])}")
    arguments = {**without_files(spec["kwargs"]), "render_mode": None}
    return gym.make(spec["id"], max_episode_steps=spec["max_episode_steps"], **arguments)


def refuse_foreign_content(folder: Path, about: Mapping[str, Any]) -> None:
    """Raise ValueError if a dataset has more or fewer episodes than its metadata say, other files, or is too large."""
    if about["data_format"] != "hdf5" or not (path := folder / "main_data.hdf5").is_file():
        raise ValueError("its data must be in HDF5, in the file main_data.hdf5")
    total, size = whole("total_episodes", about["total_episodes"], at_least=1), path.stat().st_size

    with h5py.File(path, "r") as content:
        if (stored := len(content)) != total:
            raise ValueError(f"it has {stored} episodes, but its metadata say {total}")
        links = dict[str, Any]()
        content.visititems_links(lambda name, link: links.update({name: link}))
        for name, link in links.items():
            if not isinstance(link, h5py.HardLink):
                raise ValueError(f"{shown(name)} is a link to another place")
            if isinstance(data := content[name], h5py.Dataset):
                if data.external or data.is_virtual:
                    raise ValueError(f"{shown(name)} is stored in other files")
                if data.nbytes > MOST_PACKED * size:
                    raise ValueError(f"{shown(name)} has {data.nbytes:,} bytes, but the file only {size:,}")


def check(name: str) -> int:
    """Replay a dataset, return the episode count; ValueError: the dataset cannot be loaded, or an episode differs."""
    if not get_dataset_path(name).is_dir():
        known = ", ".join(minari.list_local_datasets()) or "none"
        raise ValueError(f"there is no dataset {name!r:.80} in {get_dataset_path()}, which has: {known}")
    folder = get_dataset_path(name) / "data"
    about = parsed(folder / "metadata.json", "JSON", json.loads)
    if not isinstance(about, dict):
        raise ValueError(f"the metadata of {name} must be an object, got {shown(about)}")
    packages = listed if isinstance(listed := about.get("requirements"), list) else ["?"]
    made = f"the dataset was made with {', '.join(map(str, packages))}, solver {about.get('solver', '?')}"
    made = " ".join(made.split())[:300]
    other = f"{made}; installed are impact-gym {version('impact-gym')}, solver {compiled_from()}"
    try:
        refuse_foreign_content(folder, about)
        env = environment_of(about)  # first, because `load_dataset` may import modules that the metadata name
        dataset = minari.load_dataset(name)
        for space in ("observation_space", "action_space"):
            if getattr(dataset, space) != getattr(env, space):
                raise ValueError(f"its {space} is not that of its environment")
    except UNREADABLE as problem:
        raise ValueError(f"{name} cannot be loaded ({reason(problem)}): {other}") from problem
    abouts, episodes = iter(dataset.storage.get_episode_metadata(range(dataset.total_episodes))), iter(dataset)
    steps = 0
    for number in counted(name, range(dataset.total_episodes)):
        try:
            begun, episode = next(abouts), next(episodes)
            record = begun.get("options", {}).get("record", {})
            done = recorded(env, begun["seed"], record, given(episode.actions, then_zeros=False))
        except (*UNREADABLE, StopIteration) as problem:
            why = "it has too few actions" if isinstance(problem, StopIteration) else reason(problem)
            raise ValueError(f"{name}: episode {number} cannot be replayed ({why}): {other}") from problem
        for what in ("actions", "observations", "rewards", "terminations", "truncations"):
            if not np.array_equal(getattr(done, what), getattr(episode, what)):
                raise ValueError(f"{name}: {what} of episode {number} differ when replayed: {other}")
        steps += len(done.rewards)
    if steps != about.get("total_steps"):
        raise ValueError(f"{name} has {steps} steps, but its metadata say {shown(about.get('total_steps'))}")
    return int(dataset.total_episodes)


def work(options: DatasetOptions) -> None:
    """Run the command and print its result."""
    if options.check:
        print(f"{options.source}: {check(options.source)} episodes replay exactly")
    elif options.operator is not None:
        found = attempts.of_persons(Path(options.source), options.include_marked)
        # these values have the same form in JSON and in TOML
        content = [f"{key} = {json.dumps(value)}" for key, value in attempts.operator_of(found).items()]
        write_file(options.operator, "\n".join(["[environment.operator]", *content, ""]))
        print(f"{options.operator}: an operator that draws one of {len(found)} tries for each episode")
    else:
        for made in [of_tries(options)] if Path(options.source).is_dir() else of_setup(options):
            returns = [float(episode.rewards.sum()) for episode in made]
            counts = f"{made.total_episodes} episodes, {made.total_steps} steps"
            print(f"{made.spec.dataset_id}: {counts}, mean return {np.mean(returns):.4f} m/s")


if __name__ == "__main__":
    run_command("dataset", DatasetOptions, work)
