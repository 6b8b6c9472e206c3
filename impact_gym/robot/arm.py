"""A serial arm on a fixed base, from a URDF file, computed by MuJoCo: its flange, its inertia, and both along a line.

Joint angles are in rad, in m for prismatic joints; all that comes out is in the frame of the base.
"""

import importlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from impact_gym.files import parsed
from impact_gym.robot import line, urdf
from impact_gym.robot.approach import Approach, Array
from impact_gym.validation import choice, number, numbers, one_of, whole

PerJoint = float | Sequence[float] | Sequence[tuple[float, float]]
"""A number for all joints, one for each, or a pair (low, high) for all or for each, drawn log-uniformly."""


def from_urdf(
    path: Path | str, base: str, tip: str, *, joint_stiffness: PerJoint, joint_damping: PerJoint,
    rotor_inertia: PerJoint | None = None, gear: PerJoint | None = None, seed: int = 0, inertia: str = "given",
) -> "Arm":  # fmt: skip
    """Return the arm between two links of a URDF file, its joints elastic between motor and link.

    Args:
        path: of the file; meshes are not needed.
        base: the link that stands still; what is above it is left out.
        tip: the link whose frame is the flange.
        joint_stiffness: N m/rad, or N/m: a number for all joints, one for each, or a pair (low, high) to draw from, for
            all or for each; for an arm of two joints two numbers are one for each. There is no default: it is seldom
            published, and what follows depends on it.
        joint_damping: N m s/rad, or N s/m, of the same elements.
        rotor_inertia: of the motors' rotors, kg m^2, or kg; needed by the servo of `whole.simulate` alone.
        gear: turns of the rotor for one of the joint, 1 unless given.
        seed: of what is drawn from pairs.
        inertia: "given", or "balanced" for a file whose rounding breaks the triangle rule, that no principal moment of
            inertia exceeds the sum of the other two: a body that breaks it, and no other, gets the mean of its three
            moments for each, as by MuJoCo's `balanceinertia`. A body is all that is welded together behind a joint.

    Raises:
        TypeError, ValueError: the file is no such arm, or a joint parameter is invalid; says which.
        ImportError: MuJoCo is not installed.

    Warns:
        UserWarning: a link that the arm moves has inertia but no mass, and its inertia is left out; or a joint beside
            the arm mimics one of the arm's, but is held at zero; or a limit of a joint is beyond 10 rad or 100 m.
    """
    choice("inertia", inertia, ("given", "balanced"))
    one_of("path", path, str, Path)
    one_of("base", base, str)
    one_of("tip", tip, str)
    rng = np.random.default_rng(whole("seed", seed, at_least=0))
    balanced = inertia == "balanced"
    arm = parsed(Path(path), "URDF", lambda text: Arm(*urdf.read(text, base, tip, balanced)), urdf.decoded)
    arm.stiffness = _per_joint("joint_stiffness", joint_stiffness, arm.count, rng, "N m/rad", above=0)
    arm.damping = _per_joint("joint_damping", joint_damping, arm.count, rng, "N m s/rad", at_least=0)
    rotors = 0.0 if rotor_inertia is None else rotor_inertia
    turns = _per_joint("gear", 1.0 if gear is None else gear, arm.count, rng, "-", above=0)
    arm.rotors = _per_joint("rotor_inertia", rotors, arm.count, rng, "kg m^2", at_least=0) * turns**2
    return arm


def _per_joint(name: str, given: Any, count: int, rng: np.random.Generator, unit: str, **limits: float) -> Array:
    """Return a number for each joint, (count,)."""
    if not hasattr(given, "__len__") or isinstance(given, (str, Mapping)):
        return np.full(count, number(name, given, unit, **limits))
    if len(given) == 2 != count:
        given = [given] * count
    if len(given) != count:
        raise ValueError(
            f"{name} must be a number or {count} of them, one for each joint, or pairs, in {unit}, got {given!r}"
        )
    if all(hasattr(each, "__len__") and len(each) == 2 for each in given):
        low, high = (numbers(name, [each[end] for each in given], unit, **limits) for end in (0, 1))
        if not all(a <= b and a > 0.0 for a, b in zip(low, high, strict=True)):
            raise ValueError(f"{name} must have pairs that rise, above 0, in {unit}, got {given!r}")
        return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high))))
    return np.array(numbers(name, given, unit, **limits))


def _pose(place: Array) -> tuple[Array, Array]:
    """Return a homogeneous place as MuJoCo has it: position, and quaternion with the real part first."""
    return place[:3, 3], np.roll(Rotation.from_matrix(place[:3, :3]).as_quat(), 1)


class Arm:
    """A serial arm of n joints; see `from_urdf`."""

    stiffness: Array  # of the joints, N m/rad or N/m, (n,)
    damping: Array  # N m s/rad or N s/m, (n,)
    rotors: Array  # inertia of the motors behind the gear, kg m^2 or kg, (n,)

    def __init__(self, bodies: Sequence[urdf.Body], tip: Array) -> None:
        try:
            # by name: the package has to load, and its types to check, where MuJoCo is not installed
            self._mujoco: Any = importlib.import_module("mujoco")
        except ImportError as missing:
            raise ImportError(
                "computing a robot needs MuJoCo: pip install 'impact-gym[robot]' (the shipped table does not need it)"
            ) from missing
        self.joints, self.units = tuple(body.name for body in bodies), tuple(body.unit for body in bodies)
        self.lower, self.upper = (np.array([getattr(body, end) for body in bodies]) for end in ("low", "high"))
        self._specification = self._mujoco.MjSpec()
        last, kinds = self._specification.worldbody, self._mujoco.mjtJoint
        for body in bodies:
            (place, turn), (centre, axes) = _pose(body.place), _pose(body.axes)
            last = last.add_body(
                pos=place, quat=turn, mass=body.mass, ipos=centre, iquat=axes, inertia=body.moments,
                explicitinertial=True,
            )  # fmt: skip
            last.add_joint(axis=body.axis, type=kinds.mjJNT_SLIDE if body.unit == "m" else kinds.mjJNT_HINGE)
        place, turn = _pose(tip)
        last.add_body(name="tip", pos=place, quat=turn)
        self._load(self._specification)

    def _load(self, specification: Any) -> None:
        self._model = specification.compile()
        self._data = self._mujoco.MjData(self._model)
        self._tip = self._model.body("tip").id

    def with_load(self, mass: float) -> "Arm":
        """Return the arm with a point mass (kg) at its flange."""
        loaded = Arm.__new__(Arm)
        loaded.__dict__ = dict(self.__dict__)
        specification = self._specification.copy()
        load = specification.body("tip").add_body(mass=mass, ipos=[0.0, 0.0, 0.0])
        load.inertia, load.explicitinertial = [1e-15] * 3, True
        loaded._load(specification)
        return loaded

    @property
    def count(self) -> int:
        """How many joints there are."""
        return len(self.joints)

    @property
    def holds_orientation(self) -> bool:
        """Whether it can hold all of a pose, not only the place."""
        return self.count >= 6

    @cached_property
    def length(self) -> float:
        """Largest distance between a joint and the next, m: the scale at which a rotation is a way."""
        self.move(np.zeros(self.count))
        anchors = np.vstack([self._data.xanchor, self._data.xpos[self._tip]])
        return float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).max())

    def move(self, q: ArrayLike) -> None:
        """Put the joints there, unchecked."""
        self._data.qpos[:] = q
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)

    def place(self, angles: ArrayLike) -> None:
        """Put the joints there, checked."""
        q = numbers("angles", angles, "rad")
        if len(q) != self.count:
            raise ValueError(f"angles must be {self.count} numbers in rad, got {angles!r}")
        self.move(q)

    def flange(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange."""
        self.place(angles)
        return self.pose()

    def pose(self) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange as the joints are."""
        return self._data.xpos[self._tip].copy(), self._data.xmat[self._tip].reshape(3, 3).copy()

    def jacobian(self, angles: ArrayLike) -> Array:
        """Return J(q): rows vx, vy, vz (m/s) and wx, wy, wz (rad/s) of the flange per joint rate, (6, n)."""
        self.place(angles)
        return self._jacobian()

    def _jacobian(self) -> Array:
        jacobian = np.empty((6, self.count))
        self._mujoco.mj_jac(self._model, self._data, jacobian[:3], jacobian[3:], self._data.xpos[self._tip], self._tip)
        return jacobian

    def held_rows(self, angles: ArrayLike) -> Array:
        """Return the rows of J(q) that are held: all, or with fewer than six joints those of the place."""
        return self.jacobian(angles)[: 6 if self.holds_orientation else 3]

    @cached_property
    def rank(self) -> int:
        """How many of the held directions are independent, in general: fewer than there are for an arm in a plane."""
        low, high = np.clip([self.lower, self.upper], -3.0, 3.0)
        somewhere = np.random.default_rng(0).uniform(low, np.maximum(high, low), (8, self.count))
        return max(int((sizes > 1e-9 * sizes[0]).sum()) for sizes in map(self._sizes, somewhere))

    def _sizes(self, angles: ArrayLike) -> Array:
        rows = self.held_rows(angles)
        return np.linalg.svd(np.vstack([rows[:3], self.length * rows[3:]]), compute_uv=False)

    def condition(self, angles: ArrayLike) -> float:
        """Return the condition number of the Jacobian's held rows, over its `rank`, rotations scaled by `length`."""
        sizes = self._sizes(angles)
        return float(sizes[0] / sizes[self.rank - 1]) if sizes[self.rank - 1] > 0.0 else np.inf

    def mass_matrix(self, angles: ArrayLike) -> Array:
        """Return M_q(q), kg m^2, (n, n) (paper, eq. 11)."""
        self.place(angles)
        self._mujoco.mj_crb(self._model, self._data)
        matrix = np.empty((self.count, self.count))
        for row, unit in zip(matrix, np.eye(self.count), strict=True):
            self._mujoco.mj_mulM(self._model, self._data, row, unit)
        return np.asarray((matrix + matrix.T) / 2)  # symmetric but for rounding

    def dynamics(self, angles: Array, rates: Array, coriolis: bool, gravity: bool) -> tuple[Array, Array, Array]:
        """Return flange position, J(q) of it and what centrifugal, Coriolis and weight take of the torques, (n,).

        `accelerations` is of these angles until the next call.
        """
        self.move(angles)
        self._mujoco.mj_crb(self._model, self._data)
        self._mujoco.mj_factorM(self._model, self._data)
        bias = np.zeros(self.count)
        if coriolis or gravity:
            self._model.opt.gravity[:] = (0.0, 0.0, -9.80665) if gravity else 0.0
            self._data.qvel[:] = rates if coriolis else 0.0
            self._mujoco.mj_comVel(self._model, self._data)
            self._mujoco.mj_rne(self._model, self._data, 0, bias)
        return self._data.xpos[self._tip].copy(), self._jacobian()[:3], bias

    def accelerations(self, torques: Array) -> Array:
        """Return M_q^-1 times `torques`, (n,), or times each row of (rows, n)."""
        rows = np.atleast_2d(torques)
        found = np.empty_like(rows)
        self._mujoco.mj_solveM(self._model, self._data, found, rows)
        return found.reshape(torques.shape)

    def composite(self, angles: ArrayLike) -> tuple[float, Array, Array]:
        """Return mass (kg), centre (m) and tensor of inertia about it (kg m^2) of all that moves, as one body."""
        self.place(angles)
        moving = np.flatnonzero((self._model.body_weldid > 0) & (self._model.body_mass > 0.0))
        masses, centres = self._model.body_mass[moving], self._data.xipos[moving]
        mass, centre = float(masses.sum()), masses @ centres / masses.sum()
        tensor = np.zeros((3, 3))
        for body, m, r in zip(moving, masses, centres - centre, strict=True):
            turn = self._data.ximat[body].reshape(3, 3)
            tensor += turn @ np.diag(self._model.body_inertia[body]) @ turn.T + m * (r @ r * np.eye(3) - np.outer(r, r))
        return mass, centre, tensor

    def along(self, start: ArrayLike, direction: ArrayLike, length: float | ArrayLike) -> Approach:
        """Return the arm along a straight line, the flange keeping its orientation if the arm can hold it.

        Args:
            start: joint angles where the line begins, rad, m for prismatic joints, (n,).
            direction: of the line in the base's frame, of any length above 0, (3,).
            length: m; or the places of the rows, m from the start, rising from 0.

        Raises:
            ValueError: the arm cannot follow it; names the first place that is refused, and the joint. Or it would be
                so soft or so stiff there that a unit must have slipped.
        """
        return line.follow(self, start, direction, length)

    def reduction(self, angles: ArrayLike, direction: ArrayLike) -> dict[str, float]:
        """Return the arm along a direction in one place, by the names of the columns of `Approach`."""
        return line.reduction(self, angles, direction)
