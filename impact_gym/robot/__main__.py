"""`impact-gym robot [--out FILE]`: compute the default approach of the Viper s650, show it, write its table.

With `--out impact_gym/robot/default_approach.json` it is shipped anew.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from impact_gym.robot import approach
from impact_gym.robot.approach import IMPACT, Approach
from impact_gym.robot.arm import Arm
from impact_gym.robot.line import MAX_CONDITION
from impact_gym.robot.viper import default_line, viper

DESCRIPTION = """Compute the default straight approach of the Viper s650 from its six joints: mass, damping and
stiffness along x. Of another arm or line: impact_gym.robot.from_urdf(...).along(start, direction, length)."""

PROVENANCE = {  # no version and no date, so that the same table makes the same file
    "made_by": "impact-gym robot --out FILE",
    "robot": "Viper s650, viper_s650.urdf and viper.py beside this file: inertia and joint stiffness are ESTIMATES",
    "choice": "solved for, see impact_gym/robot/viper.py",
    "columns": "paper, eq. 12-16: m_r, c_r, k_r: elements (1,1); effective: 1/(M_X^-1)_11, 1/(K_X^-1)_11; joints rad",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, compute, print, write."""
    parser = argparse.ArgumentParser(prog="impact-gym robot", description=DESCRIPTION)
    parser.add_argument("--out", type=Path, help="file for the table, JSON; without it the table is only summed up")
    out = parser.parse_args(arguments).out
    if out is not None and (out.is_dir() or not out.parent.is_dir()):
        parser.error(f"--out must name a file in a folder that is there, got {out}")
    try:
        arm = viper()
        result = default_line(arm)
        print(_summary(arm, result))
        if out is not None:
            approach.write(out, result, PROVENANCE)
            print(f"written: {out}")
    except (ImportError, OSError) as problem:
        parser.error(str(problem))


def _summary(arm: Arm, result: Approach) -> str:
    lines = [
        f"{'':8}{'travel':>8}{'m_r':>9}{'c_r':>9}{'k_r':>11}{'eff. mass':>11}{'eff. stiffness':>16}{'one body':>10}"
        "  joint angles",
        f"{'':8}{'m':>8}{'kg':>9}{'N s/m':>9}{'N/m':>11}{'kg':>11}{'N/m':>16}{'kg':>10}  deg",
    ]
    for name, row in {"start": 0, "impact": int(np.searchsorted(result.position, IMPACT)), "end": -1}.items():
        joints = " ".join(f"{angle:8.2f}" for angle in np.degrees(result.joint_angles[row]))
        lines.append(
            f"{name:8}{result.position[row]:8.3f}{result.held[row]:9.4f}{result.damping[row]:9.3f}"
            f"{result.stiffness[row]:11.1f}{result.effective[row]:11.4f}"
            f"{result.effective_stiffness[row]:16.1f}{result.composite[row]:10.4f}  {joints}"
        )
    worst = max(arm.condition(row) for row in result.joint_angles)
    return "\n".join([*lines, f"largest condition number {worst:.2f} (allowed {MAX_CONDITION:g})"])


if __name__ == "__main__":
    main()
