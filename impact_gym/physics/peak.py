"""The largest force of a Hertzian contact in closed form, and the speed that keeps it below a limit.

Two bodies of reduced mass M meet at v; the damping factor is d, and P is the largest push that drives them together:
M delta'' = P - F with F = k delta^1.5 (1 + d delta' / v). All of it follows from the work done while they approach.

Without a push, the variables separate. With F0 = (M v^2)^0.6 k^0.4 and g = 1 + d delta' / v at the peak,

    8/5 g - ln g = 8/5 + d - ln(1 + d)          F_peak / F0 = (3/2 (g - 1) / d^2)^0.6 g  =  p(d)

which is 1.1433 for d = 0, falls at first as damping takes energy, and rises as d^0.4 in the end, as damping is a force
itself. It has no other minimum, so over a range of restitutions one of the two ends is the worst: p falls where
q = 1/1.2 d^2 / (1 + d) leaves 8/5 q - ln(1 + q) below d - ln(1 + d), and the derivative of their difference has the
sign of 0.72 - 1.28 d - 0.4 d^2, which changes once.

With a constant push, let z be how fast delta' at a given delta grows with P. From M delta' (d delta' / d delta) = P - F
follows that M delta' z grows over delta by at most 1, so it is at most delta; as F is stationary at its peak, the peak
grows with P by at most 3/2 F / (F - P). Integrated from P = 0, where the peak is p F0,

    F^(2/3) (F - 5/2 P)  is at most  (p F0)^(5/3)

For d = 0 they are equal, which says that kinetic energy and the push's work are stored. A push that varies below P does
less, and so does loading anew after a partial release: in the plane of delta and delta' neither crosses the first
loading under P.
"""

import math

from scipy.optimize import brentq

from impact_gym.validation import number

WORTH_A_PUSH = 2.5
"""A push from rest is doubled by a linear spring and becomes so many times itself on a Hertzian one."""
HARDLY_DAMPED = 1e-5  # damping factor, below which p is p(0) to 4e-6; p(0) is the larger


def peak_factor(damping: float) -> float:
    """Return p(d), the peak force of an isolated contact with damping factor `damping` over F0.

    Raises:
        ValueError: `damping` is negative or not finite.
    """
    d = number("damping", damping, "(no unit)", at_least=0)
    if d < HARDLY_DAMPED:
        return 1.25**0.6
    right = d - math.log1p(d)
    above = brentq(lambda x: 1.6 * x - math.log1p(x) - right, 0.0, right / 0.6, xtol=1e-300, rtol=1e-14)  # g - 1
    return (1.5 * above / d / d) ** 0.6 * (1.0 + above)


def permitted_speed(
    limit: float, mass: float, stiffness: float, damping: float, push: float = 0.0, push_rate: float = 0.0
) -> float:
    """Return the largest approach velocity v (m/s) at which no force of the contact exceeds `limit`.

    Exact for an isolated contact, and for an elastic one under a constant push; else what is proven above.

    Args:
        limit: N.
        mass: kg, reduced; that of the object where the tool's motion is imposed.
        stiffness: N/m^1.5.
        damping: factor d of the contact, see `physics.dissipation.damping_factor`.
        push: N, the most that drives the two together: `mass` times the acceleration with which they would approach.
        push_rate: N s/m, by how much more it does for each m/s of v.

    Raises:
        ValueError: an argument is out of range, or the push alone may exceed the limit; names it.
    """
    push = number("push", push, "N", at_least=0)
    rate = WORTH_A_PUSH * number("push_rate", push_rate, "N s/m", at_least=0)
    left = number("limit", limit, "N", above=WORTH_A_PUSH * push) - WORTH_A_PUSH * push
    number("mass", mass, "kg", above=0)
    number("stiffness", stiffness, "N/m^1.5", above=0)
    square = mass * peak_factor(damping) ** (5 / 3) * (stiffness / limit) ** (2 / 3)
    return 2.0 * left / (rate + math.sqrt(rate**2 + 4.0 * square * left))  # square v^2 + rate v = left
