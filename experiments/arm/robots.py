"""The arms, and lines for them: two in the middle of the workspace and one near a singularity."""

from functools import cache
from importlib.metadata import PackageNotFoundError, files, version
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np

from impact_gym.robot import Approach, Arm, from_urdf
from impact_gym.robot.line import MAX_CONDITION
from impact_gym.robot.viper import DAMPING_OVER_STIFFNESS, FILE, STIFFNESS

EXTRA = "impact-gym[arms]"
AHEAD, BEHIND = 0.2505, 0.14  # m, from a line's start to the object, and on: the rule on a spring goes 0.12 m beyond
EASY, NEAR = 12.0, 18.0  # condition numbers: below in the middle of the workspace, above near a singularity
TRIES = 20_000


class Kind(NamedTuple):
    """An arm, as its file has it; where nobody has published a stiffness it is assumed."""

    words: str
    file: str  # in the package, or a path of ours
    package: str  # on the index; empty if the file is ours
    licence: str
    base: str
    tip: str
    stiffness: tuple[float, ...]  # N m/rad
    published: str = "assumed"  # of the stiffness


Start = tuple[tuple[float, ...], tuple[float, ...]]
"""Joint angles where a line begins, and its direction."""
STIFF, WRIST = 1e4, 3e3  # N m/rad, assumed: the order of harmonic drives of that size
SIX, SEVEN = (STIFF,) * 3 + (WRIST,) * 3, (STIFF,) * 4 + (WRIST,) * 3
KINDS = {
    "two links": Kind(
        "two links", str(Path(__file__).with_name("two_links.urdf")), "", "MIT", "base", "flange", (STIFF, 5e3)
    ),
    "viper": Kind("Viper s650", str(FILE), "", "MIT", "base", "flange", STIFFNESS, "estimated, see the provenance"),
    "ur5e": Kind("UR5e", "airo_models/arms/ur5e/ur5e.urdf", "airo-models", "MIT", "base_link", "tool0", SIX),
    "panda": Kind(
        "Panda", "frax/assets/franka_panda/panda.urdf", "frax", "MIT", "panda_link0", "panda_grasptarget", SEVEN
    ),
    "iiwa": Kind("iiwa 14", "frax/assets/iiwa/iiwa14.urdf", "frax", "MIT", "iiwa_link_0", "iiwa_link_7", SEVEN),
}


def path_of(name: str) -> Path | None:
    """Return the file of an arm; None if the package with its description is not installed."""
    kind = KINDS[name]
    try:
        found = [each for each in files(kind.package) or [] if str(each) == kind.file] if kind.package else []
    except PackageNotFoundError:
        return None
    return Path(str(found[0].locate())) if found else None if kind.package else Path(kind.file)


def source_of(name: str) -> str:
    """Return where the description of an arm is from, with its licence."""
    package, licence = KINDS[name].package, KINDS[name].licence
    return f"{package} {version(package)}, {licence}" if package else f"impact-gym, {licence}"


def present() -> list[str]:
    """Return the names of the arms that can be had here."""
    return [name for name in KINDS if path_of(name) is not None]


@cache
def arm_of(name: str, factor: float = 1.0) -> Arm:
    """Return an arm, its joints `factor` times as stiff."""
    kind, path = KINDS[name], path_of(name)
    if path is None:
        raise ValueError(f"no description of {name!r} here: pip install '{EXTRA}'")
    stiffness = tuple(factor * each for each in kind.stiffness)
    damping = tuple(DAMPING_OVER_STIFFNESS * each for each in stiffness)
    return from_urdf(path, kind.base, kind.tip, joint_stiffness=stiffness, joint_damping=damping)


@cache
def lines(name: str, length: float) -> tuple[Start, ...]:
    """Return three level lines of an arm.

    They are drawn until two are well away from singularities and one is near one.
    """
    arm, rng = arm_of(name), np.random.default_rng(crc32(name.encode()))
    easy, near = list[Start](), list[Start]()
    low, high = np.maximum(arm.lower, -2.5), np.minimum(arm.upper, 2.5)
    for _ in range(TRIES):
        angles, turn = rng.uniform(low, high), rng.uniform(0.0, 2.0 * np.pi)
        if arm.condition(angles) > MAX_CONDITION:
            continue
        line = tuple(angles.tolist()), (float(np.cos(turn)), float(np.sin(turn)), 0.0)
        try:
            approach = arm.along(*line, np.linspace(0.0, length, 18))
        except ValueError:
            continue
        worst = max(arm.condition(row) for row in approach.joint_angles)
        if worst < EASY and len(easy) < 2:
            easy.append(line)
        elif worst > NEAR and not near:
            near.append(line)
        if len(easy) == 2 and near:
            return (*easy, *near)
    raise ValueError(f"no three lines of {length:g} m were found for {name!r}")


@cache
def approach_of(name: str, place: int, factor: float = 1.0, ahead: float = AHEAD) -> tuple[Arm, Approach]:
    """Return an arm and the table along one of its three lines."""
    arm, length = arm_of(name, factor), ahead + BEHIND
    angles, direction = lines(name, length)[place]
    return arm, arm.along(angles, direction, np.linspace(0.0, length, round(length / 0.005) + 1))
