"""A URDF file reduced to the serial arm between two of its links, checked, as MuJoCo reads it.

Links that hang on the arm by fixed joints move with it; joints beside the arm, such as those of a gripper, are held at
zero. Meshes, colours and transmissions are left out. What MuJoCo would take without a word, or refuse without a name,
is refused here.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from impact_gym.validation import number

UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}
"""Types of joints that an arm may have, and the unit of each."""
KEPT = ("origin", "parent", "child", "axis")
OPTIONS = {"fusestatic": "false", "discardvisual": "true", "balanceinertia": "false"}

Element = ElementTree.Element


class Joint(NamedTuple):
    """A joint that an arm moves."""

    name: str
    unit: str
    low: float  # rad or m
    high: float


def read(path: Path, base: str, tip: str) -> tuple[str, list[Joint]]:
    """Return the arm from the link `base` to the link `tip` as MuJoCo's XML, and its joints from the base on.

    Raises:
        ValueError: the file is no URDF of such an arm; names file, link or joint.
    """
    try:
        return _arm(_parsed(path), base, tip)
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def _parsed(path: Path) -> Element:
    """Return the robot of a file."""
    try:
        robot = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as problem:
        raise ValueError(f"no URDF that can be read, {problem}") from None
    if robot.tag != "robot":
        raise ValueError(f"no URDF, it begins with <{robot.tag}>")
    if any("xacro" in each.tag for each in robot.iter()):
        raise ValueError("a xacro, turn it into a URDF first")
    return robot


def _arm(robot: Element, base: str, tip: str) -> tuple[str, list[Joint]]:
    """Return the arm of a robot."""
    links = {link.get("name", ""): link for link in robot.findall("link")}
    above: dict[str, Element] = {}  # the joint that each link hangs on
    for joint in robot.findall("joint"):
        for side in ("parent", "child"):
            if _end(joint, side) not in links:
                raise ValueError(f"joint {joint.get('name')!r} has the {side} {_end(joint, side)!r}, which is no link")
        child = _end(joint, "child")
        if child in above:
            raise ValueError(f"link {child!r} hangs on two joints, a loop, which is not allowed")
        above[child] = joint
    for name in (base, tip):
        if name not in links:
            raise ValueError(f"no link {name!r}, there are {sorted(links)}")
    chain = [joint for joint in _between(above, base, tip) if joint.get("type") != "fixed"]
    if len(chain) < 2:
        raise ValueError(f"an arm has two joints or more, between {base!r} and {tip!r} there are {len(chain)}")
    joints = [_joint(joint) for joint in chain]
    behind = [name for name in links if name != base and base in _path(above, name)]
    _check_masses(links, above, behind, chain)
    made = Element("robot", name="arm")
    ElementTree.SubElement(ElementTree.SubElement(made, "mujoco"), "compiler", OPTIONS)
    for name in (base, *behind):
        inertial = links[name].find("inertial")
        link = ElementTree.SubElement(made, "link", name=name)
        if inertial is not None and _mass(name, inertial) > 0.0:
            link.append(inertial)
    for joint in (above[name] for name in behind):
        kind = "fixed" if joint not in chain else "prismatic" if joint.get("type") == "prismatic" else "continuous"
        copy = ElementTree.SubElement(made, "joint", name=joint.get("name", ""), type=kind)
        copy.extend(part for part in joint if part.tag in KEPT)
        if kind == "prismatic":
            ElementTree.SubElement(copy, "limit", lower="-1e3", upper="1e3", effort="0", velocity="0")
    return ElementTree.tostring(made, "unicode"), joints


def _end(joint: Element, side: str) -> str:
    """Return the link on a side of a joint."""
    end = joint.find(side)
    return "" if end is None else end.get("link", "")


def _path(above: Mapping[str, Element], link: str) -> list[str]:
    """Return the links above a link, itself included."""
    path = [link]
    while path[-1] in above and len(path) <= len(above):
        path.append(_end(above[path[-1]], "parent"))
    return path


def _between(above: Mapping[str, Element], base: str, tip: str) -> list[Element]:
    """Return the joints from `base` to `tip`."""
    path = _path(above, tip)
    if base not in path:
        raise ValueError(f"the tip {tip!r} is not below the base {base!r}")
    return [above[link] for link in path[: path.index(base)]][::-1]


def _joint(joint: Element) -> Joint:
    """Return a joint of an arm, checked."""
    name, kind, limit = joint.get("name", ""), joint.get("type", ""), joint.find("limit")
    if kind not in UNITS:
        raise ValueError(f"joint {name!r} is {kind}, allowed are {', '.join(UNITS)} and fixed")
    if joint.find("mimic") is not None:
        raise ValueError(f"joint {name!r} mimics another, which is not allowed between base and tip")
    if kind == "continuous":
        return Joint(name, "rad", -np.inf, np.inf)
    if limit is None:
        raise ValueError(f"joint {name!r} has no limits, {UNITS[kind]}")
    low, high = (
        number(f"{side} limit of {name}", float(limit.get(side, "0")), UNITS[kind]) for side in ("lower", "upper")
    )
    if not low < high:
        raise ValueError(f"joint {name!r} has limits of {low:g} and {high:g} {UNITS[kind]}, which must rise")
    return Joint(name, UNITS[kind], low, high)


def _mass(link: str, inertial: Element) -> float:
    """Return a mass, kg."""
    mass = inertial.find("mass")
    return number(f"mass of {link}", float("nan" if mass is None else mass.get("value", "nan")), "kg", at_least=0)


def _check_masses(
    links: Mapping[str, Element], above: Mapping[str, Element], behind: list[str], chain: list[Element]
) -> None:
    """Refuse tensors of inertia that no body has, and joints that move no mass."""
    moved = {joint.get("name", ""): 0.0 for joint in chain}
    for link in behind:
        inertial = links[link].find("inertial")
        mass = 0.0 if inertial is None else _mass(link, inertial)
        if inertial is None or mass == 0.0:
            continue
        inertia = inertial.find("inertia")
        xx, yy, zz, xy, xz, yz = (
            number(f"i{axes} of {link}", float("nan" if inertia is None else inertia.get(f"i{axes}", "0")), "kg m^2")
            for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
        least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
        if not 0.0 < least <= most <= least + middle:
            raise ValueError(
                f"link {link!r} has principal moments of inertia of {least:.6g}, {middle:.6g} and {most:.6g} kg m^2:"
                " each must be above 0 and at most the sum of the others"
            )
        moving = next((above[at] for at in _path(above, link) if at in above and above[at] in chain), None)
        if moving is not None:
            moved[moving.get("name", "")] += mass
    for joint, mass in moved.items():
        if mass == 0.0:
            raise ValueError(f"joint {joint!r} moves no mass until the next one, in kg: allowed is above 0")
