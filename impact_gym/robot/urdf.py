"""Read the serial arm between two links of a URDF file.

Joints outside the arm, such as those of a gripper, are held at zero. The inertia of links that the arm does not move
is not read. Meshes, colours and transmissions are ignored.

MuJoCo's own URDF reader is not used: it refuses point masses and welded links without a possible inertia, and accepts
mimic joints, missing limits, two joints of one name, infinite positions and xacro elements without a warning.
"""

from collections.abc import Collection, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import combinations_with_replacement
from typing import NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.robot.bodies import Body
from impact_gym.robot.line_table import Array
from impact_gym.support.validation import number, shown, unit_text

UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}
"""Types of movable joints that an arm may have, and the unit of each type's position."""
MOST_MASS, MOST_INERTIA, FARTHEST, MOST_TURN = 1e6, 1e12, 10.0, 10.0
"""Largest absolute values allowed in a file, in kg, kg m^2, m and rad; larger joint limits only cause a warning."""
MOST_JOINTS = 1000  # largest number of joints, because MuJoCo recurses from joint to joint
Element = ElementTree.Element


class Joint(NamedTuple):
    """A joint as the file describes it."""

    name: str
    kind: str
    parent: str  # name of the link above the joint
    child: str
    mimics: str | None  # name of the joint that this joint follows; None: it follows none
    element: Element


def read(content: bytes, base: str, tip: str, remarks: list[str]) -> tuple[list[Body], Array]:
    """Return bodies from `base` to `tip`, and the pose (4, 4) of `tip` in the last body; add warnings to `remarks`."""
    links = _named(robot := _parsed(content), "link")
    joints = _downwards(links, _named(robot, "joint"))
    way = _way(links, joints, base, tip)
    chain = {joint.name for joint in way if joint.kind != "fixed"}
    if not 2 <= len(chain) <= MOST_JOINTS:
        wanted = "two joints or more" if len(chain) < 2 else f"at most {MOST_JOINTS} joints"
        raise ValueError(
            f"an arm must have {wanted}, but between {shown(base)} and {shown(tip)} there are {len(chain)}"
        )
    bodies, fixed = list[Body](), (None, np.eye(4))
    poses: dict[str, tuple[Body | None, Array]] = {base: fixed}  # for each link: its body, and its pose in this body
    for joint in joints:
        body, pose = poses.get(joint.parent, fixed)
        if not body and joint not in way:
            continue  # this joint's links do not move with the arm
        if joint.kind not in (*UNITS, "fixed"):
            allowed = f"allowed are {', '.join(UNITS)} and fixed"
            raise ValueError(f"joint {joint.name!r} is {joint.kind or 'of no type'}, {allowed}")
        pose = pose @ _pose(joint.name, joint.element)
        if joint.name in chain:
            body, pose = Body(joint.name, *_limits(joint, remarks), pose, _axis(joint), {}), np.eye(4)
            bodies.append(body)
        elif joint.mimics in chain:
            remarks.append(f"joint {joint.name!r} mimics {joint.mimics!r}, a joint of the arm, but is held at zero")
        poses[joint.child] = body, pose
        if body:
            body.links[joint.child] = pose @ _inertia(links[joint.child], remarks) @ pose.T
    empty = [body for body in bodies if not body.inertia.any()]
    remarks += [f"link {next(iter(body.links))!r}, which joint {body.joint!r} moves, has no mass" for body in empty]
    return bodies, poses[tip][1]


def _way(links: Collection[str], joints: Sequence[Joint], base: str, tip: str) -> list[Joint]:
    for name in (base, tip):
        if name not in links:
            raise ValueError(f"no link {shown(name)}, there are {sorted(links)}")
    above = {joint.child: joint for joint in joints}
    way, link = list[Joint](), tip
    while link != base:
        if link not in above:
            raise ValueError(f"the tip {shown(tip)} is not below the base {shown(base)}")
        way.insert(0, above[link])
        link = above[link].parent
    while link in above:
        if (joint := above[link]).kind in ("floating", "planar"):
            raise ValueError(f"the base {shown(base)} is not fixed: joint {joint.name!r} above it is {joint.kind}")
        link = joint.parent
    return way


def _parsed(content: bytes) -> Element:
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()  # keeps namespace prefixes, unlike ElementTree
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(content, True)
    except expat.ExpatError as problem:
        raise ValueError(f"it is no XML file: {problem}") from None
    robot: Element = builder.close()
    everything = list(robot.iter())
    attributes = [pair for each in everything for pair in each.items()]
    prefixes = {"xacro", *(name[6:] for name, to in attributes if name[:6] == "xmlns:" and "xacro" in to)}
    xacro = {name for prefix, _, name in (each.tag.partition(":") for each in everything) if prefix in prefixes}
    if xacro - {"property", "arg"} or (xacro and any("${" in value for _, value in attributes)):
        raise ValueError("it is a xacro file: turn it into a URDF file first, for example by `xacro FILE > arm.urdf`")
    if robot.tag != "robot":
        raise ValueError(f"its root element is <{robot.tag}>, not <robot>")
    return robot


def _named(robot: Element, kind: str) -> dict[str, Element]:
    named: dict[str, Element] = {}
    for each in robot.findall(kind):
        name = each.get("name", "")
        if not name or name in named:
            raise ValueError(f"two {kind}s are called {shown(name)}" if name else f"a {kind} has no name")
        named[name] = each
    return named


def _only(parent: Element, tag: str, name: str) -> Element | None:
    """Return the only child of `parent` with this tag, or None; `name` is the parent's name in messages."""
    if len(found := parent.findall(tag)) > 1:
        raise ValueError(f"{parent.tag} {shown(name)} has {len(found)} elements <{tag}>, allowed is one")
    return found[0] if found else None


def _downwards(links: Collection[str], elements: Mapping[str, Element]) -> list[Joint]:
    """Return the joints, sorted so that each joint comes after all joints above it."""
    above: dict[str, Joint] = {}  # for each link the joint above it
    for name, element in elements.items():
        ends = [_only(element, side, name) for side in ("parent", "child")]
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        for side, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise ValueError(f"joint {shown(name)} has the {side} {shown(link)}, which is no link")
        if child in above:
            raise ValueError(f"link {shown(child)} is the child of two joints: loops are not allowed")
        mimic = element.find("mimic")
        mimics = None if mimic is None else mimic.get("joint", "")
        above[child] = Joint(name, element.get("type", ""), parent, child, mimics, element)
    try:
        order = [*TopologicalSorter({link: [joint.parent] for link, joint in above.items()}).static_order()]
    except CycleError as loop:
        raise ValueError(f"link {shown(loop.args[1][0])} is below itself: loops are not allowed") from None
    return [above[link] for link in order if link in above]


def _numbers(what: str, of: Element | None, key: str, unit: str, missing: str, most: float) -> tuple[float, ...]:
    """Return the numbers in attribute `key`, as many as in the text `missing`, which replaces a missing attribute."""
    text = missing if of is None else of.get(key, missing)
    try:
        values = [float(each) for each in text.split()] if "_" not in text else []  # float() would accept 1_0
    except ValueError:
        values = []
    if len(values) != (count := len(missing.split())):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise ValueError(f"{what} must be {wanted} in {unit_text(unit)}, got {shown(text)}")
    for value in values:
        if abs(number(what, value, unit)) > most:
            doubt = ": is the file in mm?" if unit == "m" else ""
            raise ValueError(
                f"{what} must be between -{most:g} and {most:g} {unit_text(unit)}, got {shown(text)}{doubt}"
            )
    return tuple(values)


def _pose(name: str, of: Element) -> Array:
    """Return the pose of a joint or of an inertial frame, a homogeneous matrix (4, 4)."""
    origin, pose = _only(of, "origin", name), np.eye(4)
    if unknown := [] if origin is None else sorted({*origin.keys()} - {"xyz", "rpy"}):
        raise ValueError(f"origin of {name} has {shown(unknown)}, allowed are xyz and rpy")
    turn = _numbers(f"rpy of {name}", origin, "rpy", "rad", "0 0 0", MOST_TURN)
    pose[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
    pose[:3, 3] = _numbers(f"xyz of {name}", origin, "xyz", "m", "0 0 0", FARTHEST)
    return pose


def _limits(joint: Joint, remarks: list[str]) -> tuple[str, float, float]:
    name, unit = joint.name, UNITS[joint.kind]
    if joint.mimics is not None:
        raise ValueError(f"joint {shown(name)} mimics another joint, which is not allowed between base and tip")
    if joint.kind == "continuous":
        return unit, -np.inf, np.inf
    if (limit := _only(joint.element, "limit", name)) is None:
        raise ValueError(f"joint {shown(name)} must have limits, in {unit}")
    low, high = (_numbers(f"{side} limit of {name}", limit, side, unit, "0", np.inf)[0] for side in ("lower", "upper"))
    if not low < high:
        raise ValueError(
            f"joint {shown(name)} has limits of {low:g} and {high:g} {unit}: the lower must be below the upper"
        )
    if max(-low, high) > {"rad": MOST_TURN, "m": FARTHEST}[unit]:
        remarks.append(f"joint {shown(name)} has limits of {low:g} and {high:g} {unit}: are they in other units?")
    return unit, low, high


def _axis(joint: Joint) -> Array:
    if (axis := _only(joint.element, "axis", joint.name)) is not None and axis.get("xyz") is None:
        raise ValueError(f"axis of {joint.name} has no xyz")
    along = np.array(_numbers(f"axis of {joint.name}", axis, "xyz", "-", "1 0 0", MOST_INERTIA))
    if not (length := np.linalg.norm(along)) > 0.0:
        raise ValueError(f"axis of {joint.name} must not be 0 0 0")
    return np.asarray(along / length)


def _inertia(link: Element, remarks: list[str]) -> Array:
    """Return a link's pseudo-inertia J (4, 4), the integral of r r' dm with r = (x, y, z, 1) in the link's frame.

    It is T J T' in a frame in which the link has the pose T. In a common frame the pseudo-inertias of welded links add
    up (Wensing, Kim and Slotine, IEEE Robotics and Automation Letters 3, 2018).
    """
    name = link.get("name", "")
    if (inertial := _only(link, "inertial", name)) is None:
        return np.zeros((4, 4))
    (mass,) = _numbers(f"mass of {name}", _only(inertial, "mass", name), "value", "kg", "missing", MOST_MASS)
    number(f"mass of {name}", mass, "kg", at_least=0)
    tensor = np.zeros((3, 3))  # if the file gives no inertia, the link is a point mass
    if (inertia := _only(inertial, "inertia", name)) is not None:
        for (i, a), (j, b) in combinations_with_replacement(enumerate("xyz"), 2):
            values = _numbers(f"i{a}{b} of {name}", inertia, f"i{a}{b}", "kg m^2", "missing", MOST_INERTIA)
            tensor[i, j] = tensor[j, i] = values[0]
    if mass == 0.0:
        if tensor.any():
            remarks.append(f"link {shown(name)} has inertia but no mass: its inertia is left out")
        return np.zeros((4, 4))
    own, pose = np.zeros((4, 4)), _pose(name, inertial)
    own[:3, :3], own[3, 3] = np.trace(tensor) / 2 * np.eye(3) - tensor, mass
    return pose @ own @ pose.T
