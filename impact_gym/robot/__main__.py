"""`python -m impact_gym.robot [--out FILE]`: compute an approach of the Viper s650, show it, write its table.

Without a place it is the default approach; with `--out impact_gym/robot/default_approach.json` it is shipped anew.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np

from impact_gym.robot import approach, choice
from impact_gym.robot.approach import Approach, Orientation, Pose
from impact_gym.robot.arm import Arm
from impact_gym.robot.line import MAX_CONDITION, Line, follow

DESCRIPTION = """Compute a straight approach of the Viper s650 from its six joints: mass, damping and stiffness along x.
Without --x and --z it is the default approach."""

LENGTHS = {
    "ahead": "travel from the start to the impact, m (default 0.2505)",
    "behind": "travel beyond the impact, m (default 0.08)",
    "spacing": "largest distance of two rows, m (default 0.0025)",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, compute, print, write."""
    parser = argparse.ArgumentParser(prog="python -m impact_gym.robot", description=DESCRIPTION)
    parser.add_argument("--out", type=Path, help="file for the table, JSON; without it the table is only summed up")
    parser.add_argument("--x", type=float, help="place of the flange at the impact in the base frame, m; with --z")
    parser.add_argument("--y", type=float, help="the same, m; default 0; with --x and --z")
    parser.add_argument("--z", type=float, help="the same, m; with --x")
    parser.add_argument(
        "--orientation", choices=get_args(Orientation), help="of the tool, default horizontal; with --x and --z"
    )
    for name, meaning in LENGTHS.items():
        parser.add_argument(f"--{name}", type=float, help=f"{meaning}; with --x and --z")
    options = parser.parse_args(arguments)
    given = {name: value for name, value in vars(options).items() if name != "out" and value is not None}
    placed = {"x", "z"} <= given.keys()
    if given and not placed:
        parser.error("--x and --z go together, and the line's other options need them: give both or none of all these")
    if options.out is not None and (options.out.is_dir() or not options.out.parent.is_dir()):
        parser.error(f"--out must name a file in a folder that is there, got {options.out}")
    try:
        arm = Arm()
        if placed:
            impact = Pose(options.x, options.y or 0.0, options.z, options.orientation or "horizontal")
            line = Line(impact, **{name: given[name] for name in LENGTHS if name in given})
        else:
            line = choice.default_line(arm)
        result = follow(arm, line)
        print(_summary(arm, line, result))
        if options.out is not None:
            approach.write(options.out, result, _provenance(line, placed))
            print(f"written: {options.out}")
    except (ImportError, ValueError, OSError) as problem:
        parser.error(str(problem))


def _summary(arm: Arm, line: Line, result: Approach) -> str:
    lines = [
        f"impact at {line.impact}",
        f"{'':8}{'travel':>8}{'m_r':>9}{'c_r':>9}{'k_r':>11}{'eff. mass':>11}{'eff. stiffness':>16}  joint angles",
        f"{'':8}{'m':>8}{'kg':>9}{'N s/m':>9}{'N/m':>11}{'kg':>11}{'N/m':>16}  deg",
    ]
    for name, row in {"start": 0, "impact": result.impact_row, "end": -1}.items():
        joints = " ".join(f"{angle:8.2f}" for angle in result.joint_angles[row])
        lines.append(
            f"{name:8}{result.travel[row]:8.3f}{result.mass[row]:9.4f}{result.damping[row]:9.3f}"
            f"{result.stiffness[row]:11.1f}{result.effective_mass[row]:11.4f}"
            f"{result.effective_stiffness[row]:16.1f}  {joints}"
        )
    angles = np.radians(result.joint_angles)
    worst = max(arm.condition(row) for row in angles)
    spare = min(np.min(angles - arm.description.lower_limits), np.min(arm.description.upper_limits - angles))
    lines.append(
        f"largest condition number {worst:.2f} (allowed {MAX_CONDITION:g}), "
        f"smallest distance of a joint from its limits {np.degrees(spare):.2f} deg"
    )
    return "\n".join(lines)


def _provenance(line: Line, placed: bool) -> dict[str, Any]:
    """Say where a table comes from; no version and no date, so that the same table makes the same file."""
    pose, options = line.impact, ""
    if placed:
        options = f" --x {pose.x!r} --y {pose.y!r} --z {pose.z!r} --orientation {pose.orientation}"
        options += "".join(f" --{name} {getattr(line, name)!r}" for name in LENGTHS)
    return {
        "made_by": f"python -m impact_gym.robot{options} --out FILE",
        "robot": "Viper s650 as viper_s650.json beside this file has it: inertia and joint stiffness are ESTIMATES",
        "choice": "given on the command line" if placed else "solved for, see impact_gym/robot/choice.py",
        "columns": "paper, eq. 12-16: m_r, c_r, k_r are elements (1,1); effective: 1/(M_X^-1)_11 and 1/(K_X^-1)_11",
    }


if __name__ == "__main__":
    main()
