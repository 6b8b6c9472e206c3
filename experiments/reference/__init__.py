"""The slow and simple independent solver, with which tests and studies compare the solver of `impact_gym`.

It imports nothing from `impact_gym`, and reads the attributes of scene and motion. Events divide a motion into phases
with smooth equations, see `chain.Chain.switches`. All numbers are SI. The tolerances of a contact are relative to

    length: delta0 = (M v_in^2/k_c)^(1/(m+1)),    time: t0 = delta0/v_in,    force: F0 = k_c delta0^m = M v_in/t0,

with the approach velocity v_in, the stiffness k_c and exponent m of the contact, and the reduced mass M of object and
tool. With a rigid coupling, the tool's mass in M includes the robot's; without a robot, it is infinite.
"""

from dataclasses import dataclass, field
from typing import Any

from experiments.reference.chain import Chain
from experiments.reference.integration import SOLVERS
from experiments.reference.motion import ContactRecord, Motion

STIFF_RATES = 1e5  # limit of `Chain.stop_decay` (1/s) * duration (s); above this limit, flight needs an implicit method


@dataclass(frozen=True)
class Reference:
    """Result of a run: the state at its end (m/s, m), largest values, and events."""

    object_velocity: float
    peak_object_velocity: float
    tool_velocity: float
    flange_velocity: float
    peak_force: float  # N
    detection_time: float | None  # s; None: no brake, or its threshold was never exceeded
    contacts: tuple[ContactRecord, ...]
    coupling_impulse: float  # N s, impulse of the coupling on the tool during the contacts (paper, eq. 21)
    snap_through: tuple[float, ...]  # s, times when a mechanism's spring is perpendicular to the slider's path
    object_position: float  # position of the object's face; 0 is the position of the tool's face at the start
    tool_position: float  # position of the tool's face
    flange_position: float  # 0 at the start
    stop_hits: int  # number of times that a stop of the coupling began to push
    contact_seconds: float = field(compare=False)  # s, processor time of all contacts


def simulate(scene: Any, motion: Any, duration: float, rtol: float = 1e-11, method: str = "DOP853") -> Reference:
    """Simulate `scene` under `motion` for `duration` seconds.

    `method`, a name for SciPy's `solve_ivp`, and `rtol` are used only in contacts. Flight of a linear chain has a
    closed form; other flight is integrated at rtol 1e-12. ValueError: method or law of dissipation is unknown.
    NotImplementedError: the coupling is unknown. RuntimeError: SciPy fails, or events repeat without end at one time.
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
    delta, _, u, u_dot, w, w_dot = run.state[:6].tolist()
    x_r, v_r, _, _ = run.command.at(duration)
    return Reference(
        object_velocity=run.object_velocity,
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
