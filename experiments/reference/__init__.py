"""The slow, obvious, independent solver that the fast one is checked against.

Shares no code with `impact_gym`: it reads the attributes of a scene and of a motion, no more. The motion is cut into
phases with smooth equations at every event: touch and separation, the contact force clamped at zero or released,
passing the brake's threshold or at its peak, a stop that pushes or lets go, the slider at its alignment, a change of
the commanded acceleration, a node of a table of robot parameters.

    `laws`         dissipation of a contact, bistable mechanism, robot's table
    `command`      imposed motion of the robot, planned or steered
    `chain`        forces and accelerations, in units that a contact chooses
    `integration`  one phase by SciPy's integrators, cut at the first event; linear flight by the matrix exponential
    `motion`       a chain under way from one event to the next
    `task`         the environment's whole episode, with a controller that is asked

A contact runs in its own scales,

    tau = t/t0,  lengths in delta0,  forces in F0,
    delta0 = (M v_in^2/k_c)^(1/(m+1)),  t0 = delta0/v_in,  F0 = k_c delta0^m = M v_in/t0,

and flight in SI units.
"""

from dataclasses import dataclass, field
from typing import Any

from experiments.reference.chain import Chain
from experiments.reference.integration import SOLVERS
from experiments.reference.motion import ContactRecord, Motion

STIFF_RATES = 1e5  # -, decay rate of a stop times duration, beyond which flight is left to an implicit method


@dataclass(frozen=True)
class Reference:
    """State at the end of the run (m/s, m) and what happened on the way."""

    object_velocity: float
    peak_object_velocity: float
    tool_velocity: float
    flange_velocity: float  # of the imposed motion, or of the robot's mass where it has one
    peak_force: float  # N
    detection_time: float | None  # s; None: the force never exceeded the brake's threshold
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, of the coupling on the tool over the contacts (paper, eq. 21)
    snap_through: tuple[float, ...]  # s, the slider passes its alignment
    object_position: float  # its face; 0 is where the tool's face is at the start
    tool_position: float
    flange_position: float  # from its start
    stop_hits: int  # how often a stop begins to push
    contact_seconds: float = field(compare=False)  # of processor time, spent in the contacts


def simulate(scene: Any, motion: Any, duration: float, rtol: float = 1e-11, method: str = "DOP853") -> Reference:
    """Run `scene` under `motion` for `duration` seconds.

    `method`, any of solve_ivp's, and `rtol` are about the contacts only: flight is exact or near rounding.

    Raises:
        ValueError: there is no such method, or no such law of dissipation.
        NotImplementedError: the coupling is of no known kind.
        RuntimeError: SciPy gives up, or something turns back and forth without end.
    """
    if method not in SOLVERS:
        raise ValueError(f"method must be one of {list(SOLVERS)}, got {method!r}")
    run = Motion(Chain(scene, motion), scene.object.distance, rtol, method)
    if run.chain.stop_decay * duration > STIFF_RATES:
        run.flight_method, run.fastest = "Radau", run.chain.slow_rate
    while run.t < duration:
        run.advance(duration)
    if run.touching:
        run.note_contact(None)
    delta, _, u, u_dot, w, w_dot = run.state.tolist()
    x_r, v_r, _, _ = run.command.at(duration)
    return Reference(
        object_velocity=run.object_velocity if run.chain.friction else run.past_impulse / run.chain.m_p,
        peak_object_velocity=run.top_speed,
        tool_velocity=v_r - w_dot - u_dot,
        flange_velocity=v_r - w_dot,
        peak_force=run.peak_force,
        detection_time=run.command.detection_time,
        contacts=tuple(run.records),
        coupling_impulse=run.coupling_impulse,
        snap_through=tuple(run.snap_through),
        object_position=x_r - w - u - delta,
        tool_position=x_r - w - u,
        flange_position=x_r - w,
        stop_hits=run.stop_hits,
        contact_seconds=run.contact_seconds,
    )
