"""Section 2.2, contacts that take time. Case (a): the tool is fixed to the robot. Case (b): the tool is free.

An approach at 1 m/s without a brake. Penetration and force of case (b) are those of a fixed tool and an object with the
reduced mass of tool and object. So case (b) is simulated with a fixed tool and this object.
"""

from collections.abc import Iterator
from itertools import product

import numpy as np
import polars as pl

import impact_gym as ig
from experiments.lab.scenes import CONSTANT_SPEED, OBJECT_MASS, REDUCED_MASS, TOOL_MASS, scene
from experiments.lab.study import Row
from experiments.studies.paper.models import PAPER, Model
from experiments.studies.paper.runs import where
from experiments.studies.paper.statements import Figure, Finding
from impact_gym.physics import impact

STIFFNESSES = (1e3, 1e4, 1e5, 1e6)  # N/m^1.5
VANISHING = (0.005, 0.01, 0.02)  # restitutions close to 0
RESTITUTIONS = np.round(np.arange(0.05, 1.0001, 0.025), 3).tolist()  # arguments of eq. 7
EXPONENTS = (1.0, 1.5, 2.0)  # n of eq. 5; m is 1.5
MASSES = (0.1, OBJECT_MASS, 2.5)  # kg, of the object
SMALL = np.round(np.arange(0.01, 0.3, 0.01), 2)  # small restitutions; the paper gives no number


def figure_06(model: Model = PAPER) -> list[Row]:
    """Simulate contacts of the fixed and of the free tool for several contact stiffnesses and restitutions."""
    rows: list[Row] = []
    cases = {"a": OBJECT_MASS, "b": REDUCED_MASS}
    for (case, mass), k_c, e in product(cases.items(), STIFFNESSES, [*VANISHING, *RESTITUTIONS]):
        (contact,) = model.simulate(scene(k_c, e, object_mass=mass), CONSTANT_SPEED, duration=2.0).contacts
        assert contact.end is not None  # the contact ends during the run
        rows.append({
            "case": case, "contact_stiffness": k_c, "restitution": e, "peak_force": contact.peak_force,
            "duration": contact.end - contact.start, "object_velocity": contact.impulse / OBJECT_MASS,
            "parting": contact.separation_velocity / contact.approach_velocity,
        })  # fmt: skip
    return rows


def _statements_06(frame: pl.DataFrame) -> Iterator[Finding]:
    grid = frame.filter(pl.col("restitution") >= RESTITUTIONS[0])
    force = where(grid, case="a", contact_stiffness=1e5)["peak_force"]
    lowest = int(np.argmin(force))
    yield Finding("force", (np.diff(force) < 0).all(),
        f"{force[-1]:.1f} N at e = 1, {force[lowest]:.1f} N at {RESTITUTIONS[lowest]:g}, {force[0]:.1f} N at 0.05"
    )  # fmt: skip
    durations = np.array([where(grid, case=case, contact_stiffness=k_c)["duration"]
                          for case, k_c in product("ab", STIFFNESSES)])  # fmt: skip
    yield Finding("duration", (np.diff(durations) < 0).all(),
        f"{durations[0, 2] / durations[0, -1]:.2f} times as long at e = 0.1 as at e = 1")  # fmt: skip
    parting = where(frame.filter(pl.col("restitution") <= RESTITUTIONS[0]), case="b", contact_stiffness=1e5)["parting"]
    yield Finding("together", (np.diff(parting) > 0).all() and parting[0] < 0.01,
        f"{parting[-1]:.3f} of the approach velocity at e = 0.05, {parting[0]:.4f} at e = 0.005")  # fmt: skip
    free = where(grid.filter(pl.col("restitution") >= 0.1), case="b", contact_stiffness=1e3)
    theory = impact.free_tool(TOOL_MASS, OBJECT_MASS, 1.0, 0.0, free["restitution"])[1]
    error = 100.0 * np.abs(free["object_velocity"] / theory - 1.0)
    yield Finding("instantaneous", error.max() < 5.0,
        f"eq. 4 is off by at most {error.max():.1f} % (at e = {free['restitution'][error.argmax()]:g})")  # fmt: skip


def _contact(model: Model, contact: ig.Contact, mass: float) -> Row:
    """Simulate one contact; return `chi` (eq. 5), and the force at its ends over the largest force."""
    approach = ig.Scene(ig.Tool(TOOL_MASS), ig.Object(mass, 0.25), contact)
    outcome, trace = model.trace(approach, CONSTANT_SPEED)
    (record,), used = outcome.contacts, model.scene(approach).contact
    depth, rate = trace.tool_position - trace.object_position, trace.tool_velocity - trace.object_velocity
    inside = (trace.contact_force > 0.0) & (depth > 0.0) & (trace.time >= record.start)
    force, depth, rate = (column[inside] for column in (trace.contact_force, depth, rate))
    elastic, path = used.stiffness * depth**used.stiffness_exponent, depth**used.damping_exponent * rate
    chi = (force - elastic)[path.argmax()] / path.max()
    return {"n": contact.damping_exponent, "chi": chi, "ends": max(force[0], elastic[-1]) / force.max()}


def beyond_contact(model: Model = PAPER) -> list[Row]:
    """Simulate the linear contact, that of the paper, and other exponents n with several masses."""
    linear = ig.Contact(5e3, 0.5, "exact", stiffness_exponent=1.0, damping_exponent=0.0)
    cases = [("linear", PAPER, linear, OBJECT_MASS), ("paper", model, ig.Contact(1e5, 0.5), OBJECT_MASS)]
    others = ((ig.Contact(1e5, 0.5, "exact", damping_exponent=n), mass) for n, mass in product(EXPONENTS, MASSES))
    cases += [("exponents", model, contact, mass) for contact, mass in others]
    return [{"case": case, **_contact(used, contact, mass)} for case, used, contact, mass in cases]


def laws(model: Model = PAPER) -> pl.DataFrame:
    """Evaluate the restitution that eq. 7 and the law of Hunt and Crossley deliver, at small nominal restitutions."""
    used = model.scene(scene(1e5, 0.5)).contact.dissipation
    errors = [np.abs(ig.effective_restitution(law, SMALL) - SMALL) for law in (used, "hunt-crossley")]
    return pl.DataFrame({"equation_7": errors[0], "earlier": errors[1]})


def _statements_contact(frame: pl.DataFrame) -> Iterator[Finding]:
    ends = frame["ends"]
    yield Finding("overcomes", ends[1] < 1e-3,
        f"at most {ends[1]:.0e} of the largest force; with the linear contact {ends[0]:.2f}")  # fmt: skip
    chi = {n: where(frame, case="exponents", n=n)["chi"] for n in EXPONENTS}
    spread = {n: values.max() / values.min() - 1.0 for n, values in chi.items()}
    yield Finding("exponents", spread[1.5] < 1e-6 and min(spread[1.0], spread[2.0]) > 0.1,
        f"from 0.1 to 2.5 kg chi varies by {100 * spread[1.0]:.0f} % with n = 1, by {100 * spread[1.5]:.4f} % "
        f"with n = m = 1.5, by {100 * spread[2.0]:.0f} % with n = 2")  # fmt: skip


def _statements_laws(frame: pl.DataFrame) -> Iterator[Finding]:
    ours, earlier = frame["equation_7"].to_numpy(), frame["earlier"].to_numpy()
    yield Finding("equation_7", (ours < earlier).all() and ours.max() < 0.05,
        f"eq. 7 is off by at most {ours.max():.3f}, Hunt and Crossley by up to {earlier.max():.2f}")  # fmt: skip


FIGURES = (
    Figure(figure_06, _statements_06),
    Figure(beyond_contact, _statements_contact),
    Figure(laws, _statements_laws),
)
