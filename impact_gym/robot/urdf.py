"""The serial arm between two links of a URDF file: its joints, and the body that each of them moves.

Links that hang on the arm by other joints move with it: fixed ones, and those of a gripper, which is held at zero.
All that is welded together this way is one body, and only its sum is checked: a frame or a point payload needs no
inertia of its own. What the arm does not move is not checked. Meshes, colours and transmissions are left out.

MuJoCo's own reader of URDF is not used: it wants the meshes, takes mimic joints without a word, and refuses an inertia
without the name of its link.
"""

import codecs
import re
import warnings
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import partial
from typing import NamedTuple
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from impact_gym.robot.approach import Array
from impact_gym.validation import number, unit_text

UNITS = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}
"""Types of joints that an arm may have, and the unit of each."""
LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-15  # kg and kg m^2, of a body
MOST_MASS, MOST_INERTIA, FARTHEST, MOST_TURN = 1e6, 1e12, 100.0, 10.0
"""In kg, kg m^2, m and rad, of the numbers in a file: beyond these they are in other units."""
MOST_JOINTS, MOST_BYTES = 1000, 1 << 24  # of an arm, which MuJoCo's recursion bounds, and of a file
LARGEST_GYRATION = 3.0
"""Radius of gyration, m, of a body of an arm that reaches no farther: in kg mm^2 even a finger's is above."""
ROUNDING = 1e-6
"""By how much of itself the largest moment of inertia may exceed the sum of the others: six digits were printed."""

Element = ElementTree.Element


class Body(NamedTuple):
    """A joint of an arm, and all that is welded together behind it."""

    name: str  # of the joint
    unit: str
    low: float  # rad or m
    high: float
    place: Array  # of the joint in the frame of the body before, homogeneous, (4, 4)
    axis: Array  # of length 1, (3,)
    mass: float  # kg
    moments: Array  # principal ones of inertia, kg m^2, (3,)
    axes: Array  # of inertia, and the centre of mass, homogeneous, (4, 4)


def read(text: str, base: str, tip: str, balanced: bool = False) -> tuple[list[Body], Array]:
    """Return the bodies of the arm from the link `base` to the link `tip`, and the place of `tip` in the last, (4, 4).

    Args:
        text: of the file.
        base: the link that stands still.
        tip: the link at the end.
        balanced: whether moments of inertia of which one exceeds the sum of the others are all set to their mean.

    Raises:
        ValueError: the text is no URDF of such an arm; names link or joint.

    Warns:
        UserWarning: a link that moves has inertia but no mass, and its inertia is left out; a joint aside mimics one of
            the arm's; a limit is so large that it may be in other units.
    """
    robot = _parsed(text)
    links, joints = _named(robot, "link"), _named(robot, "joint")
    above = _above(links, joints)
    for name in (base, tip):
        if name not in links:
            raise ValueError(f"no link {name!r}, there are {sorted(links)}")
    held, way = _path(above, base), _path(above, tip)[::-1]
    for joint in held:
        if (kind := joint.get("type")) in ("floating", "planar"):
            raise ValueError(f"the base {base!r} is not fixed: joint {joint.get('name')!r} above it is {kind}")
    if base != tip and base not in [_end(joint, "parent") for joint in way]:
        raise ValueError(f"the tip {tip!r} is not below the base {base!r}")
    way = way[len(held) :]
    chain = {joint.get("name", ""): joint for joint in way if joint.get("type") != "fixed"}
    if not 2 <= len(chain) <= MOST_JOINTS:
        wanted = "two joints or more" if len(chain) < 2 else f"at most {MOST_JOINTS} joints"
        raise ValueError(f"an arm has {wanted}, between {base!r} and {tip!r} there are {len(chain)}")
    places = {base: (0, np.eye(4))}  # which body a link is a part of, 0 standing still, and where in its frame it is
    begins, welded = [np.eye(4)], [dict[str, Array]()]
    for joint in _downwards(above.values(), [base]):
        name, link = joint.get("name", ""), _end(joint, "child")
        behind, place = places.get(_end(joint, "parent"), (0, np.eye(4)))
        if not behind and joint not in way:
            continue  # it stands still
        place = place @ _place(name, joint)
        if name in chain:
            begins.append(place)
            welded.append({})
            behind, place = len(welded) - 1, np.eye(4)
        else:
            _check_held(joint, chain)
        places[link] = behind, place
        if behind:
            welded[behind][link] = place @ _pseudo_inertia(links[link]) @ place.T
    reach = sum(float(np.linalg.norm(place[:3, 3])) for place in (*begins, places[tip][1]))
    body = partial(_body, reach=reach, balanced=balanced)
    return list(map(body, chain.values(), begins[1:], welded[1:])), places[tip][1]


def decoded(content: bytes) -> str:
    """Return the text of an XML file, in UTF-16 by its first bytes, else as it declares or in UTF-8.

    Raises:
        ValueError, LookupError: it is compressed, too large, or in no known encoding.
    """
    if content[:2] == b"\x1f\x8b":
        raise ValueError("it is compressed by gzip, unpack it first")
    if len(content) > MOST_BYTES:
        raise ValueError(f"it must have at most {MOST_BYTES:,} bytes")
    if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return content.decode("utf-16")
    head = content[:400].removeprefix(codecs.BOM_UTF8).replace(b"\0", b"")
    declared = re.match(rb"""\s*<\?xml[^>]*?encoding\s*=\s*["']([^"'>]*)""", head)
    return content.decode(declared[1].decode() if declared else "utf-8").lstrip("\ufeff\r\n\t ")


def _parsed(text: str) -> Element:
    """Return the robot of a file."""
    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()  # to which a prefix is a part of a name
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as problem:
        raise ValueError(f"no XML, {problem}") from None
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


def _only(of: Element, tag: str, name: str) -> Element | None:
    """Return the element of this tag in a part of this name, if there is one."""
    found = of.findall(tag)
    if len(found) > 1:
        raise ValueError(f"{of.tag} {name!r} has {len(found)} elements <{tag}>, allowed is one")
    return found[0] if found else None


def _end(joint: Element, side: str) -> str:
    """Return the link on a side of a joint."""
    end = _only(joint, side, joint.get("name", ""))
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
    tops = [link for link in links if link not in above]
    reached = {*tops, *(_end(joint, "child") for joint in _downwards(above.values(), tops))}
    for link in links:
        if link not in reached:
            raise ValueError(f"link {link!r} hangs on itself, a loop, which is not allowed")
    return above


def _path(above: Mapping[str, Element], link: str) -> list[Element]:
    """Return the joints above a link, its own first."""
    path: list[Element] = []
    while link in above:
        path.append(above[link])
        link = _end(above[link], "parent")
    return path


def _downwards(joints: Iterable[Element], tops: Iterable[str]) -> list[Element]:
    """Return the joints below some links, each after those above it."""
    below, links, found = defaultdict[str, list[Element]](list), list(tops), list[Element]()
    for joint in joints:
        below[_end(joint, "parent")].append(joint)
    for link in links:  # which grow
        found += below[link]
        links += [_end(joint, "child") for joint in below[link]]
    return found


def _numbers(what: str, of: Element | None, key: str, unit: str, missing: str, most: float) -> tuple[float, ...]:
    """Return the numbers of an attribute, as many as there are in place of it if it is missing."""
    text = missing if of is None else of.get(key, missing)
    try:
        values = [float(each) for each in text.split()] if "_" not in text else []  # 1_0 is a number to Python alone
    except ValueError:
        values = []
    if len(values) != (count := len(missing.split())):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise ValueError(f"{what} must be {wanted} in {unit_text(unit)}, got {text!r}")
    for value in values:
        if abs(number(what, value, unit)) > most:
            raise ValueError(f"{what} must be between -{most:g} and {most:g} {unit_text(unit)}, got {text!r}")
    return tuple(values)


def _place(name: str, of: Element) -> Array:
    """Return where a joint or the centre of a mass is and how it is turned, homogeneous, (4, 4)."""
    origin, place = _only(of, "origin", name), np.eye(4)
    if unknown := [] if origin is None else sorted({*origin.keys()} - {"xyz", "rpy"}):
        raise ValueError(f"origin of {name} has {', '.join(unknown)}, known are xyz and rpy")
    turn = _numbers(f"rpy of {name}", origin, "rpy", "rad", "0 0 0", MOST_TURN)
    place[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
    place[:3, 3] = _numbers(f"xyz of {name}", origin, "xyz", "m", "0 0 0", FARTHEST)
    return place


def _check_held(joint: Element, chain: Mapping[str, Element]) -> None:
    """Raise ValueError if a joint aside cannot be held at zero, warn if it is not where its file would have it."""
    name, kind, mimic = joint.get("name", ""), joint.get("type", ""), joint.find("mimic")
    if kind not in (*UNITS, "fixed"):
        raise ValueError(f"joint {name!r} is {kind or 'of no type'}, allowed are {', '.join(UNITS)} and fixed")
    if mimic is not None and mimic.get("joint", "") in chain:
        what = f"joint {name!r} mimics {mimic.get('joint')!r}, a joint of the arm, but is held at zero"
        warnings.warn(what, UserWarning, stacklevel=6)


def _limits(joint: Element) -> tuple[str, float, float]:
    """Return the unit of a joint of an arm and its limits, checked."""
    name, kind, limit = joint.get("name", ""), joint.get("type", ""), _only(joint, "limit", joint.get("name", ""))
    _check_held(joint, {})
    if joint.find("mimic") is not None:
        raise ValueError(f"joint {name!r} mimics another, which is not allowed between base and tip")
    if kind == "continuous":
        return "rad", -np.inf, np.inf
    if limit is None:
        raise ValueError(f"joint {name!r} has no limits, {UNITS[kind]}")
    low, high = (
        _numbers(f"{side} limit of {name}", limit, side, UNITS[kind], "0", np.inf)[0] for side in ("lower", "upper")
    )
    if not low < high:
        raise ValueError(f"joint {name!r} has limits of {low:g} and {high:g} {UNITS[kind]}, which must rise")
    if max(-low, high) > {"rad": MOST_TURN, "m": FARTHEST}[UNITS[kind]]:
        what = (
            f"joint {name!r} has limits of {low:g} and {high:g} {UNITS[kind]}, so wide that they may be in other units"
        )
        warnings.warn(what, UserWarning, stacklevel=7)
    return UNITS[kind], low, high


def _pseudo_inertia(link: Element) -> Array:
    """Return the integral of r r' over a link's mass, r being (x, y, z, 1), in the link's frame, (4, 4).

    It is a sum over what is welded together, and in another frame T it is T J T'. See Wensing, Kim and Slotine, IEEE
    Robotics and Automation Letters 3 (2018).
    """
    name, own = link.get("name", ""), np.zeros((4, 4))
    if (inertial := _only(link, "inertial", name)) is None:
        return own
    (mass,) = _numbers(f"mass of {name}", _only(inertial, "mass", name), "value", "kg", "missing", MOST_MASS)
    own[3, 3] = number(f"mass of {name}", mass, "kg", at_least=0)
    if (inertia := _only(inertial, "inertia", name)) is None:
        xx = yy = zz = xy = xz = yz = 0.0  # a point
    else:
        xx, yy, zz, xy, xz, yz = (
            _numbers(f"i{axes} of {name}", inertia, f"i{axes}", "kg m^2", "missing", MOST_INERTIA)[0]
            for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if own[3, 3] == 0.0:
        if tensor.any():
            warnings.warn(f"link {name!r} has inertia but no mass: its inertia is left out", UserWarning, stacklevel=6)
        return own
    own[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
    place = _place(name, inertial)
    return place @ own @ place.T


def _body(joint: Element, place: Array, welded: Mapping[str, Array], reach: float, balanced: bool) -> Body:
    """Return a joint and the body of these links, checked; `reach` is that of the arm, m."""
    name, (unit, low, high) = joint.get("name", ""), _limits(joint)
    if (along := _only(joint, "axis", name)) is not None and along.get("xyz") is None:
        raise ValueError(f"axis of {name} has no xyz")
    axis = np.array(_numbers(f"axis of {name}", along, "xyz", "-", "1 0 0", MOST_INERTIA))
    if not (length := np.linalg.norm(axis)) > 0.0:
        raise ValueError(f"axis of {name} must not be 0 0 0")
    whole = np.sum(list(welded.values()), axis=0)
    mass, centre = float(whole[3, 3]), whole[:3, 3] / max(whole[3, 3], LEAST_MASS)
    if not mass >= LEAST_MASS:
        raise ValueError(
            f"link {next(iter(welded))!r}, which joint {name!r} moves, must have at least {LEAST_MASS:g} kg with all"
            f" that is welded to it, got {mass:g} kg"
        )
    spread, axes = np.linalg.eigh(whole[:3, :3] - mass * np.outer(centre, centre))  # of the mass along its axes
    least, middle, most = (spread.sum() - spread[::-1]).tolist()
    first, *others = [repr(link) for link, part in welded.items() if part.any()]
    what = f"link {first}" + (f" with {', '.join(others)} welded to it" if others else "")
    found = f"{what} has principal moments of inertia of {least:.6g}, {middle:.6g} and {most:.6g} kg m^2"
    if not least >= LEAST_INERTIA:
        raise ValueError(f"{found}: each must be above 0, at least {LEAST_INERTIA:g}")
    if most <= (1.0 + ROUNDING) * (least + middle):
        spread = np.maximum(spread, 1e-12 * spread.sum())  # MuJoCo allows no rounding
        moments = spread.sum() - spread
    elif balanced:
        moments = np.full(3, spread.sum() * 2.0 / 3.0)
    else:
        raise ValueError(
            f'{found}: each must be at most the sum of the others; inertia="balanced" sets all three to their mean'
        )
    if (gyration := np.sqrt(most / mass)) > max(LARGEST_GYRATION, reach):
        raise ValueError(f"{found}, a radius of gyration of {gyration:.3g} m with {mass:g} kg: is it in kg m^2?")
    inertial = np.eye(4)
    inertial[:3, :3], inertial[:3, 3] = axes * np.sign(np.linalg.det(axes)), centre
    return Body(name, unit, low, high, place, axis / length, mass, moments, inertial)
