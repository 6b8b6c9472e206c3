"""The motion of object, tool and flange, integrated from event to event."""

from dataclasses import dataclass
from math import inf
from time import thread_time

import numpy as np

from experiments.reference.chain import Chain
from experiments.reference.integration import Switch, Vector, advance, fly

FLIGHT_RTOL, FLIGHT_ATOL = 1e-12, 1e-16  # -, m: relative and absolute tolerance in flights without a closed form
MOST_STALLED = 16  # largest number of successive phases without duration


@dataclass(frozen=True)
class ContactRecord:
    """One contact (times in s, velocities in m/s). If it is unfinished, `end` and `separation_velocity` are None."""

    start: float
    end: float | None
    approach_velocity: float  # velocity of the tool minus that of the object, at the start
    separation_velocity: float | None  # velocity of the object minus that of the tool, at the end
    peak_force: float  # N
    impulse: float  # N s, impulse of the contact force on the object
    object_velocity: float  # velocity of the object at the end of the contact, or of the motion if unfinished


class Motion:
    """A motion that starts at rest, `distance` (m) before the object. `method` integrates contacts at `rtol`.

    Scales and damping of a contact are computed with an approach velocity of at least `floor` (m/s). A step lasts at
    most 1 / `fastest`.
    """

    flight_method = "DOP853"

    def __init__(
        self, chain: Chain, distance: float, rtol: float, method: str = "DOP853", *, floor: float = 1e-6
    ) -> None:
        self.chain, self.command, self.rtol, self.method = chain, chain.command, rtol, method
        self.floor = floor
        self.t = 0.0  # s
        self.peak_force = self._peak = 0.0  # N, largest force of all contacts, and of the current or last one
        self.unread_force = 0.0  # N, largest force since the last reading of the sensor
        self.records: list[ContactRecord] = []
        self.past_impulse = 0.0  # N s, impulse of the contact force on the object, in past contacts
        self.coupling_impulse = 0.0  # N s, impulse of the coupling on the tool, in past contacts
        self.snap_through: list[float] = []  # s, times at which the slider of a bistable coupling passed its alignment
        self.onsets: list[tuple[float, float]] = []  # start (s) and approach velocity (m/s) of each contact begun
        self.contact_seconds = 0.0  # s, processor time spent on contacts
        self.top_speed = 0.0  # m/s, largest velocity of the object
        self.stop_hits = 0
        self.fastest = max(chain.slow_rate, chain.stop_rate)  # 1/s, limits the steps, see the docstring of the class
        # at a stop, rounding of the position causes an error of the velocity; the tolerance must be above this error
        self.flight_atol = FLIGHT_ATOL * np.tile([1.0, max(1.0, chain.stop_rate)], 4)
        self.state = np.array([-distance] + [0.0] * 7)  # y of `experiments.reference.chain`, SI

    @property
    def touching(self) -> bool:
        """Whether a contact is under way."""
        return self.chain.scales is not None

    @property
    def force(self) -> float:
        """Contact force, N."""
        return self.chain.force(self.state)

    @property
    def object_velocity(self) -> float:
        """Velocity of the object, m/s."""
        if self.chain.friction:
            relative = float(self.state[[1, 3, 5]].sum())
            return self.command.at(self.t)[1] - relative if self.chain.on["sliding"] else 0.0
        return float(self.past_impulse + self.state[6]) / self.chain.m_p

    def advance(self, until: float) -> None:
        """Advance to `until` (s), or to the time at which the contact force first exceeds the threshold."""
        unfelt = self.command.detection_time is None
        stalled = 0
        while self.t < until and unfelt == (self.command.detection_time is None):
            before, began = self.t, thread_time() if self.touching else None
            self._advance_phase(until)
            self.contact_seconds += 0.0 if began is None else thread_time() - began
            stalled = stalled + 1 if self.t == before else 0
            if stalled > MOST_STALLED:
                raise RuntimeError(f"reference: events repeat without end at t = {self.t:.9g} s")

    def note_contact(self, end: float | None) -> None:
        """Record the current contact, which ends at `end` (s), or is unfinished (None)."""
        v_out = None if end is None else -float(self.state[1])
        impulse, coupling_impulse = self.state[6:].tolist()
        self.state[6:] = 0.0
        self.past_impulse += impulse
        self.coupling_impulse += coupling_impulse
        start, v_in = self.onsets[-1]
        self.records.append(ContactRecord(start, end, v_in, v_out, self._peak, impulse, self.object_velocity))

    def _advance_phase(self, until: float) -> None:
        t_stop = min(self.chain.enter(self.t), until)
        if self.chain.linear and not self.touching:
            self.t, z, met = fly(self.chain.matrix(), np.append(self.state[:6], 1.0), self.t, t_stop)
            self.state[:6] = z[:6]
            if met:
                self._turn("touching")
            return
        before = self.force
        tau, self.state, switch = self._integrate(t_stop - self.t)
        self.t = t_stop if switch is None else self.t + tau
        if self.touching:  # in a phase the force only rises or only falls
            self._peak = max(self._peak, before, self.force)
            self.peak_force = max(self.peak_force, self._peak)
            self.unread_force = max(self.unread_force, before, self.force)
        if switch is not None:
            self._turn(switch.name)
        self.top_speed = max(self.top_speed, self.object_velocity)

    def _turn(self, name: str) -> None:
        if name == "touching":
            if self.touching:
                self.note_contact(self.t)
                self.chain.begin(self.t, None)
            else:
                self.onsets.append((self.t, float(self.state[1])))
                self._peak = 0.0
                self.chain.begin(self.t, max(self.onsets[-1][1], self.floor))
            self.state[[0, 6, 7]] = 0.0
            return
        on = self.chain.on
        if name == "sliding" and on[name]:
            self.state[1] += self.object_velocity  # object at rest
        if name in on:
            on[name] = not on[name]
            self.stop_hits += name in ("front", "rear") and on[name]
        if name == "alarm":
            self.command.detect(self.t)
        elif name == "alignment":
            self.snap_through.append(self.t)
        elif name == "pressed":
            on["loading"] = True
        elif name == "sliding":
            on["gaining"] = True

    def _integrate(self, end: float) -> tuple[float, Vector, Switch | None]:
        chain, options = self.chain, (self.flight_method, FLIGHT_RTOL, self.flight_atol)
        if chain.scales is not None:
            options = self.method, self.rtol, self.rtol / 100 * chain.scales.state
        longest_step = 1 / self.fastest if self.fastest else inf
        return advance(chain, end, self.state, chain.switches(), *options, longest_step)
