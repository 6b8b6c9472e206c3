"""Values that the paper does not print, with the printed numbers that determine them, and corrections of the print."""

import math
from dataclasses import replace

import numpy as np

import impact_gym as ig
from experiments.lab.scenes import (
    BRAKE,
    DISTANCE,
    HEAVY_MASS,
    HOLD,
    MECHANISM,
    MOTION,
    ROBOT,
    ROBOT_AND_TOOL,
    STEADY,
    scene,
)  # fmt: skip
from experiments.lab.study import Row
from experiments.studies.paper.models import PAPER, Model
from experiments.studies.paper.runs import enclose_changes
from impact_gym.robot import IMPACT, default_approach


def _sign_change(model: Model) -> float:
    """Return when the damping force of Fig. 5a becomes negative, s: when the penetration is largest."""
    _, trace = model.trace(scene(1e5, 0.5), STEADY, 0.5)
    return float(trace.time[(trace.tool_position - trace.object_position).argmax()])


def _from_minimum(model: Model) -> float:
    """Return the time from the impact of Fig. 13b to the nearest minimum of the velocity without an object, ms."""
    _, trace = model.trace(scene(1e5, 1.0, robot=ROBOT, distance=10.0))
    velocity = trace.tool_velocity
    minima = trace.time[1:-1][(velocity[1:-1] < velocity[:-2]) & (velocity[1:-1] <= velocity[2:])]
    start = model.simulate(scene(1e5, 1.0, robot=ROBOT)).contacts[0].start
    return 1e3 * float(np.abs(minima - start).min())


def identified(model: Model = PAPER) -> list[Row]:
    """Compute with each identified value the printed numbers that determine it."""

    def along(k_t: float) -> Row:
        contacts = model.simulate(scene(1e5, 1.0, ig.SpringDamper(k_t))).contacts
        return {"k_t": k_t, "contacts": len(contacts)}

    onset = next(row["k_t"] for row in enclose_changes((80.0, 100.0), along, "k_t", "contacts") if row["contacts"] > 1)
    light, heavy = (model.simulate(scene(1e5, 1.0, robot=ROBOT, object_mass=mass)) for mass in (0.25, HEAVY_MASS))
    rigid, *mechanisms = (
        model.simulate(scene(1e3, 0.1, coupling)).object_velocity
        for coupling in (None, *(replace(MECHANISM, rear_stop=place) for place in (MECHANISM.rear_stop, -0.01, -0.03)))
    )
    table = (
        ("brake's deceleration", f"{BRAKE.deceleration:g} m/s^2", "slope of V_p changes at k_t about 90 N/m (Fig. 16)",
         f"a second contact from {onset:.1f} N/m on"),
        ("acceleration", f"{MOTION.acceleration:g} m/s^2", "the slider stays on its front stop (Fig. 23a)",
         f"needs {HOLD:g} N, the mechanism has {MECHANISM.holding_force:.3f} N"),
        ("distance of the object", f"{DISTANCE:g} m", "damping force negative after 0.321 s (Fig. 5)",
         f"{_sign_change(model):.4f} s"),
        ("m_r", f"{ROBOT.mass:g} kg", "m_r + m_t = 5.35 kg", f"{ROBOT_AND_TOOL:.2f} kg"),
        ("k_r", f"{ROBOT.stiffness:.2g} N/m", "impact at about 0.98 m/s (Fig. 13b), V_p about 1.94 and 1.88 m/s (14a)",
         f"{light.contacts[0].approach_velocity:.4f}, {light.object_velocity:.4f}, {heavy.object_velocity:.4f} m/s"),
        ("c_r", f"{ROBOT.damping:g} N s/m", "as k_r; impact at a minimum of the velocity (Fig. 13b)",
         f"{_from_minimum(model):.1f} ms from a minimum"),
        ("front stop", f"{1e3 * MECHANISM.front_stop:g} mm", "V_p 51 % lower with the mechanism (Fig. 25)",
         f"{100.0 * (1.0 - mechanisms[0] / rigid):.1f} %"),
        ("rear stop", f"{1e3 * MECHANISM.rear_stop:g} mm", "none",
         f"from -10 to -30 mm, V_p changes by {np.ptp(mechanisms):.6f} m/s"),
        ("stops", f"{MECHANISM.stop_stiffness:.0e} N/m, damping ratio {MECHANISM.stop_damping_ratio:g}", "none",
         "much stiffer than the spring"),
        ("the Viper's inertia, stiffness", "viper_s650.urdf, viper.py", "none",
         "estimates from public CAD meshes and data sheets"),
    )  # fmt: skip
    return [dict(zip(("quantity", "value", "printed", "ours"), row, strict=True)) for row in table]


def corrections() -> list[tuple[str, str]]:
    """Return places in the paper's print, each with a correction."""
    low, middle = (ig.effective_restitution("hu-guo", e) for e in (0.1, 0.5))
    free = np.interp(IMPACT, default_approach().position, default_approach().effective)
    return [
        ("Eq. 6", "m_n is a misprint of m_p."),
        ("Eq. 7", f"An isolated contact has a restitution of {low:.4f} for e = 0.1, and {middle:.3f} for e = 0.5."),
        ("Eq. 16", f"{ROBOT.mass:g} kg is the mass of a flange that can only move along the line. A free flange feels "
                   f"{free:.2f} kg in the first instant of the impact."),
        ("Eq. 18", "Lacks a dot: the term is m_p x_p''."),
        ("Eq. 22", "Contains eq. 1, which neglects the push of the coupling during the contact."),
        ("Fig. 14", f"{HEAVY_MASS:g} kg is {100.0 * HEAVY_MASS / ROBOT_AND_TOOL:.1f} % of 5.35 kg, not 48 %. "
                    "An impact at 0.95 m/s contradicts the 0.98 m/s of Fig. 13b: the motion before is the same."),
        ("Section 5", "No finite damping makes a stop completely inelastic. With our damping ratio of 1 it has a "
                      f"restitution of {math.exp(-2.0):.3f}."),
    ]  # fmt: skip
