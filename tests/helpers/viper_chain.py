"""The Viper s650 from the numbers in its data file, without code of the package."""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

FILE = Path(__file__).parents[1] / "robot" / "viper_s650.json"
DATA = json.loads(FILE.read_text(encoding="utf-8"))
KINEMATICS, LINKS = DATA["kinematics"], DATA["inertia"]["links"]


def transform(rotation, translation):
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rotation, translation
    return result


def about(axis, angle):
    return Rotation.from_rotvec(angle * np.array([axis == name for name in "xyz"], dtype=float)).as_matrix()


def frames(angles):
    """Frames of links 1 to 6 from the URDF's origins and axes."""
    frame, result, origins = np.eye(4), [], KINEMATICS["urdf_joint_origins_xyz_m"]
    for origin, axis, angle in zip(origins, KINEMATICS["urdf_joint_axes"], angles, strict=True):
        frame = frame @ transform(about(axis, angle), origin)
        result.append(frame)
    return result


def point_jacobian(angles, point, link):
    """Jacobian of a point (base frame) fixed to link 1 to 6, by cross products with the joint axes."""
    columns = np.zeros((6, 6))
    for joint, frame in enumerate(frames(angles)[:link]):
        axis = frame[:3, "xyz".index(KINEMATICS["urdf_joint_axes"][joint])]
        columns[:, joint] = np.concatenate([np.cross(axis, point - frame[:3, 3]), axis])
    return columns


def condition(angles):
    J = point_jacobian(angles, frames(angles)[-1][:3, 3], 6)
    J[3:] *= KINEMATICS["link_lengths_m"]["a2"]
    return np.linalg.cond(J)


def bodies(angles):
    """Mass, center (base frame), and inertia tensor about it along the base's axes, of links 1 to 6."""
    for frame, link in zip(frames(angles), LINKS, strict=True):
        elements, turn = link["inertia_kg_m2"], frame[:3, :3]
        tensor = np.array([[elements["".join(sorted(a + b))] for a in "xyz"] for b in "xyz"])
        yield link["mass_kg"], frame[:3, 3] + turn @ link["com_m"], turn @ tensor @ turn.T


def mass_matrix(angles):
    """Sum over the links of m J_v^T J_v + J_w^T I J_w."""
    total = np.zeros((6, 6))
    for number, (mass, center, tensor) in enumerate(bodies(angles), start=1):
        J = point_jacobian(angles, center, number)
        total += mass * J[:3].T @ J[:3] + J[3:].T @ tensor @ J[3:]
    return total


def composite_mass(angles):
    """Effective mass along x at the flange of all links as one free body, by its 6 x 6 inertia about the flange."""
    at_flange, spatial = frames(angles)[-1][:3, 3], np.zeros((6, 6))
    for mass, center, tensor in bodies(angles):
        r = center - at_flange
        moves = np.hstack([np.eye(3), [[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]]])  # v + w x r
        spatial += mass * moves.T @ moves
        spatial[3:, 3:] += tensor
    return 1 / np.linalg.inv(spatial)[0, 0]
