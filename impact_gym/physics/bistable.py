"""The bistable mechanism: a spring on a pivot at height H above the slider's path (paper, eq. 23-24, Fig. 21).

x is the position of the slider from the vertical alignment, where the spring is shortest and pushes neither way.
"""

import numpy as np

from impact_gym.kernel import kernel


@kernel
def force(stiffness: float, free_length: float, height: float, position: float) -> float:
    """Force on the slider along its path, N: k (L0 - L) x / L with L = sqrt(H^2 + x^2) (paper, eq. 23-24)."""
    L = np.hypot(height, position)
    return stiffness * (free_length - L) * position / L


@kernel
def force_slope(stiffness: float, free_length: float, height: float, position: float) -> float:
    """Derivative of the force by the position, N/m: k (L0 H^2 / L^3 - 1)."""
    L = np.hypot(height, position)
    return stiffness * (free_length * height * height / (L * L * L) - 1.0)


@kernel
def energy(stiffness: float, free_length: float, height: float, position: float) -> float:
    """Elastic energy of the spring, J."""
    squeeze = free_length - np.hypot(height, position)
    return 0.5 * stiffness * squeeze * squeeze


@kernel
def stop_force(stiffness: float, damping: float, depth: float, depth_rate: float) -> float:
    """Force of a stop pressed in by `depth` (m), N: one-sided linear spring and damper that never pulls.

    Such a stop is never completely inelastic: its restitution at zeta = 1 is exp(-2) = 0.1353, and falls as
    1 / (4 zeta^2) beyond.
    """
    return max(stiffness * depth + damping * depth_rate, 0.0) if depth > 0.0 else 0.0
