"""URDF files of small arms whose equations one can write down."""

import re

TWO_LINKS = {"lengths": (0.5, 0.4), "masses": (3.0, 2.0)}
SHOULDER = '(name="shoulder".*?lower=)"-3" upper="3"'


def link(name, mass=0.0, at=(0.0, 0.0, 0.0), moments=(0.01, 0.02, 0.02), extra=""):
    """A link; one without mass is a frame."""
    if not mass:
        return f'<link name="{name}">{extra}</link>'
    xx, yy, zz = moments
    place = " ".join(map(str, at))
    return (f'<link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}"'
            f' izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>{extra}</link>')  # fmt: skip


def joint(name, kind, parent, child, at=(0.0, 0.0, 0.0), axis="0 0 1", turn="0 0 0", extra=""):
    """A joint."""
    place = " ".join(map(str, at))
    return (f'<joint name="{name}" type="{kind}"><origin xyz="{place}" rpy="{turn}"/><parent link="{parent}"/>'
            f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/>{extra}'
            "</joint>")  # fmt: skip


def write(folder, *parts):
    """Write the file of these links and joints."""
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="made up">{"".join(parts)}</robot>')
    return path


def two_links(folder, turn="0 0 0", names=("shoulder", "elbow")):
    """Two rods of 0.5 and 0.4 m that turn about z, in a base that is turned itself."""
    (a, b), (m, n) = TWO_LINKS["lengths"], TWO_LINKS["masses"]
    return write(
        folder, link("world"), joint("held", "fixed", "world", "base", turn=turn), link("base"),
        joint(names[0], "revolute", "base", "upper"), link("upper", m, (a / 2, 0, 0), rod(m, a)),
        joint(names[1], "revolute", "upper", "fore", (a, 0, 0)), link("fore", n, (b / 2, 0, 0), rod(n, b)),
        joint("end", "fixed", "fore", "tip", (b, 0, 0)), link("tip"),
    )  # fmt: skip


def edited(folder, old, new):
    """The two links with a piece of the file exchanged."""
    path = two_links(folder)
    text = path.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, new, text, count=1))
    return path


def rod(mass, length):
    """Principal moments of a thin rod along x, not quite thin."""
    return 1e-4, mass * length**2 / 12, mass * length**2 / 12 + 1e-4


def slides(folder, first=2.0, second=3.225):
    """Two slides, along x and along y: along x it is one mass on a spring."""
    return write(
        folder, link("base"), joint("x", "prismatic", "base", "carriage", axis="1 0 0"), link("carriage", first),
        joint("y", "prismatic", "carriage", "tip", axis="0 1 0"), link("tip", second),
    )  # fmt: skip


def seven_joints(folder, names=tuple(f"joint {k}" for k in range(7)), turn="0 0 0"):
    """An arm of seven joints about z and y, upright at zero angles, in a base that is turned itself; made-up masses."""
    parts = [joint("held", "fixed", "world", "link 0", turn=turn)]
    for k, name in enumerate(names):
        parts += [joint(name, "revolute", f"link {k}", f"link {k + 1}", (0, 0, 0.2), ("0 0 1", "0 1 0")[k % 2]),
                  link(f"link {k + 1}", 4.0 - 0.4 * k, (0.01, 0.02, 0.05 + 0.01 * k))]  # fmt: skip
    end = joint("end", "fixed", "link 7", "tip", (0, 0, 0.15))
    return write(folder, link("world"), link("link 0"), *parts, end, link("tip"))
