"""Section 4, the tool behind spring and damper: Fig. 17, 19 and 20, runs at k_t = 150 N/m, zeta = 1."""

from collections.abc import Iterable
from functools import partial

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab.scenes import MOTION, decoupled
from experiments.studies.paper.layouts import Reproduction, impulses, velocities_and_forces
from experiments.studies.paper.runs import Numbers, Run, histories

ELASTIC = {"a": decoupled(1e5, 1.0, 150.0), "b": decoupled(1e4, 1.0, 150.0)}  # Fig. 17
ELASTIC_TITLES = {"a": "(a, c) k_c = $10^5$ N/m$^{1.5}$", "b": "(b, d) k_c = $10^4$ N/m$^{1.5}$"}
WINDOW = (0.25, 0.75)  # s, that is drawn
RESTITUTION = 0.1  # of Fig. 19 and 20
INELASTIC = {"a": decoupled(1e5, RESTITUTION, 150.0), "b": decoupled(1e3, RESTITUTION, 150.0)}  # Fig. 19 and 20
INELASTIC_TITLES = {"a": "(a, c) k_c = $10^5$ N/m$^{1.5}$", "b": "(b, d) k_c = $10^3$ N/m$^{1.5}$"}
IMPULSES = {"a": "k_c = $10^5$ N/m$^{1.5}$", "b": "k_c = $10^3$ N/m$^{1.5}$"}


def figure_17() -> pl.DataFrame:
    """Simulate both."""
    return histories(ELASTIC)


def _numbers_17(frame: pl.DataFrame) -> Numbers:
    a, b = (Run(frame, case) for case in "ab")
    before = a.before_contact
    stretch = before.tool_position - before.flange_position
    ahead = (before.tool_velocity - before.flange_velocity)[before.time > MOTION.speed / MOTION.acceleration]
    compressions = [1e3 * (run.first_contact.flange_position - run.first_contact.tool_position) for run in (a, b)]
    times = [run.first_contact.time - run.first_contact.time[0] for run in (a, b)]
    reached = [np.interp(a.duration_of_contact, *points) for points in zip(times, compressions, strict=True)]
    numbers: Numbers = {
        "compression": -1e3 * stretch.min(),
        "ahead_most": 1e3 * stretch.max(),
        "faster_share": 100 * np.mean(ahead > 0.0),  # the trace has a point a millisecond in flight
        "faster_most": ahead.max(),
        "faster_last": ahead[-1],
        "duration_a": 1e3 * a.duration_of_contact,
        "restitution_error": max(abs(run.restitution - 1.0) for run in (a, b)),
    }
    for case, run, compression, after in zip("ab", (a, b), compressions, reached, strict=True):
        own = {
            "peaks": run.force_peaks, "contacts": run.contacts, "deceleration": run.deceleration,
            "force": run.trace.contact_force.max(), "compression": compression.max(), "reached": after,
            "velocity": run.final_velocity, "restitution": run.restitution,
        }  # fmt: skip
        numbers |= {f"{name}_{case}": value for name, value in own.items()}
    return numbers


def figure_19() -> pl.DataFrame:
    """Simulate both, and both with e = 1."""
    return histories(INELASTIC | {"a, e = 1": decoupled(1e5, 1.0, 150.0), "b, e = 1": decoupled(1e3, 1.0, 150.0)})


def _share_before_the_brake(run: Run) -> float:
    """Return how many per cent of V_p the object has when the robot begins to brake."""
    trace = run.trace
    begin = trace.time[np.argmax((trace.flange_velocity < MOTION.speed) & (run.contact > 0))]
    return float(100 * np.interp(begin, trace.time, trace.object_velocity)) / run.final_velocity


def _during(contacts: Iterable[ig.Trace], name: str) -> Numbers:
    """Return numbers of two contacts, each NAME_... an array (2,) of (a) and (b), and words about them.

    What is said from where the tool has fallen behind the flange begins there; in the first moments it runs ahead.
    """
    numbers: Numbers = {f"{word}_{name}": [] for word in ("push", "stretch", "compressed", "gain", "slower")}
    for touching in contacts:
        behind = int(np.argmax(touching.tool_velocity < touching.flange_velocity))
        stretch = np.max(touching.tool_position - touching.flange_position)
        gain, time = touching.tool_velocity[behind:] - touching.flange_velocity[behind:], touching.time
        slower = "throughout"
        if (gain >= 0.0).any():
            until = time[behind + np.argmax(gain >= 0.0)] - time[0]
            slower = f"for the first {1e3 * until:.0f} of {1e3 * np.ptp(time):.0f} ms"
        own = (touching.coupling_force[behind:].min(), stretch, "always" if stretch < 0.0 else "not always")
        for values, value in zip(numbers.values(), (*own, gain.max(), slower), strict=True):
            values.append(value)
    return numbers


def _numbers_19(frame: pl.DataFrame) -> Numbers:
    a, b = (Run(frame, case) for case in "ab")
    contacts, felt = (a.first_contact, b.first_contact), (a.felt_contact, b.felt_contact)
    return {
        "velocities": [run.final_velocity for run in (a, b)],
        "velocities_elastic": [Run(frame, f"{case}, e = 1").final_velocity for case in "ab"],
        "velocity_a": a.final_velocity, "velocity_b": b.final_velocity,
        "shares": [_share_before_the_brake(run) for run in (a, b)],
        "deceleration_a": a.deceleration, "deceleration_b": b.deceleration,
        "duration_a": 1e3 * a.duration_of_contact, "duration_b": 1e3 * b.duration_of_contact,
        "parting_a": a.during_contact.flange_velocity[-1], "parting_b": b.during_contact.flange_velocity[-1],
        "restitutions": [run.restitution for run in (a, b)],
        "restitutions_felt": [
            (end.object_velocity[-1] - end.tool_velocity[-1]) / start.tool_velocity[0]
            for end, start in zip(felt, contacts, strict=True)
        ],
        **_during(contacts, "contact"), **_during(felt, "felt"),
    }  # fmt: skip


def figure_20() -> pl.DataFrame:
    """Simulate both cases of Fig. 19."""
    return histories(INELASTIC)


def _numbers_20(frame: pl.DataFrame) -> Numbers:
    pair = a, b = [Run(frame, case) for case in "ab"]
    felt = [run.felt_contact for run in pair]
    impulses_felt = [float(np.trapezoid(contact.coupling_force, contact.time)) for contact in felt]
    nominal = np.array([run.equation_22(RESTITUTION) for run in pair])
    nominal_felt = np.array([run.equation_22(RESTITUTION, J) for run, J in zip(pair, impulses_felt, strict=True)])
    velocities = np.array([run.final_velocity for run in pair])
    velocities_felt = np.array([contact.object_velocity[-1] for contact in felt])
    return {
        "impulses": [run.impulse for run in pair], "velocities": velocities,
        "same_order": (a.impulse - b.impulse) * (a.final_velocity - b.final_velocity),
        "identity": max(abs(run.equation_22() / run.final_velocity - 1.0) for run in pair),
        "drawn_error": max(abs(run.running_impulse()[1][-1] / run.impulse - 1.0) for run in pair),
        "nominal": nominal, "nominal_error": np.abs(nominal / velocities - 1.0),
        "velocities_felt": velocities_felt,
        "nominal_felt": nominal_felt, "nominal_error_felt": np.abs(nominal_felt / velocities_felt - 1.0),
        "restitutions": [run.restitution for run in pair],
    }  # fmt: skip


FIGURES = {
    "figure_17": Reproduction(
        figure_17, partial(velocities_and_forces, titles=ELASTIC_TITLES, window=WINDOW), _numbers_17
    ),
    "figure_19": Reproduction(
        figure_19, partial(velocities_and_forces, titles=INELASTIC_TITLES, window=WINDOW), _numbers_19
    ),
    "figure_20": Reproduction(figure_20, partial(impulses, titles=IMPULSES), _numbers_20),
}
