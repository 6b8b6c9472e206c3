"""A chain whose flange is told what to do on the way, moved from one instant that matters to the next."""

from __future__ import annotations

from collections.abc import Sequence
from math import copysign, hypot, inf, sqrt
from types import SimpleNamespace as Record
from typing import Any

import numpy as np
from scipy.optimize import brentq

from experiments.reference import FLIGHT_ATOL, FLIGHT_RTOL, flight
from experiments.reference.chain import Chain, Scales, System
from experiments.reference.command import Command
from experiments.reference.phases import Switch, Vector, advance

V_FLOOR = 1e-12  # m/s, of the approach velocity, as in the environment
UNITS = Scales(1.0, 1.0, 1.0)  # of a flight
PATIENCE = 3000  # evaluations an explicit method is given in a phase of a contact; one that needs more is stiff
STIFF_RTOL = 1e-8  # at least, of the implicit method: it is of lower order, and what is stiff changes slowly


class Steered(Command):
    """The imposed motion as it is commanded."""

    def __init__(self, nodes: Sequence[float], threshold: float) -> None:
        brake = Record(threshold=threshold, delay=0.0, deceleration=None)
        super().__init__(Record(speed=0.0, acceleration=1.0, brake=brake), tuple(nodes))

    def at(self, t: float) -> tuple[float, float, float, float]:
        """As `Command.at`; on its way back the motion is not cut at nodes, which `Command` only meets going ahead."""
        x, v, a, cut = super().at(t)
        return x, v, a, cut if cut > t else min((p[0] for p in self.pieces if p[0] > t), default=inf)

    def steer(self, t: float, velocity: float, acceleration: float) -> None:
        """From t (s) on go to `velocity` (m/s) at `acceleration` (m/s^2), then hold it."""
        x, v, _, _ = self.at(t)
        ramp = abs(velocity - v) / acceleration
        there = (t + ramp, x + (v + velocity) / 2 * ramp, velocity, 0.0)
        self.pieces = [(t, x, v, copysign(acceleration, velocity - v)), there]

    def detect(self, t: float) -> None:
        """The force passed the threshold at t; what follows from it is for others to say."""
        self.detection_time = t

    def rests(self, t: float) -> bool:
        """Whether the flange stands still from t on, as far as is known."""
        _, v, a, cut = self.at(t)
        return v == 0 and a == 0 and cut == inf


class StiffError(Exception):
    """An explicit method needs too many steps."""


class Equations(System):
    """Equations that are evaluated so often and no more."""

    left = inf

    def rates(self, tau: float, y: Vector) -> list[float]:
        """As in `System`."""
        self.left -= 1
        if self.left < 0:
            raise StiffError
        return super().rates(tau, y)


class Motion:
    """The chain under way, and what it came to so far."""

    def __init__(self, scene: Any, threshold: float, rtol: float) -> None:
        self.chain = Chain(scene, Record(speed=0.0, acceleration=1.0, brake=None))
        self.command = self.chain.command = Steered(self.chain.command.nodes.tolist(), threshold)
        self.rtol = rtol
        self.t = 0.0  # s
        self.peak_force = 0.0  # N
        self.contacts = 0
        self.first_contact = inf  # s
        self._impulse = 0.0  # N s, of the contacts that are over
        self._fly(np.array([-scene.object.distance, 0.0, 0.0, 0.0, 0.0, 0.0]))
        rates = max(self.chain.slow_rate, self.chain.stop_rate)
        self._longest_step = 1 / rates if rates else inf  # s, a sixth of a period; twice that in flight
        self._flight_atol = FLIGHT_ATOL * np.tile([1.0, max(1.0, self.chain.stop_rate)], 4)

    @property
    def state(self) -> Vector:
        """Penetration, deflections of coupling and robot, each with its rate; SI."""
        scales = self._system.scales
        return self._y[:6] * np.tile([scales.length, scales.length / scales.time], 3)

    @property
    def touching(self) -> bool:
        """Whether a contact is under way."""
        return self._system.touching

    @property
    def force(self) -> float:
        """Contact force, N."""
        return self._system.force(self._y) * self._system.scales.force

    @property
    def object_velocity(self) -> float:
        """Of the impulse it was given, m/s."""
        return (self._impulse + self._system.scales.impulse * float(self._y[6])) / self.chain.m_p

    @property
    def deflection(self) -> float:
        """Tool minus flange, from rest, m."""
        return -float(self.state[2])

    def advance(self, until: float) -> None:
        """Move to `until` (s), or to the instant at which the threshold is passed for the first time."""
        unfelt = self.command.detection_time is None
        stalled = 0
        while self.t < until and unfelt == (self.command.detection_time is None):
            before = self.t
            if self.chain.linear and not self.touching:
                self.t, z, met = flight.fly(self.chain, self.t, self.state, until)
                self._fly(z)
                if met:
                    self._touch()
            else:
                self._phase(until)
            stalled = stalled + 1 if self.t == before else 0
            if stalled > 16:
                raise RuntimeError(f"reference: switches without end at {self.t:.9g} s")

    def over(self) -> bool:
        """Whether nothing touches, and nothing will: the energy behind the tool cannot take it to the object's speed.

        Behind a flange that stands still it only falls.
        """
        if self.touching or not self.command.rests(self.t):
            return False
        chain, law = self.chain, self.chain.bistable
        _, _, u, u_dot, w, w_dot = self.state.tolist()
        m_r, k_r, _ = (0.0, 0.0, 0.0) if chain.robot is None else chain.robot(self.command.at(self.t)[0])
        m_t = chain.m_t + m_r if chain.rigid else chain.m_t
        energy = chain.m_t * (u_dot + w_dot) ** 2 / 2 + m_r * w_dot**2 / 2 + k_r * w**2 / 2 + chain.k_t * u**2 / 2
        if law is not None:
            energy += self._stored(u)
            barrier = law.k / 2 * (law.L0 - law.H) ** 2
            here = self._rest(law.position(u) > 0)
            energy -= self._stored(here) if energy < barrier else min(map(self._stored, map(self._rest, (True, False))))
        return self.object_velocity >= sqrt(2 * max(energy, 0.0) / m_t)

    def _stored(self, u: float) -> float:
        """Energy of the mechanism and its stops at deflection u, J."""
        law = self.chain.bistable
        assert law is not None
        spring = law.k / 2 * (hypot(law.H, law.position(u)) - law.L0) ** 2
        return spring + law.k_s / 2 * (max(law.p_front - u, 0.0) ** 2 + max(law.p_rear + u, 0.0) ** 2)

    def _rest(self, front: bool) -> float:
        """Deflection at which a stop holds the mechanism, m."""
        law = self.chain.bistable
        assert law is not None
        if front:
            return 0.0
        return float(
            brentq(lambda u: law.spring(law.position(u)) + law.k_s * (law.p_rear + u), -law.p_rear, 1 - law.p_rear)
        )

    def _fly(self, z: Vector) -> None:
        """Go on without contact."""
        self._system = Equations(self.chain, UNITS, False)
        self._y = np.append(z, [0.0, 0.0])

    def _touch(self) -> None:
        """Begin a contact."""
        z = self.state
        v_in = max(float(z[1]), V_FLOOR)
        scales = self.chain.contact_scales(self.t, v_in)
        self._system = Equations(self.chain, scales, True)
        self._y = np.append(z / np.tile([scales.length, scales.length / scales.time], 3), [0.0, 0.0])
        self._stiff = False
        self.contacts += 1
        self.first_contact = min(self.first_contact, self.t)

    def _phase(self, until: float) -> None:
        """Move to `until` or to the first switch that turns."""
        system, a, cut = self._system, *self.command.at(self.t)[2:]
        t_stop = min(cut, until)
        system.enter(self.t, a)
        before = system.force(self._y)
        tau, self._y, switch = self._integrate((t_stop - self.t) / system.scales.time)
        # between two switches the force is monotonic
        self.peak_force = max(self.peak_force, system.scales.force * max(before, system.force(self._y)))
        self.t = t_stop if switch is None else self.t + tau * system.scales.time
        if switch is None:
            return
        if switch.name == "touching":
            self._y[0] = 0.0
            if not self.touching:
                self._touch()
                return
            self._impulse = self.object_velocity * self.chain.m_p
            self._fly(self.state)
            return
        if switch.name == "alarm":
            self.command.detect(self.t)
        system.toggle(switch.name)

    def _integrate(self, end: float) -> tuple[float, Vector, Switch | None]:
        """Integrate the equations up to `end` or to a switch, in their scales; a stiff contact implicitly."""
        if not self.touching:
            return self._by("DOP853", end, FLIGHT_RTOL, self._flight_atol)
        if not self._stiff:
            self._system.left = PATIENCE
            try:
                return self._by("DOP853", end, self.rtol, np.full(8, self.rtol / 100))
            except StiffError:
                self._stiff, self._system.left = True, inf
        rtol = max(self.rtol, STIFF_RTOL)
        return self._by("Radau", end, rtol, np.full(8, rtol / 100))

    def _by(self, method: str, end: float, rtol: float, atol: Vector) -> tuple[float, Vector, Switch | None]:
        longest_step = (1 if self.touching else 2) * self._longest_step / self._system.scales.time
        switches = self._system.switches()
        return advance(self._system, end, self._y, switches, method, rtol, atol, longest_step)[:3]
