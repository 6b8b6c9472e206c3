"""The slow, obvious, independent solver that the fast one is checked against.

Shares no code with `impact_gym`: it reads the attributes of a scene and of a motion, no more. The motion is cut into
phases with smooth equations at every event: touch and separation, the contact force clamped at zero or released,
passing the brake's threshold or at its peak, a stop that pushes or lets go, the slider at its alignment, a change of
the commanded acceleration, a node of a table of robot parameters.

    `command`      imposed motion of the robot
    `dissipation`  damping factor of the contact from its restitution
    `chain`        forces and accelerations, in units that a contact chooses
    `phases`       one phase by SciPy's integrators, cut at the first event
    `flight`       linear chains between contacts, exactly, by the matrix exponential
    `commanded`    a chain whose flange is told on the way what to do
    `task`         the environment's whole episode, with a controller that is asked

A contact runs in its own scales,

    tau = t/t0,  lengths in delta0,  forces in F0,
    delta0 = (M v_in^2/k_c)^(1/(m+1)),  t0 = delta0/v_in,  F0 = k_c delta0^m = M v_in/t0,

and flight in SI units.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from experiments.reference import flight
from experiments.reference.chain import Chain, Scales, System
from experiments.reference.phases import SOLVERS, Switch, Vector, advance

V_FLOOR = 1e-6  # m/s, of v_in in the scales and the damping of a contact
FLIGHT_RTOL, FLIGHT_ATOL = 1e-12, 1e-16  # of the chains that are not flown exactly; -, m
STIFF_RATES = 1e5  # -, decay rate of a stop times duration, beyond which flight is left to an implicit method


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


@dataclass(frozen=True)
class Reference:
    """State at the end of the run (m/s, m) and what happened on the way."""

    object_velocity: float
    tool_velocity: float
    flange_velocity: float  # of the imposed motion, or of the robot's mass where it has one
    peak_force: float  # N
    detection_time: float | None  # s; None: the force never exceeded the brake's threshold
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, of the coupling on the tool over the contacts (paper, eq. 21)
    evaluations: int  # of the right-hand side, by the integrators
    snap_through: tuple[float, ...]  # s, the slider passes its alignment
    object_position: float  # its face; 0 is where the tool's face is at the start
    tool_position: float
    flange_position: float  # from its start


def simulate(
    scene: Any,
    motion: Any,
    duration: float,
    rtol: float = 1e-11,
    method: str = "DOP853",
) -> Reference:
    """Run `scene` under `motion` for `duration` seconds.

    `method`, any of solve_ivp's, and `rtol` are about the contacts only: flight is exact or near rounding.
    """
    if method not in SOLVERS:
        raise ValueError(f"method must be one of {list(SOLVERS)}, got {method!r}")
    run = _Run(Chain(scene, motion), rtol, method, duration)
    t, z = 0.0, np.array([-scene.object.distance, 0.0, 0.0, 0.0, 0.0, 0.0])
    while t < duration:
        if run.chain.linear:
            t, z, touching = flight.fly(run.chain, t, z, duration)
        else:
            t, z, touching = run.move(t, z, touching=False)
        if touching:
            t, z, _ = run.move(t, z, touching=True)
    delta, _, u, u_dot, w, w_dot = z.tolist()
    x_r, v_r, _, _ = run.chain.command.at(duration)
    return Reference(
        object_velocity=run.impulse / run.chain.m_p,
        tool_velocity=v_r - w_dot - u_dot,
        flange_velocity=v_r - w_dot,
        peak_force=max((c.peak_force for c in run.contacts), default=0.0),
        detection_time=run.chain.command.detection_time,
        contacts=tuple(run.contacts),
        coupling_impulse=run.coupling_impulse,
        evaluations=run.evaluations,
        snap_through=tuple(run.snap_through),
        object_position=x_r - w - u - delta,
        tool_position=x_r - w - u,
        flange_position=x_r - w,
    )


class _Run:
    """What a run has added up to so far, and how it is integrated."""

    def __init__(self, chain: Chain, rtol: float, method: str, duration: float) -> None:
        self.chain, self.rtol, self.method, self.duration = chain, rtol, method, duration
        self.contacts: list[ContactRecord] = []
        self.impulse = self.coupling_impulse = 0.0  # N s, on the object; of the coupling on the tool
        self.snap_through: list[float] = []
        self.evaluations = 0
        stiff = chain.stop_decay * duration > STIFF_RATES
        self.flight_method = "Radau" if stiff else "DOP853"
        fastest = chain.slow_rate if stiff else max(chain.slow_rate, chain.stop_rate)
        # a stop turns the rounding of a position into a velocity, which no tolerance must ask for
        self.flight_atol = FLIGHT_ATOL * np.tile([1.0, max(1.0, chain.stop_rate)], 4)
        self.longest_step = 1 / fastest if fastest else inf  # s, a sixth of a period

    def move(self, t: float, z: Vector, touching: bool) -> tuple[float, Vector, bool]:
        """From t to the end of this flight or contact, or of the run: z = (delta, u, w and their rates), SI."""
        chain, command, t_in, v_in = self.chain, self.chain.command, t, float(z[1])
        scales = chain.contact_scales(t, max(v_in, V_FLOOR)) if touching else Scales(1.0, 1.0, 1.0)
        system = System(chain, scales, touching)
        rtol, atol, method = FLIGHT_RTOL, self.flight_atol, self.flight_method
        if touching:
            rtol, atol, method = self.rtol, np.full(8, self.rtol / 100), self.method
        y = np.append(z / np.tile([scales.length, scales.length / scales.time], 3), [0.0, 0.0])
        peak, here, stalled = 0.0, touching, 0
        while here is touching and t < self.duration:
            a, t_change = command.at(t)[2:]
            t_stop = min(t_change, self.duration)
            system.enter(t, a)
            switches = system.switches()
            tau, y_next, switch, nfev = advance(
                system, (t_stop - t) / scales.time, y, switches, method, rtol, atol, self.longest_step / scales.time
            )
            self.evaluations += nfev
            peak = max(peak, system.force(y), system.force(y_next))  # between two switches the force is monotonic
            stalled = stalled + 1 if switch and tau == 0 else 0
            if stalled > len(switches) + 8:
                raise RuntimeError(f"reference: {switch} switches without end at {t:.9g} s")
            t, y = (t + tau * scales.time, y_next) if switch else (t_stop, y_next)
            here = self._toggle(switch, system, t, y, here)
        if touching:
            impulse = scales.impulse * float(y[6])
            self.impulse += impulse
            self.coupling_impulse += scales.impulse * float(y[7])
            end, v_out = (None, None) if here else (t, -float(y[1]) * scales.length / scales.time)
            peak *= scales.force
            self.contacts.append(ContactRecord(t_in, end, v_in, v_out, peak, impulse, self.impulse / chain.m_p))
        return t, y[:6] * np.tile([scales.length, scales.length / scales.time], 3), here

    def _toggle(self, switch: Switch | None, system: System, t: float, y: Vector, here: bool) -> bool:
        """Note what happened at t; return whether the faces touch."""
        if switch is None:
            return here
        if switch.name == "touching":
            y[0] = 0.0
            return not here
        if switch.name == "alarm":
            self.chain.command.detect(t)
        elif switch.name == "alignment":
            self.snap_through.append(t)
        system.toggle(switch.name)
        return here
