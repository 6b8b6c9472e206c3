"""impact_gym, which solves the law without steps, and the law in steps of symplectic Euler, as most engines step.

`Contact(k_c, e, "exact")` is the law of the cases; a restitution of 0 is asked for as 0.001.
"""

from experiments.studies.engines.cases import Case
from experiments.studies.engines.drive import SAME, Step, Variant
from impact_gym.physics.dissipation import damping_factor

PACKAGE = "impact-gym"


def build(case: Case, step: float) -> Step:
    """Return the law of the cases, stepped."""
    d, tool, target, approach = damping_factor("exact", case.asked_restitution), 0.0, case.distance, 0.0
    v, v_p = case.start_speed, 0.0

    def advance(push: float) -> tuple[float, float, float]:
        nonlocal tool, target, approach, v, v_p
        delta, rate, force = tool - target, v - v_p, 0.0
        if delta > 0.0:
            approach = approach or max(rate, 1e-6)  # m/s, velocity at the onset of this contact
            force = max(case.stiffness * delta**1.5 * (1.0 + d * rate / approach), 0.0)
        else:
            approach = 0.0
        v, v_p = v + (push - force) / case.tool_mass * step, v_p + force / case.object_mass * step
        tool, target = tool + v * step, target + v_p * step
        return tool, v, v_p

    return advance


VARIANTS = {"law in steps": Variant("k_c and e", SAME)}
