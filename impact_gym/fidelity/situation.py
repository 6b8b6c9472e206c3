"""What is known about an approach before it is simulated: the encounter, the contact's scales, what follows."""

import math
from dataclasses import dataclass

from impact_gym.fidelity.aftermath import WATCHED, pursuit, slider_pursuit
from impact_gym.fidelity.encounter import Encounter, Mass, meet
from impact_gym.fidelity.isolated import Isolated, isolated
from impact_gym.motion import Trapezoid
from impact_gym.physics import impact
from impact_gym.scene import Bistable, Rigid, Scene, SpringDamper

NEAR = 0.9  # of the object's way: from here on a second contact is counted as possible
CHASED = 0.8  # likewise: from here on a bound on a mechanism's tool is replaced by following it
TRAPPED = 0.8  # of the energy that lifts a slider over its alignment: below, its way is sure enough to be followed
HELD = 0.45  # of the preload that the ramp takes: a sprung stop overshoots to about twice
LATE = 0.5  # late_brake above which a brake rules the contact
COMPRESSED = 2.5  # t0, after which any contact is compressed


@dataclass(frozen=True, slots=True)
class Situation:
    """A scene with a rigid robot, its motion, and its first contact as if that were instantaneous."""

    scene: Scene
    motion: Trapezoid
    mass: Mass | None  # the tool on its spring
    met: Encounter
    contact: Isolated
    velocities: tuple[float, float]  # m/s, of tool and object after an impact without the coupling's impulse
    brake_time: float  # s, from the onset
    pursuit: float  # -, see `aftermath`
    push: float  # m/s^2, mean acceleration of the tool by its coupling during the contact
    work: float  # m/s^2, the same with all its parts taken as positive

    @property
    def velocity(self) -> float:
        """Approach velocity v, m/s."""
        return self.met.velocity

    @property
    def share(self) -> float:
        """m_p / (m_t + m_p); 0 for an imposed tool, as it loses no velocity."""
        if isinstance(self.scene.coupling, Rigid):
            return 0.0
        return self.scene.object.mass / (self.scene.tool.mass + self.scene.object.mass)

    @property
    def braked(self) -> float:
        """Velocity that the brake takes off during the contact, over v."""
        return self.motion.deceleration * max(self.contact.duration - self.brake_time, 0.0) / self.velocity

    @property
    def late_brake(self) -> float:
        """Share of V_p that the brake may take: `braked` times the share of the contact that is left for it.

        Once the contact is compressed the object moves with the tool, and only the restitution is still to come.
        """
        late = self.braked * max(1.0 - self.brake_time / self.contact.duration, 0.0)
        return late - (1.0 - self.early) * max(late - self.contact.restitution, 0.0)

    @property
    def early(self) -> float:
        """From 1, the brake begins with the contact, to 0, once it is compressed; the elastic contact is in 1.61 t0."""
        return max(1.0 - self.brake_time / (COMPRESSED * self.contact.time), 0.0)

    @property
    def ramped(self) -> float:
        """Velocity that the ramp adds during the contact, over v."""
        return self.met.acceleration * self.contact.duration / self.velocity

    @property
    def phi(self) -> float:
        """Push of the coupling over v / t0, in size; above about 0.25 / d a contact of much damping d never ends."""
        return abs(self.work) * self.contact.time / self.velocity

    @property
    def load(self) -> float:
        """Velocity that the push adds to the tool during the contact, over v."""
        return abs(self.work) * self.contact.duration / self.velocity

    @property
    def again(self) -> float:
        """From 0, no second contact, to 1, one is foreseen."""
        return min(max((self.pursuit - NEAR) / (1.0 - NEAR), 0.0), 1.0)

    @property
    def lift(self) -> float:
        """Force that the ramp needs over the preload that holds a mechanism's slider at its stop; 0 without one."""
        coupling = self.scene.coupling
        if not isinstance(coupling, Bistable):
            return 0.0
        return self.scene.tool.mass * self.motion.acceleration / float(coupling.force(coupling.front_stop))

    @property
    def coast(self) -> float:
        """Time since the ramp ended, s."""
        return max(self.met.time - self.motion.speed / self.motion.acceleration, 0.0)

    @property
    def left(self) -> float:
        """Share of the swing from the ramp that is left in the tool on its spring at the impact."""
        return math.exp(-min(self.mass.decay * self.coast, 700.0)) if self.mass else 0.0

    @property
    def quiet(self) -> bool:
        """True if one contact, after the ramp and mostly before the brake, decides V_p."""
        calm = self.pursuit < NEAR and self.met.acceleration == 0.0 and self.late_brake < LATE
        return calm and self.lift < HELD


def final(now: Situation) -> float:
    """Time (s) after which V_p no longer changes: `WATCHED` after the first contact."""
    return now.met.time + WATCHED


def situation(scene: Scene, motion: Trapezoid) -> Situation:
    """Return what is known about `scene` with its robot taken as rigid."""
    coupling, m_t, m_p = scene.coupling, scene.tool.mass, scene.object.mass
    mass = None
    if isinstance(coupling, SpringDamper):
        mass = Mass(math.sqrt(coupling.stiffness / m_t), coupling.damping_ratio)
    met = meet(motion, scene.object.distance, mass)
    v = met.velocity
    rigid = isinstance(coupling, Rigid)
    contact = isolated(scene.contact, m_p if rigid else m_t * m_p / (m_t + m_p), v)
    e, T = contact.restitution, contact.duration
    after = (v, (1.0 + e) * v) if rigid else tuple(map(float, impact.free_tool(m_t, m_p, v, 0.0, e)))
    brake = motion.brake
    brake_time = contact.detection(brake.threshold) + brake.delay if brake else math.inf
    push = work = 0.0
    change = after[0] - v
    if isinstance(coupling, Bistable):
        push = work = mechanism_push(coupling, change * T) / m_t
    elif mass is not None:
        push, work = spring_push(mass, met, change, T)
    chase = _chase(motion, met, brake_time, (after[0], after[1]), mass, coupling, m_t)
    return Situation(scene, motion, mass, met, contact, (after[0], after[1]), brake_time, chase, push, work)


def spring_push(mass: Mass, met: Encounter, change: float, T: float) -> tuple[float, float]:
    """Mean acceleration of the tool by spring and damper over a contact, m/s^2; then with all parts positive.

    Of paper, eq. 21, with the tool's velocity changing by `change` (m/s) evenly over the contact's duration T (s).
    """
    stiff, damped = mass.frequency**2, 2.0 * mass.damping_ratio * mass.frequency
    parts = (
        -stiff * met.deflection,
        -met.deflection_rate * (0.5 * stiff * T + damped),
        -change * (stiff * T / 6.0 + 0.5 * damped),
    )
    return sum(parts), sum(map(abs, parts))


def mechanism_push(mechanism: Bistable, slip: float) -> float:
    """Mean force (N) of the mechanism's spring over a contact that makes its slider slip by half of `slip` (m).

    Simpson's rule on paper, eq. 23, the stops left out.
    """
    x = mechanism.front_stop

    def force(position: float) -> float:
        return float(mechanism.force(max(position, mechanism.rear_stop)))

    return (force(x) + 4.0 * force(x + slip / 8.0) + force(x + slip / 2.0)) / 6.0


def _chase(
    motion: Trapezoid,
    met: Encounter,
    brake_time: float,
    velocities: tuple[float, float],
    mass: Mass | None,
    coupling: Rigid | SpringDamper | Bistable,
    tool_mass: float,
) -> float:
    if not isinstance(coupling, Bistable):
        return pursuit(motion, met, brake_time, velocities, mass)
    bound = pursuit(motion, met, brake_time, velocities, push=coupling.peak_force / tool_mass)
    lost = met.flange_velocity - velocities[0]
    hill = coupling.barrier - float(coupling.energy(coupling.front_stop))
    if bound < CHASED or 0.5 * tool_mass * lost**2 > TRAPPED * hill:
        return bound
    return slider_pursuit(motion, met, brake_time, velocities, coupling, tool_mass)
