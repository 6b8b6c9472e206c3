"""Approximate restitution and Hertz stiffness by MuJoCo's `solref`, and print the results; needs the extra `robot`."""

from math import acos, acosh, log, pi, sqrt
from typing import Any

import mujoco

import impact_gym as ig
from impact_gym.physics.dissipation import damping_factor

TOOL, OBJECT = 0.125, 0.25  # kg, masses
REDUCED = TOOL * OBJECT / (TOOL + OBJECT)
MODEL = """<mujoco>
  <option timestep="{step}" gravity="0 0 0"/>
  <worldbody>
    <body><joint type="slide" axis="1 0 0"/><geom name="tool" size="0.05" mass="{tool}"/></body>
    <body pos="{ahead} 0 0"><joint type="slide" axis="1 0 0"/><geom name="object" size="0.05" mass="{object}"/></body>
  </worldbody>
  <contact><pair geom1="tool" geom2="object" condim="1" solref="{solref}" solimp="{d} {d} 0.001 0.5 2"/></contact>
</mujoco>"""


def alone(contact: ig.Contact, speed: float) -> tuple[float, float]:
    """Return duration (s) and peak force (N) of the contact if tool and object are free and meet at `speed` (m/s)."""
    scene = ig.Scene(ig.Tool(1.0), ig.Object(REDUCED, 0.3), contact)  # a rigidly coupled tool acts as an infinite mass
    struck = ig.simulate(scene, ig.Trapezoid(speed, 100.0)).contacts[0]
    assert struck.end is not None
    return struck.end - struck.start, struck.peak_force


def solref(contact: ig.Contact, speed: float) -> tuple[float, float]:
    """Stiffness (1/s^2) and damping (1/s) that give the restitution and duration of `contact` at a speed (m/s)."""
    zeta = damping_factor("exact", contact.restitution, 1.0, 0.0) / 2  # damping ratio; the contact never pulls
    angle = acos(zeta) / sqrt(1 - zeta**2) if zeta < 1 else acosh(zeta) / sqrt(zeta**2 - 1)
    omega = 2 * angle / alone(contact, speed)[0]
    return omega**2, 2 * zeta * omega


def model(stiffness: float, damping: float, step: float, ahead: float, d: float = 0.9) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of two bodies on sliders, `ahead` (m) apart; impedance `d` at all depths."""
    words = {"step": step, "ahead": 0.1 + ahead, "d": d, "tool": TOOL, "object": OBJECT}
    loaded = mujoco.MjModel.from_xml_string(MODEL.format(solref=f"-{stiffness} -{damping}", **words))
    return loaded, mujoco.MjData(loaded)


def strike(stiffness: float, damping: float, step: float, speed: float = 1.0) -> tuple[float, float]:
    """Return restitution and peak force (N) of two free bodies."""
    loaded, data = model(stiffness, damping, step, ahead=0.01)
    data.qvel[0] = speed
    peak = force = 0.0
    while not (peak > 0.0 and force == 0.0):
        mujoco.mj_step(loaded, data)
        force = data.efc_force[0] if data.nefc else 0.0
        peak = max(peak, force)
    return (data.qvel[1] - data.qvel[0]) / speed, peak


def approach(stiffness: float, damping: float, d: float, spring: float, step: float = 1e-4) -> float:
    """Return V_p (m/s), the object's final velocity, for the paper's rule and a critically damped `spring` (N/m)."""
    loaded, data = model(stiffness, damping, step, 0.2505, d)
    position = velocity = 0.0  # m, m/s, of the flange
    resistance, alarm = 2 * sqrt(spring * TOOL), 10.0  # N s/m, damping; s, time of the alarm (10: no alarm yet)
    for i in range(round(0.6 / step)):
        target = 1.0 if i * step < alarm + 0.016 else 0.0
        change = max(-8.0 * step, min(8.0 * step, target - velocity))
        position, velocity = position + (velocity + change / 2) * step, velocity + change
        data.qfrc_applied[0] = -spring * (data.qpos[0] - position) - resistance * (data.qvel[0] - velocity)
        mujoco.mj_step(loaded, data)
        if alarm == 10.0 and data.nefc and data.efc_force[0] > 1.0:
            alarm = i * step
    return float(data.qvel[1])


if __name__ == "__main__":
    print("restitution: asked for, by the textbook's formula, by the one above")
    for e in (0.9, 0.5, 0.3):
        textbook = -log(e) / sqrt(pi**2 + log(e) ** 2)
        k, b = solref(ig.Contact(1e5, e, "exact"), 1.0)
        print(f"{e}: {strike(k, 2 * textbook * sqrt(k), 1e-5)[0]:.3f} {strike(k, b, 1e-5)[0]:.3f}")

    hertz = ig.Contact(1e5, 0.5, "exact")
    k, b = solref(hertz, 1.0)
    lasting, _ = alone(hertz, 1.0)
    print(f"\ncontact of {1e3 * lasting:.1f} ms, e = 0.5: steps in it, restitution")
    for count in (5, 10, 100, 1000):
        print(f"{count}: {strike(k, b, lasting / count)[0]:.3f}")

    print("\nspeed, Hertz: duration and peak, MuJoCo: peak")
    for speed in (0.3, 1.0, 1.5):
        duration, peak = alone(hertz, speed)
        theirs = strike(k, b, lasting / 1000, speed)[1]
        print(f"{speed} m/s: {1e3 * duration:.1f} ms {peak:.1f} N, {theirs:.1f} N")

    print("\nV_p of an approach: e, k_c, spring; impact_gym; MuJoCo, d = 0.9 and 0.01")
    for e, k_c, spring in ((0.9, 1e5, 50.0), (0.5, 1e5, 150.0), (0.5, 1e3, 50.0), (0.1, 1e3, 150.0)):
        contact = ig.Contact(k_c, e, "exact")
        scene = ig.Scene(ig.Tool(TOOL), ig.Object(OBJECT, 0.2505), contact, ig.SpringDamper(spring))
        ours = ig.simulate(scene, ig.Trapezoid(1.0, 8.0, ig.Brake(1.0, 0.016)), 0.6).object_velocity
        k, b = solref(contact, 1.0)
        stiff, soft = approach(k, b, 0.9, spring), approach(k, b, 0.01, spring)
        print(f"{e}, {k_c:g}, {spring:g}: {ours:.3f}; {stiff:.3f} {soft:.3f}")
