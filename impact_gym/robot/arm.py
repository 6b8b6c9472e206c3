"""A serial arm on a fixed base: its flange, its inertia, and a table of its mass and stiffness along a line.

Joint angles are in rad, for prismatic joints in m. All results are in the frame of the base.
"""

from collections.abc import Sequence
from copy import copy
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from impact_gym.robot.bodies import Body, specification
from impact_gym.robot.line_table import Array, LineTable
from impact_gym.support.validation import number, numbers

TOLERANCE = 1e-10  # m and rad, largest error of a pose found by `joint_angles`
STEPS = 200  # largest number of steps of `joint_angles`
LARGEST_TURN = 0.2  # rad or m, largest change of a joint in a step of `joint_angles`
SPACING, LONGEST = 0.0025, 4.0  # m, largest distance between rows that `along` chooses; largest length of a line

MAX_CONDITION = 30.0
"""Largest allowed `Arm.condition`; there the held mass of the paper's arm is some 100 kg, three times its weight."""
SINGULAR = 1e-12  # the mass matrix, scaled to a diagonal of ones, is singular if an eigenvalue is below this
SOFTEST, STIFFEST = 1.0, 1e8  # N/m, least and largest stiffness along a line; outside them a unit is probably wrong


class Arm:
    """A serial arm of n joints; see `from_urdf`."""

    stiffness: Array  # N m/rad or N/m, of the joints, (n,)
    damping: Array  # N m s/rad or N s/m, (n,)
    rotors: Array  # kg m^2 or kg, inertia of the rotors, times the square of the gear ratio, (n,)

    def __init__(self, bodies: Sequence[Body], tip: Array, balanced: bool) -> None:
        self._mujoco, self._specification = specification(bodies, tip, balanced)
        self.joints, self.units, lower, upper, *_ = zip(*bodies, strict=True)
        self.lower, self.upper, self.count = np.array(lower), np.array(upper), len(bodies)
        self.holds_orientation = self.count >= 6  # with fewer joints only the position of the flange is prescribed
        massless = {k: repr(next(iter(body.links))) for k, body in enumerate(bodies, 1) if not body.inertia.any()}
        self._massless = massless  # by number of the body in MuJoCo, the name of its first link
        self._compile(self._specification)
        self.mass_matrix(self._somewhere[0])  # refuses an arm of which a part without mass can move alone

    def _compile(self, specification: Any) -> None:
        self._model = specification.compile()
        self._model.body_mass[[*self._massless]] = self._model.body_inertia[[*self._massless]] = 0.0
        self._data = self._mujoco.MjData(self._model)
        self._tip = self._model.body("tip").id

    def moving(self, load: float, gravity: bool) -> "Arm":
        """Return a copy of the arm for `move`, with a point mass `load` (kg) at its flange."""
        arm, changed = copy(self), self._specification.copy()
        changed.option.gravity = (0.0, 0.0, -9.80665 if gravity else 0.0)
        if load:
            changed.body("tip").add_body(mass=load, ipos=[0.0] * 3, inertia=[1e-15] * 3, explicitinertial=True)
        arm._compile(changed)
        return arm

    def _set_angles(self, angles: ArrayLike) -> None:
        q = numbers("angles", angles, "rad or m")
        if len(q) != self.count:
            raise ValueError(f"angles must be {self.count} numbers in rad (prismatic joints: m), got {angles!r}")
        self._data.qpos[:] = q
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)

    @cached_property
    def length(self) -> float:
        """Largest distance between successive joints, or between last joint and flange, m, at joint angles of 0."""
        self._set_angles(np.zeros(self.count))
        anchors = np.vstack([self._data.xanchor, self._data.xpos[self._tip]])
        return float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).max())

    def flange(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange."""
        self._set_angles(angles)
        return self._data.xpos[self._tip].copy(), self._data.xmat[self._tip].reshape(3, 3).copy()

    def jacobian(self, angles: ArrayLike) -> Array:
        """Return J(q), (6, n): velocity (3 rows) and angular velocity (3 rows) of the flange per joint rate."""
        self._set_angles(angles)
        jacobian = np.empty((6, self.count))
        self._mujoco.mj_jac(self._model, self._data, jacobian[:3], jacobian[3:], self._data.xpos[self._tip], self._tip)
        return jacobian

    def held_rows(self, angles: ArrayLike) -> Array:
        """Return the rows of J(q) that a line prescribes: all six, or the first three with fewer than six joints."""
        return self.jacobian(angles)[: 6 if self.holds_orientation else 3]

    @cached_property
    def rank(self) -> int:
        """Rank of `held_rows` away from singularities; for a planar arm it is below the number of rows."""
        return max(int((sizes > 1e-9 * sizes[0]).sum()) for sizes in map(self._singular_values, self._somewhere))

    @property
    def _somewhere(self) -> Array:
        """Random joint angles, (8, n): what holds at all of them holds nearly everywhere."""
        low, high = np.clip([self.lower, self.upper], -3.0, 3.0)
        return np.random.default_rng(0).uniform(low, np.maximum(high, low), (8, self.count))

    def _singular_values(self, angles: ArrayLike) -> Array:
        rows = self.held_rows(angles)
        return np.linalg.svd(np.vstack([rows[:3], self.length * rows[3:]]), compute_uv=False)

    def condition(self, angles: ArrayLike) -> float:
        """Return largest / `rank`-th singular value of `held_rows`, with the angular rows multiplied by `length`."""
        sizes = self._singular_values(angles)
        return float(sizes[0] / sizes[self.rank - 1]) if sizes[self.rank - 1] > 0.0 else np.inf

    def check_condition(self, angles: Array, where: str) -> None:
        """Raise ValueError if the arm is too near a singularity at `angles`; `where` begins the message."""
        if not (condition := self.condition(angles)) <= MAX_CONDITION:
            far = np.argmax(np.abs(np.linalg.svd(self.held_rows(angles))[2][self.rank - 1]))
            raise ValueError(
                f"{where} is too near a singularity: with the joints at {np.array2string(angles, precision=4)} the"
                f" condition number of the Jacobian is {condition:.4g}, allowed is at most {MAX_CONDITION:g};"
                f" joint {self.joints[int(far)]!r} would turn most"
            )

    def mass_matrix(self, angles: ArrayLike) -> Array:
        """Return the mass matrix M_q(q), kg m^2, (n, n) (paper, eq. 11).

        Raises:
            ValueError: joints can move without moving any mass, so that the matrix is singular.
        """
        self._set_angles(angles)
        self._mujoco.mj_crb(self._model, self._data)
        matrix = np.empty((self.count, self.count))
        for row, unit in zip(matrix, np.eye(self.count), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        matrix = (matrix + matrix.T) / 2  # rounding makes `matrix` not quite symmetric
        if self._massless:
            scale = np.sqrt(np.where(np.diag(matrix) > 0.0, np.diag(matrix), 1.0))
            sizes, modes = np.linalg.eigh(matrix / np.outer(scale, scale))
            if (loose := np.abs(modes[:, sizes < SINGULAR]).max(axis=1, initial=0.0) > 0.01).any():
                named = " and ".join(repr(self.joints[k]) for k in np.flatnonzero(loose))
                raise ValueError(
                    f"joint {named} can move without moving any mass: give mass and inertia (an element <inertial>)"
                    f" to link {', '.join(self._massless.values())}"
                )
        return np.asarray(matrix)

    def move(self, angles: Array, rates: Array) -> tuple[Array, Array]:
        """Set joint angles and rates without checks; return the flange's position and the first three rows of J(q)."""
        self._data.qpos[:], self._data.qvel[:] = angles, rates
        self._mujoco.mj_fwdPosition(self._model, self._data)
        self._mujoco.mj_fwdVelocity(self._model, self._data)
        position, J = self._data.xpos[self._tip].copy(), np.empty((3, self.count))
        self._mujoco.mj_jac(self._model, self._data, J, None, position, self._tip)
        return position, J

    def accelerations(self, torques: Array) -> Array:
        """Return the joints' accelerations (n,) under `torques`, weight and Coriolis forces; call `move` first."""
        self._data.qfrc_applied[:] = torques
        self._mujoco.mj_fwdAcceleration(self._model, self._data)
        return self._data.qacc_smooth.copy()

    def composite(self, angles: ArrayLike) -> tuple[float, Array, Array]:
        """Return mass (kg), centre (m) and inertia about this centre (kg m^2) of all moving links as one body."""
        self._set_angles(angles)
        self._mujoco.mj_crb(self._model, self._data)
        xx, yy, zz, xy, xz, yz = self._data.crb[1, :6]  # inertia of body 1 (the first link) and all bodies after it
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return float(self._model.body_subtreemass[1]), self._data.subtree_com[1].copy(), tensor

    def reduction(self, angles: ArrayLike, direction: ArrayLike) -> dict[str, float]:
        """Return masses, damping and stiffnesses at `angles` in `direction`; keys are fields of `LineTable`.

        Held mass, damping and stiffness are the elements (1,1) of the Cartesian matrices (paper, eq. 12-16), for a
        flange that can move only along the line. Effective mass and stiffness are those of a free flange: impulse /
        velocity and static force / deflection along the line. The composite mass is the effective mass of all links as
        one free rigid body. An arm under stiff position control behaves nearly like such a body (Wang, Dehio and
        Kheddar, arXiv 2202.12646).

        With more joints than rows of `held_rows`, held mass and stiffness are elements of (J A^-1 J^T)^-1, where A is
        the joints' mass or stiffness matrix. Damping assumes joint rates proportional to static joint deflections.
        """
        u, M, J = _unit(direction), self.mass_matrix(angles), self.held_rows(angles)
        self.check_condition(np.asarray(angles, dtype=np.float64), "this pose")
        held = np.concatenate([u, np.zeros(len(J) - 3)])
        invert = np.linalg.inv if self.rank == len(J) else partial(np.linalg.pinv, rcond=1e-12)
        M_X, K_X = invert(J @ np.linalg.solve(M, J.T)), invert((J / self.stiffness) @ J.T)
        rates = (J / self.stiffness).T @ K_X @ held  # joint rates for 1 m/s along the line
        if not np.abs(J @ rates - held).max() < 1e-6:
            raise ValueError(f"direction must be one in which the flange can move in a straight line, got {u}")
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

    def along(self, start: ArrayLike, direction: ArrayLike, length: float | ArrayLike) -> LineTable:
        """Return the table of the arm along a straight line; from six joints on, the flange keeps its orientation.

        Args:
            start: joint angles where the line begins (n,), rad, for prismatic joints m.
            direction: direction of the line in the base's frame (3,), of any length above 0.
            length: length of the line, m; or the positions of the table's rows, m from the start, rising from 0.
        """
        unit, angles, given = _unit(direction), np.array(numbers("start", start, "rad or m")), length
        if not hasattr(given, "__len__"):
            end = number("length", given, "m", above=0, at_most=LONGEST)
            given = np.linspace(0.0, end, max(int(np.ceil(end / SPACING - 1e-9)), 3) + 1)
        positions = np.array(numbers("length", given, "m", at_least=0, at_most=LONGEST))
        begin, turned = self.flange(angles)
        rotation, rows, found = turned if self.holds_orientation else None, list[dict[str, float]](), list[Array]()
        for position in positions:
            angles = joint_angles(self, begin + position * unit, rotation, angles)
            found.append(angles)
            rows.append(self.reduction(angles, unit))
        softest, stiffest = (pick(row["stiffness"] for row in rows) for pick in (min, max))
        if not SOFTEST <= softest <= stiffest <= STIFFEST:
            raise ValueError(
                f"along the line the stiffness is {softest:.3g} to {stiffest:.3g} N/m, expected is {SOFTEST:g} to"
                f" {STIFFEST:g}: is joint_stiffness in N m/rad?"
            )
        columns: Any = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        columns["joint_angles"] = np.array(found)
        return LineTable(positions, **columns, joints=self.joints, start=begin, direction=unit)


def _unit(direction: ArrayLike) -> Array:
    u = np.array(numbers("direction", direction, "-"))
    if len(u) != 3 or not np.abs(u).max() > 0.0:
        raise ValueError(f"direction must be three numbers that are not all 0, got {direction!r}")
    u /= np.abs(u).max()
    return np.asarray(u / np.linalg.norm(u))


def joint_angles(arm: Arm, position: ArrayLike, rotation: Array | None, near: ArrayLike) -> Array:
    """Return the joint angles (n,) that put the flange at `position`; `rotation` None: the orientation is free.

    Newton's method from the angles `near`; with more joints than needed, each step changes them as little as possible.
    """
    goal, angles = np.asarray(position, dtype=np.float64), np.array(near, dtype=np.float64)
    where = f"x = {goal[0]:.6g} m, y = {goal[1]:.6g} m, z = {goal[2]:.6g} m"
    for _ in range(STEPS):
        reached, turned = arm.flange(angles)
        error, rows = goal - reached, arm.jacobian(angles)
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
        raise ValueError(f"the robot cannot reach {where}: the last pose found misses it by {miss:.3g} (m or rad)")
    for joint, angle, low, high, unit in zip(arm.joints, angles, arm.lower, arm.upper, arm.units, strict=True):
        if not low <= angle <= high:
            raise ValueError(
                f"the robot cannot reach {where}: joint {joint!r} would be at {angle:.4g} {unit},"
                f" its limits are {low:.4g} and {high:.4g} {unit}"
            )
    arm.check_condition(angles, where)
    return angles
