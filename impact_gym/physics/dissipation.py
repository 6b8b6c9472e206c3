"""From the nominal restitution to the damping factor d = (chi / k_c) v_in, which alone decides an isolated contact."""

from impact_gym.kernel import kernel


@kernel
def hu_guo(restitution: float) -> float:
    """Damping factor d after Hu and Guo (paper, eq. 7): d = 3/2 (1 - e) / e."""
    return 1.5 * (1.0 - restitution) / restitution
