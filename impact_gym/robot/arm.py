"""A serial arm on a fixed base, from a URDF file, computed by MuJoCo: its flange, its inertia, and both along a line.

Joint angles are in rad, in m for prismatic joints; all that comes out is in the frame of the base.
"""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.robot import urdf
from impact_gym.validation import number, numbers, whole

Array = NDArray[np.float64]

PerJoint = float | Sequence[float] | Sequence[tuple[float, float]]
"""A number for all joints, one for each, or a pair (low, high) for each, drawn log-uniformly."""


def from_urdf(
    path: Path | str, base: str, tip: str, *, joint_stiffness: PerJoint, joint_damping: PerJoint,
    rotor_inertia: PerJoint | None = None, gear: PerJoint | None = None, seed: int = 0,
) -> "Arm":  # fmt: skip
    """Return the arm between two links of a URDF file, its joints elastic between motor and link.

    Args:
        path: of the file; meshes are not needed.
        base: the link that stands still; what is above it is left out.
        tip: the link whose frame is the flange.
        joint_stiffness: N m/rad, or N/m. There is no default: it is seldom published, and what follows depends on it.
        joint_damping: N m s/rad, or N s/m, of the same elements.
        rotor_inertia: of the motors' rotors, kg m^2, or kg; needed by the servo of `whole.simulate` alone.
        gear: turns of the rotor for one of the joint, 1 unless given.
        seed: of what is drawn from pairs.

    Raises:
        ValueError: the file is no such arm, or a number is none for it; says which.
        ImportError: MuJoCo is not installed.
    """
    xml, joints = urdf.read(Path(path), base, tip)
    rng = np.random.default_rng(whole("seed", seed, at_least=0))
    stiffness = _per_joint("joint_stiffness", joint_stiffness, len(joints), rng, "N m/rad", above=0)
    damping = _per_joint("joint_damping", joint_damping, len(joints), rng, "N m s/rad", at_least=0)
    inertia = _per_joint("rotor_inertia", rotor_inertia or 0.0, len(joints), rng, "kg m^2", at_least=0)
    turns = _per_joint("gear", gear or 1.0, len(joints), rng, "-", above=0)
    return Arm(xml, joints, tip, stiffness, damping, inertia * turns**2)


def _per_joint(name: str, given: Any, count: int, rng: np.random.Generator, unit: str, **limits: float) -> Array:
    """Return a number for each joint, (count,)."""
    if not hasattr(given, "__len__") or isinstance(given, str):
        return np.full(count, number(name, given, unit, **limits))
    if len(given) != count:
        raise ValueError(f"{name} must be a number or {count} of them, one for each joint, in {unit}, got {given!r}")
    if all(hasattr(each, "__len__") and len(each) == 2 for each in given):
        low, high = (numbers(name, [each[end] for each in given], unit, **limits) for end in (0, 1))
        if not all(a <= b and a > 0.0 for a, b in zip(low, high, strict=True)):
            raise ValueError(f"{name} must have pairs that rise, above 0, in {unit}, got {given!r}")
        return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high))))
    return np.array(numbers(name, given, unit, **limits))


class Arm:
    """A serial arm of n joints; see `from_urdf`."""

    def __init__(
        self, xml: str, joints: Sequence[urdf.Joint], tip: str, stiffness: Array, damping: Array, rotors: Array
    ) -> None:
        try:
            # by name: the package has to load, and its types to check, where MuJoCo is not installed
            self._mujoco: Any = importlib.import_module("mujoco")
        except ImportError as missing:
            raise ImportError(
                "computing a robot needs MuJoCo: pip install 'impact-gym[robot]' (the shipped table does not need it)"
            ) from missing
        self.joints, self.tip = tuple(joint.name for joint in joints), tip
        self.units = tuple(joint.unit for joint in joints)
        self.lower, self.upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("low", "high"))
        self.stiffness, self.damping, self.rotors = stiffness, damping, rotors  # of the joints; rotors behind the gear
        self._xml = xml
        self._load(self._mujoco.MjSpec.from_string(xml))

    def _load(self, specification: Any) -> None:
        self._model = specification.compile()
        self._data = self._mujoco.MjData(self._model)
        self._body = self._model.body(self.tip).id
        self._column, places = (
            np.empty(self._model.nv),
            [int(self._model.joint(name).qposadr[0]) for name in self.joints],
        )
        self._order, self._units = np.array(places), np.eye(self._model.nv)[places]  # as in the file

    def with_load(self, mass: float) -> "Arm":
        """Return the arm with a point mass (kg) at its flange."""
        loaded = Arm.__new__(Arm)
        loaded.__dict__ = dict(self.__dict__)
        specification = self._mujoco.MjSpec.from_string(self._xml)
        body = specification.body(self.tip).add_body(name="load", mass=mass, ipos=[0.0, 0.0, 0.0])
        body.inertia, body.explicitinertial = [1e-15] * 3, True
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

    @property
    def length(self) -> float:
        """Largest distance between a joint and the next, m: the scale at which a rotation is a way."""
        self.place(np.zeros(self.count))
        anchors = np.vstack([self._data.xanchor[self._order], self._data.xpos[self._body]])
        return float(np.linalg.norm(np.diff(anchors, axis=0), axis=1).max())

    def place(self, angles: ArrayLike) -> None:
        """Put the joints there."""
        q = numbers("angles", angles, "rad")
        if len(q) != self.count:
            raise ValueError(f"angles must be {self.count} numbers in rad, got {angles!r}")
        self._place(q)

    def _place(self, q: ArrayLike) -> None:
        self._data.qpos[self._order] = q
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)

    def flange(self, angles: ArrayLike) -> tuple[Array, Array]:
        """Return position (m) and rotation matrix of the flange."""
        self.place(angles)
        return self._data.xpos[self._body].copy(), self._data.xmat[self._body].reshape(3, 3).copy()

    def jacobian(self, angles: ArrayLike) -> Array:
        """Return J(q): rows vx, vy, vz (m/s) and wx, wy, wz (rad/s) of the flange per joint rate, (6, n)."""
        self.place(angles)
        return self._jacobian()

    def _jacobian(self) -> Array:
        jacobian = np.empty((6, self._model.nv))
        at = self._data.xpos[self._body]
        self._mujoco.mj_jac(self._model, self._data, jacobian[:3], jacobian[3:], at, self._body)
        return jacobian[:, self._order]

    def condition(self, angles: ArrayLike) -> float:
        """Return the condition number of the part of the Jacobian that is held, its rotations scaled by `length`."""
        rows = self.jacobian(angles)
        scaled = np.vstack([rows[:3], self.length * rows[3:]]) if self.holds_orientation else rows[:3]
        sizes = np.linalg.svd(scaled, compute_uv=False)
        return float(sizes[0] / sizes[-1]) if sizes[-1] > 0.0 else np.inf

    def mass_matrix(self, angles: ArrayLike) -> Array:
        """Return M_q(q), kg m^2, (n, n) (paper, eq. 11)."""
        self.place(angles)
        return self._mass_matrix()

    def _mass_matrix(self) -> Array:
        self._mujoco.mj_crb(self._model, self._data)
        matrix = np.empty((self.count, self.count))
        for row, unit in zip(matrix, self._units, strict=True):
            self._mujoco.mj_mulM(self._model, self._data, self._column, unit)
            row[:] = self._column[self._order]
        return np.asarray((matrix + matrix.T) / 2)  # symmetric but for rounding

    def dynamics(
        self, angles: ArrayLike, rates: Array, coriolis: bool, gravity: bool
    ) -> tuple[Array, Array, Array, Array]:
        """Return flange position, J(q), M_q(q) and what centrifugal, Coriolis and weight take of the torques, (n,)."""
        self._place(angles)
        position, rows, matrix = self._data.xpos[self._body].copy(), self._jacobian(), self._mass_matrix()
        bias = np.zeros(self._model.nv)
        if coriolis or gravity:
            self._model.opt.gravity[:] = (0.0, 0.0, -9.80665) if gravity else 0.0
            self._data.qvel[self._order] = rates if coriolis else 0.0
            self._mujoco.mj_comVel(self._model, self._data)
            self._mujoco.mj_rne(self._model, self._data, 0, bias)
        return position, rows, matrix, bias[self._order]

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


def along(arm: Arm, angles: ArrayLike, direction: ArrayLike) -> dict[str, float]:
    """Return an arm along a unit vector at joint `angles`, by the names of the fields of `Approach`.

    Mass, damping and stiffness are elements (1,1) of the cartesian matrices (paper, eq. 12-16), those of a flange that
    is *held* in its other directions. A flange that is free in them is lighter and softer: the effective mass is what
    an impulse along the line meets at first, the effective stiffness is static force over deflection along it. By
    Cauchy-Schwarz they never exceed the held ones. The composite mass is that of all links as one rigid body that
    nothing holds, which stiff position control comes close to (Wang, Dehio and Kheddar, arXiv 2202.12646).

    An arm with more than six joints moves, held, as its inertia and its springs let it: A_X = (J A^-1 J')^-1.
    """
    u, M = np.asarray(direction, dtype=np.float64), arm.mass_matrix(angles)
    rows = arm.jacobian(angles)
    J = rows if arm.holds_orientation else rows[:3]
    held = np.concatenate([u, np.zeros(len(J) - 3)])
    invert = np.linalg.inv if arm.holds_orientation else np.linalg.pinv
    M_X, K_X = invert(J @ np.linalg.solve(M, J.T)), invert((J / arm.stiffness) @ J.T)
    rates = (J / arm.stiffness).T @ K_X @ held  # of the joints at 1 m/s along the line; J^-1 held with six
    x = u @ rows[:3]
    mass, centre, tensor = arm.composite(angles)
    lever = np.cross(arm.flange(angles)[0] - centre, u)
    return {
        "mass": float(held @ M_X @ held), "damping": float(rates @ (arm.damping * rates)),
        "stiffness": float(held @ K_X @ held),
        "effective_mass": float(1 / (x @ np.linalg.solve(M, x))),
        "effective_stiffness": float(1 / (x @ (x / arm.stiffness))),
        "composite_mass": float(1 / (1 / mass + lever @ np.linalg.solve(tensor, lever))),
    }  # fmt: skip
