"""The arms, and lines for them: two in the middle of the workspace and one near a singularity."""

from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import NamedTuple

import numpy as np

from impact_gym.robot import Approach, Arm, Line, follow, from_urdf
from impact_gym.robot.line import MAX_CONDITION
from impact_gym.robot.viper import DAMPING_OVER_STIFFNESS, FILE, STIFFNESS

DESCRIPTIONS = "example-robot-data"
"""Package on the index that ships URDF files of many robots, each with its licence: the extra `arms`."""
EASY, NEAR = 12.0, 18.0  # condition numbers: below in the middle of the workspace, above near a singularity
TRIES = 20_000


class Kind(NamedTuple):
    """An arm, as its file has it; where nobody has published a stiffness it is assumed."""

    words: str
    file: str  # below the package, or a path of ours
    base: str
    tip: str
    stiffness: tuple[float, ...]  # N m/rad
    published: str  # of the stiffness


STIFF, WRIST = 1e4, 3e3  # N m/rad, assumed: the order of harmonic drives of that size
ASSUMED = "assumed"
KINDS = {
    "two links": Kind(
        "two links", str(Path(__file__).with_name("two_links.urdf")), "base", "flange", (STIFF, 5e3), ASSUMED
    ),
    "viper": Kind("Viper s650", str(FILE), "base", "flange", STIFFNESS, "estimated, see the provenance"),
    "ur5": Kind(
        "UR5", "ur_description/urdf/ur5_robot.urdf", "base_link", "tool0", (STIFF,) * 3 + (WRIST,) * 3, ASSUMED
    ),
    "ur10": Kind(
        "UR10", "ur_description/urdf/ur10_robot.urdf", "base_link", "tool0", (2 * STIFF,) * 3 + (WRIST,) * 3, ASSUMED
    ),
    "panda": Kind(
        "Panda",
        "panda_description/urdf/panda.urdf",
        "panda_link0",
        "panda_hand_tcp",
        (STIFF,) * 4 + (WRIST,) * 3,
        ASSUMED,
    ),
}


def path_of(name: str) -> Path | None:
    """Return the file of an arm; None if the package with its description is not installed."""
    file = Path(KINDS[name].file)
    if file.is_absolute():
        return file
    try:
        found = [each for each in files(DESCRIPTIONS) or [] if str(each).endswith(f"/robots/{file}")]
    except PackageNotFoundError:
        return None
    return Path(str(found[0].locate())) if found else None


def present() -> list[str]:
    """Return the names of the arms that can be had here."""
    return [name for name in KINDS if path_of(name) is not None]


def arm_of(name: str, factor: float = 1.0) -> Arm:
    """Return an arm, its joints `factor` times as stiff."""
    kind, path = KINDS[name], path_of(name)
    if path is None:
        raise ValueError(f"no description of {name!r} here: pip install {DESCRIPTIONS}")
    stiffness = tuple(factor * each for each in kind.stiffness)
    damping = tuple(DAMPING_OVER_STIFFNESS * each for each in stiffness)
    return from_urdf(path, kind.base, kind.tip, joint_stiffness=stiffness, joint_damping=damping)


@cache
def lines(name: str, ahead: float, behind: float) -> tuple[Line, ...]:
    """Return three lines of an arm, drawn until two are well away from singularities and one is near one."""
    arm, rng = arm_of(name), np.random.default_rng(len(name))
    easy, near = list[Line](), list[Line]()
    for line, worst in _drawn(arm, rng, ahead, behind):
        if worst < EASY and len(easy) < 2:
            easy.append(line)
        elif worst > NEAR and not near:
            near.append(line)
        if len(easy) == 2 and near:
            return (*easy, *near)
    raise ValueError(f"no three lines of {ahead + behind:g} m were found for {name!r}")


def _drawn(arm: Arm, rng: np.random.Generator, ahead: float, behind: float) -> Iterator[tuple[Line, float]]:
    """Yield random level lines that an arm can follow, with the largest condition number on the way."""
    low, high = np.maximum(arm.lower, -2.5), np.minimum(arm.upper, 2.5)
    for _ in range(TRIES):
        angles, turn = rng.uniform(low, high), rng.uniform(0.0, 2.0 * np.pi)
        if arm.condition(angles) > MAX_CONDITION:
            continue
        line = Line(tuple(angles.tolist()), (np.cos(turn), np.sin(turn), 0.0), ahead, behind, spacing=0.02)
        try:
            approach = follow(arm, line)
        except ValueError:
            continue
        yield line, max(arm.condition(row) for row in approach.joint_angles)


def approach_of(
    name: str, place: int, factor: float, ahead: float = 0.2505, behind: float = 0.1
) -> tuple[Arm, Approach]:
    """Return an arm and the table along one of its three lines."""
    arm = arm_of(name, factor)
    chosen = lines(name, ahead, behind)[place]
    return arm, follow(arm, Line(chosen.angles, chosen.direction, ahead, behind, spacing=0.005))
