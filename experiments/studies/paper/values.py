"""Values that the paper does not print, with the printed numbers that determine them, and corrections of the print."""

import math
from dataclasses import replace

import numpy as np
import polars as pl
from scipy.optimize import bisect

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.scenes import BISTABLE, BRAKE, HEAVY_MASS, HOLD, MOTION, ROBOT, ROBOT_AND_TOOL, scene
from experiments.studies.paper.runs import PAPER, Model
from impact_gym.robot import IMPACT, default_approach


def _short(value: float) -> str:
    return f"{value:.2g}".replace("e+0", "e")


def identified(model: Model = PAPER) -> pl.DataFrame:
    """Compute with each identified value the printed numbers that determine it."""

    def single(k_t: float) -> float:
        """Return 1 if the tool strikes once, and -1 if more often."""
        return 1.0 if len(model.simulate(scene(1e5, 1.0, ig.SpringDamper(k_t))).contacts) == 1 else -1.0

    onset = bisect(single, 80.0, 100.0)
    light, heavy = (model.simulate(scene(1e5, 1.0, robot=ROBOT, object_mass=mass)) for mass in (0.25, HEAVY_MASS))
    _, alone = model.trace(scene(1e5, 1.0, robot=ROBOT, distance=10.0))  # without an object
    before, velocity, after = alone.tool_velocity[:-2], alone.tool_velocity[1:-1], alone.tool_velocity[2:]
    minima = alone.time[1:-1][(velocity < before) & (velocity <= after)]
    off = 1e3 * np.abs(minima - light.contacts[0].start).min()
    _, trace = model.trace(scene(1e5, 0.5), scenes.CONSTANT_SPEED, 0.5)  # of Fig. 5a
    deepest = trace.time[(trace.tool_position - trace.object_position).argmax()]  # from here on the damping pulls
    moved = (replace(BISTABLE, rear_stop=stop) for stop in (BISTABLE.rear_stop, -0.01, -0.03))
    rigid, *mechanisms = (model.simulate(scene(1e3, 0.1, each)).object_velocity for each in (None, *moved))
    return pl.DataFrame([
        ("brake's deceleration", f"{BRAKE.deceleration:g} m/s^2", "slope changes at k_t about 90 N/m (Fig. 16)",
         f"{onset:.1f} N/m"),
        ("acceleration", f"{MOTION.acceleration:g} m/s^2", "the mechanism holds the tool (Fig. 23a)",
         f"{BISTABLE.holding_force:.3f} N, {HOLD:g} N needed"),
        ("object's distance", f"{scenes.DISTANCE:g} m", "damping force negative after 0.321 s (Fig. 5)",
         f"{deepest:.4f} s"),
        ("k_r", f"{_short(ROBOT.stiffness)} N/m", "impact at about 0.98, V_p about 1.94 (Fig. 13b), 1.88 m/s (14a)",
         f"{light.contacts[0].approach_velocity:.4f}, {light.object_velocity:.4f}, {heavy.object_velocity:.4f} m/s"),
        ("c_r", f"{ROBOT.damping:g} N s/m", "impact at a minimum of the velocity (Fig. 13b)",
         f"{off:.1f} ms from a minimum"),
        ("front stop", f"{1e3 * BISTABLE.front_stop:g} mm", "V_p 51 % lower than in Fig. 25",
         f"{100.0 * (1.0 - mechanisms[0] / rigid):.1f} %"),
        ("rear stop", f"{1e3 * BISTABLE.rear_stop:g} mm", "nothing",
         f"-10 to -30 mm change V_p by {np.ptp(mechanisms):.6f} m/s"),
        ("stops", f"{_short(BISTABLE.stop_stiffness)} N/m, ratio {BISTABLE.stop_damping_ratio:g}", "nothing", ""),
        ("Viper s650", "viper_s650.urdf, viper.py", "nothing", "estimates from public data"),
    ], ["quantity", "value", "printed", "ours"], orient="row")  # fmt: skip


def corrections() -> list[tuple[str, str]]:
    """Return places in the paper's print, each with a correction."""
    low, middle = (ig.effective_restitution("hu-guo", e) for e in (0.1, 0.5))
    line = default_approach()
    free = np.interp(IMPACT, line.position, line.effective)
    at_impact, along = (
        PAPER.simulate(scene(1e5, 1.0, robot=robot)).object_velocity for robot in (line.at(IMPACT), line.robot_table())
    )
    return [
        ("Eq. 6", "m_n is a misprint of m_p."),
        ("Eq. 7", f"An isolated contact has a restitution of {low:.4f} for e = 0.1, {middle:.3f} for 0.5."),
        ("Eq. 16", f"{ROBOT.mass:g} kg is for a flange that can only move along x; free, it has {free:.2f} kg. With "
                   f"values that vary along the line, V_p is {along:.3f} instead of {at_impact:.3f} m/s (Fig. 13b)."),
        ("Eq. 18", "Lacks a dot: m_p x_p''."),
        ("Eq. 22", "Its eq. 1 neglects the push of the coupling."),
        ("Fig. 14", f"{HEAVY_MASS:g} kg is {100.0 * HEAVY_MASS / ROBOT_AND_TOOL:.1f} % of 5.35 kg, not 48 %. As in "
                    "Fig. 13b, the impact must be at 0.98 m/s."),
        ("Section 5", f"No damped stop is completely inelastic: ours has e = {math.exp(-2.0):.3f}."),
    ]  # fmt: skip
