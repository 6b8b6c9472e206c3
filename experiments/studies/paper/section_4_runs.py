"""Section 4, the tool behind spring and damper: Fig. 17, 19 and 20, runs at k_t = 150 N/m, zeta = 1."""

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab.scenes import MOTION, decoupled
from experiments.studies.paper.layouts import Reproduction, impulses, velocities_and_forces
from experiments.studies.paper.runs import Numbers, Run, histories, identity_error, runs_of

RESTITUTION = 0.1  # of Fig. 19 and 20
INELASTIC = {"a": decoupled(1e5, RESTITUTION, 150.0), "b": decoupled(1e3, RESTITUTION, 150.0)}  # Fig. 19 and 20


def figure_17() -> pl.DataFrame:
    """Simulate both."""
    return histories({"a": decoupled(1e5, 1.0, 150.0), "b": decoupled(1e4, 1.0, 150.0)})


def _peaks(force: np.ndarray) -> int:
    """Return the number of peaks that are higher than a tenth of the highest."""
    inner = force[1:-1]
    return int(np.sum((inner > force[:-2]) & (inner >= force[2:]) & (inner > 0.1 * force.max())))


def _numbers_17(frame: pl.DataFrame) -> Numbers:
    runs = a, b = runs_of(frame)
    before = a.part(np.cumsum(a.contact) == 0)
    stretch = 1e3 * (before.tool_position - before.flange_position)
    ahead = (before.tool_velocity - before.flange_velocity)[before.time > MOTION.speed / MOTION.acceleration]
    touching = [run.first_contact for run in runs]
    compressions = [1e3 * (contact.flange_position - contact.tool_position) for contact in touching]
    return {
        "a": a, "b": b, "peaks": [_peaks(run.trace.contact_force) for run in runs],
        "lag": -stretch.min(), "ahead_most": stretch.max(),
        "faster_share": 100 * np.mean(ahead > 0.0),  # the trace has a point a millisecond in flight
        "faster_most": ahead.max(), "faster_last": ahead[-1],
        "compressions": [values.max() for values in compressions],
        "reached": [  # when the contact of (a) ends
            np.interp(a.duration, 1e3 * (contact.time - contact.time[0]), values)
            for contact, values in zip(touching, compressions, strict=True)
        ],
        "restitution_error": max(abs(run.restitution - 1.0) for run in runs),
    }  # fmt: skip


def figure_19() -> pl.DataFrame:
    """Simulate both, and both with e = 1."""
    return histories(INELASTIC | {"a, e = 1": decoupled(1e5, 1.0, 150.0), "b, e = 1": decoupled(1e3, 1.0, 150.0)})


def _share_before_the_brake(run: Run) -> float:
    """Return how many per cent of V_p the object has when the robot begins to brake."""
    trace = run.trace
    begin = trace.time[np.argmax((trace.flange_velocity < MOTION.speed) & (run.contact > 0))]
    return float(100 * np.interp(begin, trace.time, trace.object_velocity)) / run.final_velocity


def _coupling(touching: ig.Trace) -> Numbers:
    """Return numbers of the coupling during a contact, and words about it.

    What is said from where the tool has fallen behind the flange begins there; in the first moments it runs ahead.
    """
    behind = int(np.argmax(touching.tool_velocity < touching.flange_velocity))
    stretch = np.max(touching.tool_position - touching.flange_position)
    gain, time = touching.tool_velocity[behind:] - touching.flange_velocity[behind:], touching.time
    slower = "throughout"
    if (gain >= 0.0).any():
        until = time[behind + np.argmax(gain >= 0.0)] - time[0]
        slower = f"for the first {1e3 * until:.0f} of {1e3 * np.ptp(time):.0f} ms"
    return {
        "push": touching.coupling_force[behind:].min(), "gain": gain.max(), "slower": slower,
        "stretch": stretch, "compressed": "always" if stretch < 0.0 else "not always",
    }  # fmt: skip


def _numbers_19(frame: pl.DataFrame) -> Numbers:
    runs = a, b = runs_of(frame)
    return {
        "a": a, "b": b, "elastic": [Run(frame, f"{case}, e = 1") for case in "ab"],
        "shares": [_share_before_the_brake(run) for run in runs],
        "parting": [run.during_contact.flange_velocity[-1] for run in runs],
        "restitutions_felt": [
            (run.felt_contact.object_velocity[-1] - run.felt_contact.tool_velocity[-1]) / run.impact_velocity
            for run in runs
        ],
        "contact": [_coupling(run.first_contact) for run in runs],
        "felt": [_coupling(run.felt_contact) for run in runs],
    }  # fmt: skip


def figure_20() -> pl.DataFrame:
    """Simulate both cases of Fig. 19."""
    return histories(INELASTIC)


def _numbers_20(frame: pl.DataFrame) -> Numbers:
    runs = a, b = runs_of(frame)
    felt = [run.felt_contact for run in runs]
    impulses_felt = [float(np.trapezoid(contact.coupling_force, contact.time)) for contact in felt]
    nominal = np.array([run.equation_22(RESTITUTION) for run in runs])
    nominal_felt = np.array([run.equation_22(RESTITUTION, J) for run, J in zip(runs, impulses_felt, strict=True)])
    velocities_felt = np.array([contact.object_velocity[-1] for contact in felt])
    return {
        "a": a, "b": b, "same_order": (a.impulse - b.impulse) * (a.final_velocity - b.final_velocity),
        "identity": identity_error(a, b),
        "drawn_error": max(abs(run.running_impulse()[1][-1] / run.impulse - 1.0) for run in runs),
        "nominal": nominal, "nominal_error": np.abs(nominal / [run.final_velocity for run in runs] - 1.0),
        "velocities_felt": velocities_felt,
        "nominal_felt": nominal_felt, "nominal_error_felt": np.abs(nominal_felt / velocities_felt - 1.0),
    }  # fmt: skip


FIGURES = {
    "figure_17": Reproduction(figure_17, velocities_and_forces, _numbers_17),
    "figure_19": Reproduction(figure_19, velocities_and_forces, _numbers_19),
    "figure_20": Reproduction(figure_20, impulses, _numbers_20),
}
