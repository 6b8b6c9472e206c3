"""A URDF file reduced to the serial arm between two of its links, checked, as MuJoCo's own XML.

Links that hang on the arm by other joints move with it: fixed ones, and those of a gripper, which is held at zero.
Meshes, colours and transmissions are left out. What MuJoCo would take without a word, or refuse without a name, is
refused here.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.validation import number, unit_text

UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}
"""Types of joints that an arm may have, and the unit of each."""
LEAST_MASS = 1e-9  # kg, that a joint moves until the next one

Element = ElementTree.Element


class Joint(NamedTuple):
    """A joint that an arm moves."""

    name: str
    unit: str
    low: float  # rad or m
    high: float


def read(path: Path, base: str, tip: str) -> tuple[str, list[Joint]]:
    """Return the arm from the link `base` to the link `tip` as MuJoCo's XML, in which that is "tip", and its joints.

    Raises:
        ValueError: the file is no URDF of such an arm; names link or joint.
    """
    robot = _parsed(path)
    links, joints = _named(robot, "link"), _named(robot, "joint")
    above = _above(links, joints)
    for name in (base, tip):
        if name not in links:
            raise ValueError(f"no link {name!r}, there are {sorted(links)}")
    held, chain = _path(above, base), _path(above, tip)[::-1]
    for joint in held:
        if (kind := joint.get("type")) in ("floating", "planar"):
            raise ValueError(f"the base {base!r} is not fixed: joint {joint.get('name')!r} above it is {kind}")
    if base != tip and base not in [_end(joint, "parent") for joint in chain]:
        raise ValueError(f"the tip {tip!r} is not below the base {base!r}")
    chain = [joint for joint in chain[len(held) :] if joint.get("type") != "fixed"]
    if len(chain) < 2:
        raise ValueError(f"an arm has two joints or more, between {base!r} and {tip!r} there are {len(chain)}")
    made, moved = Element("mujoco"), {joint.get("name", ""): 0.0 for joint in chain}
    ElementTree.SubElement(made, "compiler", balanceinertia="false", angle="radian")
    bodies = {base: ElementTree.SubElement(made, "worldbody")}
    for joint in _downwards(above.values(), base):
        link = _end(joint, "child")
        bodies[link] = _body(bodies[_end(joint, "parent")], joint, joint in chain)
        mass = _weigh(bodies[link], links[link])
        moving = [each for each in _path(above, link) if each in chain]
        if moving:
            moved[moving[0].get("name", "")] += mass
    for name, mass in moved.items():
        if not mass >= LEAST_MASS:
            raise ValueError(f"joint {name!r} moves no mass until the next one, {mass:g} kg: allowed is {LEAST_MASS:g}")
    bodies[tip].set("name", "tip")
    return ElementTree.tostring(made, "unicode"), [_joint(joint) for joint in chain]


def _parsed(path: Path) -> Element:
    """Return the robot of a file."""
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()  # to which a prefix is a part of a name
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(path.read_bytes(), True)
    except (OSError, expat.ExpatError) as problem:
        raise ValueError(f"no URDF that can be read, {problem}") from None
    robot: Element = builder.close()
    everything = list(robot.iter())
    declared = {name[6:] for each in everything for name, to in each.items() if name[:6] == "xmlns:" and "xacro" in to}
    if {each.tag.partition(":")[0] for each in everything} & {"xacro", *declared}:
        raise ValueError("a xacro, turn it into a URDF first")
    if robot.tag != "robot":
        raise ValueError(f"no URDF, it begins with <{robot.tag}>")
    return robot


def _named(robot: Element, kind: str) -> dict[str, Element]:
    """Return all links or joints by their names."""
    named: dict[str, Element] = {}
    for each in robot.findall(kind):
        name = each.get("name", "")
        if not name or name in named:
            raise ValueError(f"two {kind}s are called {name!r}" if name else f"a {kind} has no name")
        named[name] = each
    return named


def _end(joint: Element, side: str) -> str:
    """Return the link on a side of a joint."""
    end = joint.find(side)
    return "" if end is None else end.get("link", "")


def _above(links: Mapping[str, Element], joints: Mapping[str, Element]) -> dict[str, Element]:
    """Return the joint that each link hangs on."""
    above: dict[str, Element] = {}
    for name, joint in joints.items():
        for side in ("parent", "child"):
            if _end(joint, side) not in links:
                raise ValueError(f"joint {name!r} has the {side} {_end(joint, side)!r}, which is no link")
        child = _end(joint, "child")
        if child in above:
            raise ValueError(f"link {child!r} hangs on two joints, a loop, which is not allowed")
        above[child] = joint
    for link in links:
        _path(above, link)
    return above


def _path(above: Mapping[str, Element], link: str) -> list[Element]:
    """Return the joints above a link, its own first."""
    path: list[Element] = []
    while link in above:
        if len(path) == len(above):
            raise ValueError(f"link {link!r} hangs on itself, a loop, which is not allowed")
        path.append(above[link])
        link = _end(above[link], "parent")
    return path


def _downwards(joints: Iterable[Element], link: str) -> list[Element]:
    """Return the joints below a link, each after those above it."""
    below = [joint for joint in joints if _end(joint, "parent") == link]
    return [each for joint in below for each in (joint, *_downwards(joints, _end(joint, "child")))]


def _numbers(what: str, of: Element | None, key: str, unit: str, missing: str, **limits: float) -> tuple[float, ...]:
    """Return the numbers of an attribute, as many as there are in place of it if it is missing."""
    text = missing if of is None else of.get(key, missing)
    try:
        values = [float(each) for each in text.split()]
    except ValueError:
        values = []
    if len(values) != (count := len(missing.split())):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise ValueError(f"{what} must be {wanted} in {unit_text(unit)}, got {text!r}")
    return tuple(number(what, value, unit, **limits) for value in values)


def _place(name: str, of: Element) -> tuple[Any, Rotation]:
    """Return where a joint or the centre of a mass is, and how it is turned."""
    origin = of.find("origin")
    turn = _numbers(f"rpy of {name}", origin, "rpy", "rad", "0 0 0")
    return _numbers(f"xyz of {name}", origin, "xyz", "m", "0 0 0"), Rotation.from_euler("xyz", turn)


def _text(values: Any) -> str:
    """Return numbers, none of their digits lost."""
    return " ".join(repr(float(each)) for each in values)


def _body(parent: Element, joint: Element, moves: bool) -> Element:
    """Return a body that hangs on a joint."""
    name = joint.get("name", "")
    place, turn = _place(name, joint)
    body = ElementTree.SubElement(parent, "body", pos=_text(place), quat=_text(np.roll(turn.as_quat(), 1)))
    if moves:
        axis = _numbers(f"axis of {name}", joint.find("axis"), "xyz", "-", "1 0 0")
        if not np.linalg.norm(axis) > 0.0:
            raise ValueError(f"axis of {name} must not be 0 0 0")
        kind = "slide" if joint.get("type") == "prismatic" else "hinge"
        ElementTree.SubElement(body, "joint", type=kind, axis=_text(axis))
    return body


def _joint(joint: Element) -> Joint:
    """Return a joint of an arm, checked."""
    name, kind, limit = joint.get("name", ""), joint.get("type", ""), joint.find("limit")
    if kind not in UNITS:
        raise ValueError(f"joint {name!r} is {kind or 'of no type'}, allowed are {', '.join(UNITS)} and fixed")
    if joint.find("mimic") is not None:
        raise ValueError(f"joint {name!r} mimics another, which is not allowed between base and tip")
    if kind == "continuous":
        return Joint(name, "rad", -np.inf, np.inf)
    if limit is None:
        raise ValueError(f"joint {name!r} has no limits, {UNITS[kind]}")
    low, high = (_numbers(f"{side} limit of {name}", limit, side, UNITS[kind], "0")[0] for side in ("lower", "upper"))
    if not low < high:
        raise ValueError(f"joint {name!r} has limits of {low:g} and {high:g} {UNITS[kind]}, which must rise")
    return Joint(name, UNITS[kind], low, high)


def _weigh(body: Element, link: Element) -> float:
    """Give a body the inertia of a link, if it has one, checked; return its mass, kg."""
    name, inertial = link.get("name", ""), link.find("inertial")
    if inertial is None:
        return 0.0
    (mass,) = _numbers(f"mass of {name}", inertial.find("mass"), "value", "kg", "missing", at_least=0)
    if mass == 0.0:
        return 0.0
    centre, turn = _place(name, inertial)
    xx, yy, zz, xy, xz, yz = (
        _numbers(f"i{axes} of {name}", inertial.find("inertia"), f"i{axes}", "kg m^2", "missing")[0]
        for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least, middle, most = np.linalg.eigvalsh(tensor).tolist()
    if not 0.0 < least <= most <= least + middle:
        raise ValueError(
            f"link {name!r} has principal moments of inertia of {least:.6g}, {middle:.6g} and {most:.6g} kg m^2:"
            " each must be above 0 and at most the sum of the others"
        )
    tensor = turn.as_matrix() @ tensor @ turn.as_matrix().T
    six = _text([*tensor.diagonal(), tensor[0, 1], tensor[0, 2], tensor[1, 2]])
    ElementTree.SubElement(body, "inertial", mass=repr(mass), pos=_text(centre), fullinertia=six)
    return mass
