"""The Taylor series of a contact, written out for each chain whose equations of motion are polynomial then.

With m = n = 3/2 and a tool that is fixed or on one spring and damper, the scaled equations (`physics/contact.pxi`) are
sums of products of z, w, y and v. So the coefficients of order k + 1 follow from those up to order k by Cauchy products:
five of them, z y, z v, z^2, z^4 and z^4 w. See Jorba and Zou, A software package for the numerical integration of ODEs by
means of high-order Taylor methods (Experimental Mathematics 14, 2005).

As straight-line code this takes a third of the time of loops. In each product what is known last is added last: an order
waits for the one before, not for sums that could be ready. `python -m impact_gym.solver.taylor` writes `taylor.pxi`, and
a test says whether it still does.
"""

import re
from pathlib import Path

SIZES = Path(__file__).with_name("state.pxi").read_text(encoding="utf-8")
ORDER, LAST_ORDERS = (int(re.findall(rf"\b{name} = (\d+)", SIZES)[0]) for name in ("ORDER", "LAST_ORDERS"))
LAYOUTS = {"rigid": "zwtp", "spring": "zwtpyvq"}
"""Places of each chain's scaled state, a letter each, in order."""

OUT = Path(__file__).with_name("taylor.pxi")
NOTICE = '''"""The series of `solver/taylor.py` written out by `python -m impact_gym.solver.taylor`: edit that."""'''


def product(first: str, second: str, order: int) -> list[str]:
    """Return the terms of a coefficient of a product of two series, but for those with the last of either."""
    return [f"{first}{i} * {second}{order - i}" for i in sorted(range(1, order), key=lambda i: max(i, order - i))]


def square(name: str, order: int) -> list[str]:
    """Return the terms of a coefficient of the square of a series, but for those with the last."""
    twice = " + ".join(f"{name}{i} * {name}{order - i}" for i in reversed(range(1, (order + 1) // 2)))
    middle = [f"{name}{order // 2} * {name}{order // 2}"] if order % 2 == 0 else []
    return [*middle, *([f"2.0 * ({twice})"] if twice else [])]


def total(*terms: str) -> str:
    """Return a sum."""
    return " + ".join(terms)


def products(k: int, spring: bool) -> list[str]:
    """Return the lines that find the products at order k: a = z^2, b = z^4, g the rate of the impulse, Y = z y, V = z v."""
    if k == 0:
        lines = ["a0 = z0 * z0", "b0 = a0 * a0", "twice_a = 2.0 * a0", "grip = now.contact.held + damping * w0"]
        lines += ["twice_z = 2.0 * z0", "b_damping = b0 * damping", "g0 = b0 * grip"]
        return [*lines, "Y0 = z0 * y0", "V0 = z0 * v0"] if spring else lines
    lines = [f"{out}{k} = {total(*product('z', of, k), f'z{k} * {of}0', f'z0 * {of}{k}')}" for out, of in ("Yy", "Vv")]
    felt = total(*product("b", "w", k))
    return [
        *(lines if spring else ()),
        f"a{k} = {total(*square('z', k), f'twice_z * z{k}')}",
        f"b{k} = {total(*square('a', k), f'twice_a * a{k}')}",
        f"g{k} = ({f'damping * ({felt}) + ' if felt else ''}grip * b{k}) + b_damping * w{k}",
    ]


def following(k: int, spring: bool) -> list[str]:
    """Return the lines that find the coefficients of order k + 1 from the products at order k."""
    n, part = k + 1, repr(1.0 / (k + 1))
    lines = [f"z{n} = {0.5 / n!r} * w{k}", f"t{n} = {part} * z{k}", f"p{n} = {part} * g{k}"]
    if not spring:
        return [*lines, f"w{n} = {part} * (push * z{k}) - ({part} * share) * g{k}"]
    return [
        *lines,
        f"pull = pull_y * Y{k} + pull_y_dot * V{k}",
        f"w{n} = {part} * (pull + ground * z{k}) - ({part} * share) * g{k}",
        f"v{n} = {part} * (pull - push * z{k}) - ({part} * tool_share) * g{k}",
        f"y{n} = {part} * V{k}",
        f"q{n} = {part} * Y{k}",
    ]


def series(name: str, places: str) -> list[str]:
    """Return the function that expands one chain."""
    spring = "y" in places
    orders = range(ORDER + 1)
    sizes = ", ".join(f"size_{place}" for place in places)
    used = ", ".join(f"{letter}{k}" for letter in ("abgYV" if spring else "abg") for k in range(ORDER))
    lines = [
        f"cdef void {name}_series(const Piece *now, Work *work) noexcept nogil:",
        *(f"    cdef double {', '.join(f'{place}{k}' for k in orders)}" for place in places),
        f"    cdef double {used}",
        f"    cdef double size, {sizes}",
        f"    cdef double twice_z, twice_a, grip, b_damping, damping = now.contact.damping, share = now.share",
        "    cdef double pull, push = now.push, ground = now.ground, tool_share = now.tool_share" if spring else
        "    cdef double push = now.push + now.ground",
        *(["    cdef double pull_y = now.pull_y, pull_y_dot = now.pull_y_dot"] if spring else []),
    ]
    body = [f"{place}0 = work.x[{i}]" for i, place in enumerate(places)]
    body += [f"work.series[0][{i}] = {place}0" for i, place in enumerate(places)]
    for k in range(ORDER):
        body += products(k, spring) + following(k, spring)
        body += [f"work.series[{k + 1}][{i}] = {place}{k + 1}" for i, place in enumerate(places)]
    body += [f"size = 1.0 / max(fabs({place}0), 1.0)\nsize_{place} = size * size" for place in places]
    for j in range(LAST_ORDERS):
        k = ORDER - j
        squares = total(*(f"size_{place} * ({place}{k} * {place}{k})" for place in places))
        body.append(f"work.last_orders[{j}] = ({squares}) * {1.0 / len(places)!r}")
    return lines + ["    " + line for text in body for line in text.split("\n")]


def written() -> str:
    """Return the text of `taylor.pxi`."""
    return "\n\n\n".join([NOTICE, *("\n".join(series(*layout)) for layout in LAYOUTS.items())]) + "\n"


if __name__ == "__main__":
    OUT.write_text(written(), encoding="utf-8")
