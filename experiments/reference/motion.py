"""A chain under way, moved from one instant that matters to the next, and what it came to so far."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from experiments.reference import flight
from experiments.reference.chain import UNITS, Chain, Scales, System
from experiments.reference.phases import Switch, Vector, advance

FLIGHT_RTOL, FLIGHT_ATOL = 1e-12, 1e-16  # of the chains that are not flown exactly; -, m
PATIENCE = 16  # phases without a step of time: then something turns back and forth for ever


@dataclass(frozen=True)
class ContactRecord:
    """One contact. Times in s, velocities in m/s; `end`, `separation_velocity` are None if unfinished."""

    start: float
    end: float | None
    approach_velocity: float  # v_t - v_p at the start
    separation_velocity: float | None  # v_p - v_t at the end
    peak_force: float  # N
    impulse: float  # N s, given to the object
    object_velocity: float  # at the end


class Motion:
    """Starts at rest with the object `distance` (m) ahead; its contacts are integrated by `method` to `rtol`."""

    method = "DOP853"  # of contacts, any of solve_ivp's
    flight_method = "DOP853"
    flight_stride = 1  # longest step of flight in sixths of a period; in a contact it is one
    floor = 1e-6  # m/s, of v_in in the scales and the damping of a contact

    def __init__(self, chain: Chain, distance: float, rtol: float) -> None:
        self.chain, self.command, self.rtol = chain, chain.command, rtol
        self.t = 0.0  # s
        self.peak_force = 0.0  # N
        self.unread_force = 0.0  # N, largest since the sensor was last read
        self.records: list[ContactRecord] = []  # of the contacts that are over
        self.past_impulse = self.coupling_impulse = 0.0  # N s, over these: on the object; of the coupling on the tool
        self.snap_through: list[float] = []  # s
        self.fastest = max(chain.slow_rate, chain.stop_rate)  # 1/s
        # a stop turns the rounding of a position into a velocity, which no tolerance must ask for
        self.flight_atol = FLIGHT_ATOL * np.tile([1.0, max(1.0, chain.stop_rate)], 4)
        self._go_on(UNITS, np.array([-distance, 0.0, 0.0, 0.0, 0.0, 0.0]), touching=False)

    @property
    def state(self) -> Vector:
        """Penetration, deflections of coupling and robot, each with its rate; SI."""
        return self._y[:6] * self._system.scales.state

    @property
    def touching(self) -> bool:
        """Whether a contact is under way."""
        return self._system.touching

    @property
    def force(self) -> float:
        """Contact force, N."""
        return self._system.force(self._y) * self._system.scales.force

    @property
    def impulse(self) -> float:
        """Given to the object so far, N s."""
        return self.past_impulse + self._system.scales.impulse * float(self._y[6])

    @property
    def object_velocity(self) -> float:
        """Of the impulse it was given, m/s."""
        return self.impulse / self.chain.m_p

    def advance(self, until: float) -> None:
        """Move to `until` (s), or to the instant at which the threshold is passed for the first time."""
        unfelt = self.command.detection_time is None
        stalled = 0
        while self.t < until and unfelt == (self.command.detection_time is None):
            before = self.t
            if self.chain.linear and not self.touching:
                self.t, z, met = flight.fly(self.chain, self.t, self.state, until)
                self._go_on(UNITS, z, touching=False)
                if met:
                    self._touch()
            else:
                self.move(self.t, until, self.touching)
            stalled = stalled + 1 if self.t == before else 0
            if stalled > PATIENCE:
                raise RuntimeError(f"reference: switches without end at {self.t:.9g} s")

    def note_contact(self, end: float | None) -> None:
        """Add the contact that ends here, or is unfinished, to the records."""
        v_out = None if end is None else -float(self.state[1])
        impulse, coupling_impulse = (self._system.scales.impulse * self._y[6:]).tolist()
        self.past_impulse += impulse
        self.coupling_impulse += coupling_impulse
        start, v_in = self._onset
        self.records.append(
            ContactRecord(start, end, v_in, v_out, self._peak, impulse, self.past_impulse / self.chain.m_p)
        )

    def _go_on(self, scales: Scales, z: Vector, touching: bool) -> None:
        """Begin a flight or a contact in its scales, from the state z (SI)."""
        self._system = System(self.chain, scales, touching)
        self._y = np.append(z / scales.state, [0.0, 0.0])

    def _touch(self) -> None:
        """Begin a contact."""
        z = self.state
        self._onset, self._peak = (self.t, float(z[1])), 0.0
        self._go_on(self.chain.contact_scales(self.t, max(float(z[1]), self.floor)), z, touching=True)

    def move(self, t: float, until: float, touching: bool) -> None:
        """Integrate from t to `until` or to the first switch that turns, all of it in a contact or in flight."""
        system, a, cut = self._system, *self.command.at(t)[2:]
        t_stop = min(cut, until)
        system.enter(t, a)
        before = self.force
        tau, self._y, switch = self._integrate((t_stop - t) / system.scales.time)
        self.t = t_stop if switch is None else t + tau * system.scales.time
        if touching:  # between two switches the force is monotonic
            self._peak = max(self._peak, before, self.force)
            self.peak_force = max(self.peak_force, self._peak)
            self.unread_force = max(self.unread_force, before, self.force)
        if switch is not None:
            self._turn(switch)

    def _turn(self, switch: Switch) -> None:
        """Go on behind a switch."""
        if switch.name == "touching":
            self._y[0] = 0.0
            if not self.touching:
                self._touch()
                return
            self.note_contact(self.t)
            self._go_on(UNITS, self.state, touching=False)
            return
        if switch.name == "alarm":
            self.command.detect(self.t)
        elif switch.name == "alignment":
            self.snap_through.append(self.t)
        self._system.toggle(switch.name)

    def _integrate(self, end: float) -> tuple[float, Vector, Switch | None]:
        """Integrate the equations up to `end` or to a switch, in their scales."""
        if self.touching:
            return self._by(self.method, end, self.rtol, np.full(8, self.rtol / 100))
        return self._by(self.flight_method, end, FLIGHT_RTOL, self.flight_atol)

    def _by(self, method: str, end: float, rtol: float, atol: Vector) -> tuple[float, Vector, Switch | None]:
        stride = (1 if self.touching else self.flight_stride) / self.fastest if self.fastest else inf  # s
        switches, longest_step = self._system.switches(), stride / self._system.scales.time
        return advance(self._system, end, self._y, switches, method, rtol, atol, longest_step)
