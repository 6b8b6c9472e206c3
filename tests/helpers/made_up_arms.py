"""URDF files of small arms with equations that one can write down."""

import re

from impact_gym.robot import from_urdf

LENGTHS = 0.5, 0.4  # m, of two rods
ELASTIC = {"joint_stiffness": (9e3, 4e3), "joint_damping": (5.0, 2.0)}  # N m/rad and N m s/rad, of their joints
SHOULDER = '(name="shoulder".*?lower=)"-3" upper="3"'


def link(name, mass=0.0, at=(0.0, 0.0, 0.0), moments=(0.01, 0.02, 0.02)):
    """A link; without mass it is a frame."""
    place, (xx, yy, zz) = " ".join(map(str, at)), moments
    inertia = f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><origin xyz="{place}"/><mass value="{mass}"/>{inertia}</inertial>' if mass else ""
    return f'<link name="{name}">{inertial}</link>'


def joint(name, kind, parent, child, at=(0.0, 0.0, 0.0), axis="0 0 1", turn="0 0 0", extra=""):
    place = " ".join(map(str, at))
    return (f'<joint name="{name}" type="{kind}"><origin xyz="{place}" rpy="{turn}"/><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/>{extra}'
            "</joint>")  # fmt: skip


def write(folder, *parts):
    """Write the file of these links and joints."""
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="made up">{"".join(parts)}</robot>')
    return path


def rods(folder, lengths=LENGTHS, masses=(3.0, 2.0), names=("shoulder", "elbow"), turn="0 0 0"):
    """Rods of these lengths (m) and masses (kg) in series that turn about z, in a base with a rotation `turn`."""
    parts = [link("world"), joint("held", "fixed", "world", "base", turn=turn), link("base")]
    before, reach = "base", 0.0
    for name, rod, length, mass in zip(names, ("upper", "fore", "hand"), lengths, masses, strict=False):
        across = mass * length**2 / 12
        parts += [joint(name, "revolute", before, rod, (reach, 0, 0)),
                  link(rod, mass, (length / 2, 0, 0), (1e-4, across, across + 1e-4))]  # fmt: skip
        before, reach = rod, length
    return write(folder, *parts, joint("end", "fixed", before, "tip", (reach, 0, 0)), link("tip"))


def edited(folder, old, new):
    """Two rods; a piece of the file is replaced."""
    path = rods(folder)
    text, count = re.subn(old, new, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)
    return path


def elastic(path, base="base", tip="tip", **options):
    """The arm of a file, by default of two rods."""
    return from_urdf(path, base, tip, **ELASTIC | options)


def slides(folder):
    """Two slides, along z and along y; along z they are one mass of 5.225 kg on a spring."""
    first = joint("z", "prismatic", "base", "carriage", axis="0 0 1")
    second = joint("y", "prismatic", "carriage", "tip", axis="0 1 0")
    return write(folder, link("base"), first, link("carriage", 2.0), second, link("tip", 3.225))


def seven_joints(folder, names=tuple(f"joint {k}" for k in range(7)), turn="0 0 0"):
    """Joints, by default seven, about z and y, upright at zero angles, made-up masses and a base turned by `turn`."""
    parts = [joint("held", "fixed", "world", "link 0", turn=turn)]
    for k, name in enumerate(names):
        parts += [joint(name, "revolute", f"link {k}", f"link {k + 1}", (0, 0, 0.2), ("0 0 1", "0 1 0")[k % 2]),
                  link(f"link {k + 1}", 4.0 - 0.4 * k, (0.01, 0.02, 0.05 + 0.01 * k))]  # fmt: skip
    end = joint("end", "fixed", f"link {len(names)}", "tip", (0, 0, 0.15))
    return write(folder, link("world"), link("link 0"), *parts, end, link("tip"))
