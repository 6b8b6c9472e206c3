"""Closed formulas for an instantaneous impact, the limit of a stiff contact (paper, eq. 1-4, 22), and for sliding.

The arguments of each function are broadcast against each other as NumPy arrays.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from impact_gym.kernels import GRAVITY as GRAVITY  # m/s^2, standard gravity
from impact_gym.support.validation import array, number

Velocities = NDArray[np.float64] | np.float64


def rigid_tool(tool_velocity: ArrayLike, object_velocity: ArrayLike, restitution: ArrayLike) -> Velocities:
    """Return the object's final velocity, m/s, after an impact by a tool that keeps its velocity (paper, eq. 1).

    Raises:
        ValueError: a velocity (m/s) is not finite or a restitution is outside [0, 1].
    """
    v_t, v_p = _checked("tool_velocity", tool_velocity, "m/s"), _checked("object_velocity", object_velocity, "m/s")
    e = _checked("restitution", restitution, "(no unit)", at_least=0, at_most=1)
    return v_t + e * (v_t - v_p)


def free_tool(
    tool_mass: ArrayLike, object_mass: ArrayLike, tool_velocity: ArrayLike, object_velocity: ArrayLike,
    restitution: ArrayLike, impulse: ArrayLike = 0.0,
) -> tuple[Velocities, Velocities]:  # fmt: skip
    """Return the final velocities of tool and object, m/s, after an impact of two free bodies (paper, eq. 3-4).

    A coupling gives the `impulse` (N s) to the tool during the impact (paper, eq. 21-22). The impulse changes the
    velocities of tool and object by the same amount.

    Raises:
        ValueError: a mass (kg) is not positive, a restitution is outside [0, 1], or a number is not finite.
    """
    m_t, m_p = _checked("tool_mass", tool_mass, "kg", above=0), _checked("object_mass", object_mass, "kg", above=0)
    v_t, v_p = _checked("tool_velocity", tool_velocity, "m/s"), _checked("object_velocity", object_velocity, "m/s")
    e = _checked("restitution", restitution, "(no unit)", at_least=0, at_most=1)
    push = _checked("impulse", impulse, "N s") / (m_t + m_p)
    V_t = v_t + m_p / (m_t + m_p) * (1 + e) * (v_p - v_t) + push
    V_p = v_p - m_t / (m_t + m_p) * (1 + e) * (v_p - v_t) + push
    return V_t, V_p


def sliding_distance(object_velocity: ArrayLike, friction: ArrayLike) -> Velocities:
    """Return how far the object slides until friction stops it, m: velocity^2 / (2 friction g); inf if it never stops.

    Raises:
        ValueError: a velocity (m/s) is not finite or a coefficient of friction is negative.
    """
    v_p = _checked("object_velocity", object_velocity, "m/s")
    deceleration = GRAVITY * _checked("friction", friction, "(no unit)", at_least=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(v_p == 0.0, 0.0, v_p**2 / (2.0 * deceleration))[()]


def _checked(field: str, values: ArrayLike, unit: str, **limits: float) -> NDArray[np.float64]:
    given = array(field, values, what=f"numbers in {unit}")
    for value in given.flat:
        number(field, value, unit, **limits)
    return given.astype(np.float64)
