"""A serial arm on a fixed base, computed by MuJoCo: its flange, its inertia, and their table along a line.

Joint angles are in rad, for prismatic joints in m. All results are in the frame of the base.
"""

from collections.abc import Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from impact_gym.robot.approach import Approach, Array
from impact_gym.robot.bodies import Body, specification
from impact_gym.validation import number, numbers

TOLERANCE, STEPS = 1e-10, 200  # of the search for a pose: largest error, m and rad, and number of steps
LARGEST_TURN = 0.2  # rad or m, of a joint in a step of the search
SPACING, LONGEST = 0.0025, 4.0  # m, largest distance between places along a line, and largest length of a line

MAX_CONDITION = 30.0
"""Largest condition number of the Jacobian.

At 30 joint 5 of the Viper is 6 to 10 deg from a straight wrist, or joint 3 about 14 deg from a stretched arm. There a
small displacement of the flange needs a large rotation of the joints: M_X,11 is some 100 kg, more than three times the
mass of the robot, and eq. 11-16 no longer hold.
"""
SOFTEST, STIFFEST = 1.0, 1e8  # N/m, along a line; beyond them a unit is wrong. Servos of 20 N m/rad give 100 N/m


class Arm:
    """A serial arm of n joints; see `from_urdf`."""

    stiffness: Array  # of the joints, N m/rad or N/m, (n,)
    damping: Array  # N m s/rad or N s/m, (n,)
    rotors: Array  # inertia of the motors behind the gear, kg m^2 or kg, (n,)

    def __init__(self, bodies: Sequence[Body], tip: Array) -> None:
        self._mujoco, self._specification = specification(bodies, tip)
        self.joints, self.units = tuple(body.joint for body in bodies), tuple(body.unit for body in bodies)
        self.lower, self.upper = (np.array([getattr(body, end) for body in bodies]) for end in ("low", "high"))
        self.count = len(bodies)
        self.holds_orientation = self.count >= 6  # otherwise the flange keeps its position only
        self._compile()

    def _compile(self) -> None:
        self._model = self._specification.compile()
        self._data = self._mujoco.MjData(self._model)
        self._tip = self._model.body("tip").id

    def with_load(self, mass: float) -> "Arm":
        """Return the arm with a point mass (kg) at its flange."""
        loaded = copy(self)
        loaded._specification = self._specification.copy()
        load = loaded._specification.body("tip").add_body(mass=mass, ipos=[0.0, 0.0, 0.0])
        load.inertia, load.explicitinertial = [1e-15] * 3, True
        loaded._compile()
        return loaded

    def _move(self, q: ArrayLike) -> None:
        """Set the joint angles without checks."""
        self._data.qpos[:] = q
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)

    def _place(self, angles: ArrayLike) -> None:
        """Check and set the joint angles."""
        q = numbers("angles", angles, "rad")
        if len(q) != self.count:
            raise ValueError(f"angles must be {self.count} numbers in rad, got {angles!r}")
        self._move(q)

    @cached_property
    def length(self) -> float:
        """Largest distance between neighbouring joints, m; rotations are scaled by it."""
        self._move(np.zeros(self.count))
        anchors = np.vstack([self._data.xanchor, self._data.xpos[self._tip]])
        return float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).max())

    def flange(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange."""
        self._place(angles)
        return self._data.xpos[self._tip].copy(), self._data.xmat[self._tip].reshape(3, 3).copy()

    def jacobian(self, angles: ArrayLike) -> Array:
        """Return J(q): rows vx, vy, vz (m/s) and wx, wy, wz (rad/s) of the flange per joint rate, (6, n)."""
        self._place(angles)
        jacobian = np.empty((6, self.count))
        self._mujoco.mj_jac(self._model, self._data, jacobian[:3], jacobian[3:], self._data.xpos[self._tip], self._tip)
        return jacobian

    def held_rows(self, angles: ArrayLike) -> Array:
        """Return the rows of J(q) in which the flange is held: all, or with fewer than six joints the position's."""
        return self.jacobian(angles)[: 6 if self.holds_orientation else 3]

    @cached_property
    def rank(self) -> int:
        """Number of held directions that are independent in general; an arm in a plane has fewer than it holds."""
        low, high = np.clip([self.lower, self.upper], -3.0, 3.0)
        somewhere = np.random.default_rng(0).uniform(low, np.maximum(high, low), (8, self.count))
        return max(int((sizes > 1e-9 * sizes[0]).sum()) for sizes in map(self._singular_values, somewhere))

    def _singular_values(self, angles: ArrayLike) -> Array:
        rows = self.held_rows(angles)
        return np.linalg.svd(np.vstack([rows[:3], self.length * rows[3:]]), compute_uv=False)

    def condition(self, angles: ArrayLike) -> float:
        """Return the condition number of the Jacobian's held rows: first over `rank`-th singular value."""
        sizes = self._singular_values(angles)
        return float(sizes[0] / sizes[self.rank - 1]) if sizes[self.rank - 1] > 0.0 else np.inf

    def check_condition(self, angles: Array, where: str) -> None:
        """Raise ValueError if the arm is too near a singularity at these joint angles; `where` names the place."""
        condition = self.condition(angles)
        if not condition <= MAX_CONDITION:
            far = np.argmax(np.abs(np.linalg.svd(self.held_rows(angles))[2][self.rank - 1]))
            raise ValueError(
                f"{where} is too near a singularity: with the joints at {np.array2string(angles, precision=4)} the"
                f" condition number of the Jacobian is {condition:.4g}, allowed is at most {MAX_CONDITION:g};"
                f" joint {self.joints[int(far)]!r} would turn most"
            )

    def mass_matrix(self, angles: ArrayLike) -> Array:
        """Return M_q(q), kg m^2, (n, n) (paper, eq. 11)."""
        self._place(angles)
        self._mujoco.mj_crb(self._model, self._data)
        matrix = np.empty((self.count, self.count))
        for row, unit in zip(matrix, np.eye(self.count), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        return np.asarray((matrix + matrix.T) / 2)  # symmetric but for rounding

    def dynamics(self, angles: Array, rates: Array, coriolis: bool, gravity: bool) -> tuple[Array, Array, Array]:
        """Return the flange's position, the first three rows of J(q), and the torques of velocity and weight, (n,).

        The torques come from centrifugal and Coriolis forces and from gravity. `accelerations` uses the angles of the
        last call.
        """
        self._move(angles)
        self._mujoco.mj_crb(self._model, self._data)
        self._mujoco.mj_factorM(self._model, self._data)
        bias, J = np.zeros(self.count), np.empty((3, self.count))
        if coriolis or gravity:
            self._model.opt.gravity[:] = (0.0, 0.0, -9.80665) if gravity else 0.0
            self._data.qvel[:] = rates if coriolis else 0.0
            self._mujoco.mj_comVel(self._model, self._data)
            self._mujoco.mj_rne(self._model, self._data, 0, bias)
        position = self._data.xpos[self._tip].copy()
        self._mujoco.mj_jac(self._model, self._data, J, None, position, self._tip)
        return position, J, bias

    def accelerations(self, torques: Array) -> Array:
        """Return M_q^-1 times `torques`, (n,)."""
        found = np.empty((1, self.count))
        self._mujoco.mj_solveM(self._model, self._data, found, torques[None])
        return found[0]

    def composite(self, angles: ArrayLike) -> tuple[float, Array, Array]:
        """Return mass (kg), centre (m) and tensor of inertia about it (kg m^2) of all moving links as one body."""
        self._place(angles)
        self._mujoco.mj_crb(self._model, self._data)
        xx, yy, zz, xy, xz, yz = self._data.crb[1, :6]  # of body 1, the first link, and all links behind it
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return float(self._model.body_subtreemass[1]), self._data.subtree_com[1].copy(), tensor

    def reduction(self, angles: ArrayLike, direction: ArrayLike) -> dict[str, float]:
        """Return the row of an `Approach` at these joint angles, by the names of its columns.

        Mass, damping and stiffness are elements (1,1) of the Cartesian matrices (paper, eq. 12-16). They describe a
        flange that is *held* in its other directions; a flange that is free in them is lighter and softer. The
        effective mass is what an impulse along the line meets at first; the effective stiffness is static force over
        deflection along the line. By Cauchy-Schwarz they never exceed the held mass and stiffness. The composite mass
        is the mass of all links as one free rigid body; an arm under stiff position control behaves nearly like that
        (Wang, Dehio and Kheddar, arXiv 2202.12646).

        For an arm with more joints than held directions A_X = (J A^-1 J')^-1.

        Raises:
            ValueError: the arm cannot move that way, or is too near a singularity.
        """
        u, M, J = _unit(direction), self.mass_matrix(angles), self.held_rows(angles)
        self.check_condition(np.asarray(angles, dtype=np.float64), "the place")
        held = np.concatenate([u, np.zeros(len(J) - 3)])
        invert = np.linalg.inv if self.rank == len(J) else partial(np.linalg.pinv, rcond=1e-12)
        M_X, K_X = invert(J @ np.linalg.solve(M, J.T)), invert((J / self.stiffness) @ J.T)
        rates = (J / self.stiffness).T @ K_X @ held  # of the joints at 1 m/s along the line; J^-1 held with six
        if not np.abs(J @ rates - held).max() < 1e-6:
            raise ValueError(f"direction must be one along which the arm can move alone, got {u}")
        x = u @ J[:3]
        mass, centre, tensor = self.composite(angles)
        lever = np.cross(self.flange(angles)[0] - centre, u)
        return {
            "held": float(held @ M_X @ held), "damping": float(rates @ (self.damping * rates)),
            "stiffness": float(held @ K_X @ held),
            "effective": float(1 / (x @ np.linalg.solve(M, x))),
            "effective_stiffness": float(1 / (x @ (x / self.stiffness))),
            "composite": float(1 / (1 / mass + lever @ np.linalg.solve(tensor, lever))),
        }  # fmt: skip

    def along(self, start: ArrayLike, direction: ArrayLike, length: float | ArrayLike) -> Approach:
        """Return the arm along a straight line, the flange keeping its orientation if the arm can hold it.

        Args:
            start: joint angles where the line begins, rad, m for prismatic joints, (n,).
            direction: of the line in the base's frame, of any length above 0, (3,).
            length: of the line, m; or the places of the rows, m from the start, rising from 0.

        Raises:
            ValueError: the arm cannot follow the line; names the first refused place, and the joint. Or the arm is so
                soft or so stiff along the line that a unit must be wrong.
        """
        unit, angles, given = _unit(direction), np.array(numbers("start", start, "rad")), length
        if not hasattr(given, "__len__"):
            end = number("length", given, "m", above=0, at_most=LONGEST)
            given = np.linspace(0.0, end, max(int(np.ceil(end / SPACING - 1e-9)), 3) + 1)
        places = np.array(numbers("length", given, "m", at_least=0, at_most=LONGEST))
        begin, turned = self.flange(angles)
        rotation, rows, found = turned if self.holds_orientation else None, list[dict[str, float]](), list[Array]()
        for place in places:
            angles = joint_angles(self, begin + place * unit, rotation, angles)
            found.append(angles)
            rows.append(self.reduction(angles, unit))
        softest, stiffest = (pick(row["stiffness"] for row in rows) for pick in (min, max))
        if not SOFTEST <= softest <= stiffest <= STIFFEST:
            raise ValueError(
                f"along the line the stiffness is {softest:.3g} to {stiffest:.3g} N/m, expected is {SOFTEST:g} to"
                f" {STIFFEST:g}: is joint_stiffness in N m/rad?"
            )
        columns: Any = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        return Approach(
            places, **columns, joint_angles=np.array(found), joints=self.joints, start=begin, direction=unit
        )


def _unit(direction: ArrayLike) -> Array:
    """Return a direction with length 1."""
    u = np.array(numbers("direction", direction, "-"))
    if len(u) != 3 or not np.abs(u).max() > 0.0:
        raise ValueError(f"direction must be three numbers that are not all 0, got {direction!r}")
    u /= np.abs(u).max()
    return np.asarray(u / np.linalg.norm(u))


def joint_angles(arm: Arm, position: ArrayLike, rotation: Array | None, near: ArrayLike) -> Array:
    """Return the joint angles (n,) that put the flange at `position`; the search starts from the angles `near`.

    Newton's method with the least change of the joints in each step; so an arm with more joints than it needs has one
    solution. Without a `rotation` matrix the orientation is free.

    Raises:
        ValueError: the arm cannot reach the pose within its limits, or only near a singularity; names place and joint.
    """
    goal, angles = np.asarray(position, dtype=np.float64), np.array(near, dtype=np.float64)
    where = f"x = {goal[0]:.6g} m, y = {goal[1]:.6g} m, z = {goal[2]:.6g} m"
    for _ in range(STEPS):
        place, turned = arm.flange(angles)
        error, rows = goal - place, arm.jacobian(angles)
        if rotation is None:
            rows = rows[:3]
        else:
            error = np.append(error, Rotation.from_matrix(rotation @ turned.T).as_rotvec())
        step = np.linalg.lstsq(rows, error, rcond=1e-9)[0]
        angles += step * min(1.0, LARGEST_TURN / max(float(np.abs(step).max()), 1e-300))
        if np.abs(step).max() < 1e-14:
            break
    miss = float(np.abs(error).max())
    if not miss <= TOLERANCE:
        raise ValueError(f"the robot cannot reach {where}: the nearest pose found misses it by {miss:.3g} (m or rad)")
    for joint, angle, low, high, unit in zip(arm.joints, angles, arm.lower, arm.upper, arm.units, strict=True):
        if not low <= angle <= high:
            raise ValueError(
                f"the robot cannot reach {where}: joint {joint!r} would be at {angle:.4g} {unit},"
                f" its limits are {low:.4g} and {high:.4g} {unit}"
            )
    arm.check_condition(angles, where)
    return angles
