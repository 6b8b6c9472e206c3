"""The speed at which a tool may meet any object of a set-up so that no contact force exceeds a limit.

What is proven, for which coupling, and why. Let V be that speed, kept as `agents.baselines.shield` keeps it.

- The first contact begins at V at most and stays below the limit (`impact_gym.physics.peak`), as no push exceeds the
  one that V was found for. Rigid: there is none, as the flange does not speed up where an object may stand. Spring and
  damper, with the poles p1 <= p2 of the tool: while a contact loads, the tool does not go backwards, so that spring and
  damper push with at most m (p1 + p2) V as long as the free tool lags no more than the flange is slower than V; to that
  comes m p2 V, of what the flange goes on by. Bistable: the mechanism's largest force in front of its alignment.
- Later contacts are no faster. Rigid: the flange is not, and the object only moves forward. Spring and damper: past
  forces have put the tool back by some way y and add at most p1 y to its speed; where it meets the object again, y is
  at most the way in which the flange stops, and that is at most V / p1 where V is at most 2 a (1 / p1 - delay).
  Bistable: on the way back to the object the force is no larger than on the way from it, so they meet no faster than
  they parted; V is such that the flange stops before the slider reaches its rear stop.

Not part of the proof: touches too soft to raise the alarm, which may load a spring with up to the threshold; how far an
object gives before it raises the alarm, which for the stiffest is next to nothing; what a mechanism does once it has
snapped through.
"""

import math

from impact_gym.physics.dissipation import damping_factor
from impact_gym.physics.peak import permitted_speed
from impact_gym.scene import Bistable, Rigid, SpringDamper
from impact_gym.task import Task
from impact_gym.task.task import MOUNT_IDS

APART = 1e-6  # by which a critical damping ratio is taken to be larger, so that there are two poles


def permitted(task: Task, limit: float) -> float:
    """Return V (m/s) for a `limit` of force (N), less what a tool on a front stop may be faster than the flange.

    The worst object is the heaviest and stiffest. Its restitution is one end of the range or the other: an elastic one
    stores all of the energy, a very inelastic one resists with its damping.

    Raises:
        ValueError: nothing is proven for this set-up, or the limit permits no speed; names what must be otherwise.
    """
    drawn = [name for name in task.drawn if name in MOUNT_IDS]
    if task.robot is not None or drawn:
        got = ", ".join([*(f"{name} drawn" for name in drawn), *([f"{task.robot}"] if task.robot else [])])
        raise ValueError(f"a shield needs a rigid robot (robot = None), a known tool and a known coupling, got {got}")
    (_, mass), (_, stiffness), restitution, _ = task.scenario.by_id().values()
    reduced, push, push_rate, ahead, fastest = mass, 0.0, 0.0, 0.0, math.inf
    if not isinstance(task.coupling, Rigid):
        reduced = task.tool_mass * mass / (task.tool_mass + mass)
    if isinstance(task.coupling, SpringDamper):
        slow, fast = poles(task.coupling, task.tool_mass)
        push_rate, fastest = reduced * (slow + 2.0 * fast), fastest_on_a_spring(task, slow)
    elif isinstance(task.coupling, Bistable):
        largest = float(task.coupling.force(min(task.coupling.rest, task.coupling.peak_position)))
        push, fastest = reduced / task.tool_mass * largest, fastest_on_a_mechanism(task, task.coupling)
        ahead = faster_than_the_flange(task, task.coupling)
    dampings = [damping_factor(task.dissipation, end) for end in restitution]
    met = min(permitted_speed(limit, reduced, stiffness, d, push, push_rate) for d in dampings)
    if met <= ahead:
        raise ValueError(f"limit must permit more than the {ahead:.3g} m/s by which the tool may be faster than the "
                         f"flange, got {limit} N, which permits {met:.3g} m/s")  # fmt: skip
    return min(fastest, met - ahead)


def poles(coupling: SpringDamper, tool_mass: float) -> tuple[float, float]:
    """Return the slow and the fast pole (1/s) with which a tool of `tool_mass` (kg) follows the flange.

    Raises:
        ValueError: the tool would swing, and could hit harder the second time.
    """
    ratio = coupling.damping_ratio
    if ratio < 1.0:
        why = "a tool that swings may hit harder the second time"
        raise ValueError(f"coupling.damping_ratio must be at least 1 (no unit) for a shield, got {ratio}: {why}")
    omega, ratio = math.sqrt(coupling.stiffness / tool_mass), max(ratio, 1.0 + APART)
    fast = omega * (ratio + math.sqrt(ratio**2 - 1.0))
    return omega**2 / fast, fast


def fastest_on_a_spring(task: Task, slow: float) -> float:
    """Return the speed (m/s) from which the flange stops within 1 / `slow` (s) of its way."""
    delay, in_time = task.longest_delay, 1.0 / slow
    if delay >= in_time:
        why = "the flange would load the coupling for longer than the tool takes to come back"
        raise ValueError(f"reaction_delay must be below {in_time:.4g} s for a shield, got {delay} s: {why}")
    return 2.0 * task.acceleration_range[1] * (in_time - delay)


def fastest_on_a_mechanism(task: Task, mechanism: Bistable) -> float:
    """Return the speed (m/s) from which the flange stops within the stroke of the slider."""
    delay, stop = task.longest_delay, task.acceleration_range[1]
    return stop * (math.sqrt(delay**2 + 2.0 * (mechanism.rest - mechanism.rear_stop) / stop) - delay)


def held_up_to(task: Task, mechanism: Bistable) -> float:
    """Return the acceleration a (m/s^2) of the flange up to which a mechanism keeps its tool on the front stop.

    Whatever the flange did before, the stop's force is at least f - m ((1 + u) a + u brake), f being the mechanism's: u
    is by how much a tool on a spring overshoots the speed of a flange that sets out at once, exp(-2) at a damping ratio
    of 1 and less above.

    Raises:
        ValueError: the stop swings, or the least acceleration of the environment is too much.
    """
    if mechanism.stop_damping_ratio < 1.0:
        why = "a tool that swings on its stop may be faster than the flange"
        raise ValueError(f"coupling.stop_damping_ratio must be at least 1 (no unit) for a shield, "
                         f"got {mechanism.stop_damping_ratio}: {why}")  # fmt: skip
    held, overshoot = float(mechanism.force(mechanism.front_stop)) / task.tool_mass, math.exp(-2.0)
    least, brake = task.acceleration_range
    if held <= (1.0 + overshoot) * least + overshoot * brake:
        raise ValueError(f"coupling must hold a tool of {task.tool_mass} kg against {least} m/s^2 after braking at "
                         f"{brake} m/s^2 for a shield, got one that holds it against {held:.4g} m/s^2")  # fmt: skip
    return min(brake, (held - overshoot * brake) / (1.0 + overshoot))


def faster_than_the_flange(task: Task, mechanism: Bistable) -> float:
    """Return by how much (m/s) a tool on its front stop is faster than the flange at most: as the flange brakes."""
    stop_rate = math.sqrt(mechanism.stop_stiffness / task.tool_mass)
    return (held_up_to(task, mechanism) + task.acceleration_range[1]) / (math.e * stop_rate)
