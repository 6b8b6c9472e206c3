"""Momentum budget of a contact (paper, eq. 20-22)."""

from impact_gym.kernel import inner_kernel


@inner_kernel
def spring_damper_impulse(
    tool_mass: float, frequency: float, damping_ratio: float, deflection_integral: float, deflection_change: float
) -> float:
    """Impulse of spring and damper on the tool, N s (paper, eq. 21).

    Takes the integral of the deflection over the contact (m s) and its change (m), the integral of its rate.
    """
    return -tool_mass * frequency * (frequency * deflection_integral + 2.0 * damping_ratio * deflection_change)


@inner_kernel
def momentum_residual(tool_change: float, object_change: float, coupling_impulse: float) -> float:
    """What eq. 20 leaves over, N s: the momentum gained by tool and object less the impulse of the coupling."""
    return tool_change + object_change - coupling_impulse
