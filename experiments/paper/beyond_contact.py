"""The linear contact (eq. 5 with m = 1, n = 0) beside the paper's, and eq. 7 beside the law that it improves on.

Left, a tool that moves at 1 m/s strikes 0.25 kg. Right, the restitution that an isolated contact delivers.
"""

from collections.abc import Iterator

import numpy as np

import impact_gym as ig
from experiments.lab.charts import FORCE, OBJECT, TOOL
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import OBJECT_MASS, STEADY, TOOL_MASS, simulate_with_trace
from experiments.paper.statements import Statements, section_2_2
from experiments.paper.tables import Row, Table, from_rows, where

TITLE = "The linear contact, and eq. 7 beside the law of Hunt and Crossley"
ALT = """Left, force against time: the linear contact begins with a jump to 18 N and lets go while its spring still has
9 N; the paper's begins and ends at zero. Right, delivered against nominal restitution: eq. 7 follows the diagonal down
to zero, the law of Hunt and Crossley ends near 0.5."""
RESTITUTION = 0.5
CONTACTS = {
    "linear": ig.Contact(5e3, RESTITUTION, "exact", stiffness_exponent=1.0, damping_exponent=0.0),
    "paper": ig.Contact(1e5, RESTITUTION),
}
SPEEDS = (0.5, 1.0, 2.0)  # m/s, of the tool
NOMINAL = np.round(np.linspace(0.01, 1.0, 100), 2)
SMALL = 0.3  # what we call a small restitution; the paper does not say
LAWS = {"hu-guo": "eq. 7 (Hu and Guo)", "hunt-crossley": "Hunt and Crossley"}


def history(case: str, speed: float) -> Iterator[Row]:
    """Simulate one contact; yield its rows of the table, time from the touch on (s)."""
    contact = CONTACTS[case]
    scene = ig.Scene(ig.Tool(TOOL_MASS), ig.Object(OBJECT_MASS, speed**2 / STEADY.acceleration), contact)
    outcome, trace = simulate_with_trace(scene, ig.Trapezoid(speed, STEADY.acceleration))
    (record,) = outcome.contacts
    assert record.end is not None  # without a coupling a contact ends
    delivered = record.separation_velocity / record.approach_velocity
    depth = np.maximum(trace.tool_position - trace.object_position, 0.0)
    elastic = contact.stiffness * depth**contact.stiffness_exponent
    for i in np.flatnonzero((trace.time >= record.start) & (trace.time <= record.end)):
        yield {
            "case": case, "speed": speed, "time": trace.time[i] - record.start, "force": trace.contact_force[i],
            "elastic": elastic[i], "nominal": RESTITUTION, "delivered": delivered,
        }  # fmt: skip


def compute() -> Table:
    """Simulate both contacts at every speed, and evaluate both laws, which have no motion."""
    rows = [row for case in CONTACTS for speed in SPEEDS for row in history(case, speed)]
    no_motion = dict.fromkeys(("speed", "time", "force", "elastic"), np.nan)
    for law in LAWS:
        for nominal, delivered in zip(NOMINAL, np.asarray(ig.effective_restitution(law, NOMINAL)), strict=True):
            rows.append({"case": law, **no_motion, "nominal": nominal, "delivered": delivered})
    return from_rows(rows)


@panels(10.6, 4.2, columns=2)
def plot(table: Table, grid: Panels) -> None:
    left, right = grid
    for case, label, colour in (("linear", "linear", TOOL), ("paper", "the paper's", FORCE)):
        rows = where(table, case=case, speed=1.0)
        left.plot(1e3 * rows["time"], rows["force"], color=colour, label=f"{label}: force")
        damping = np.where(rows["force"] > 0.0, rows["force"] - rows["elastic"], np.nan)  # none once it has let go
        left.plot(1e3 * rows["time"], damping, ":", color=colour, label="damping part")
    left.set(xlabel="time since the touch (ms)", ylabel="force (N)", title="e = 0.5")
    for (law, label), colour in zip(LAWS.items(), (OBJECT, TOOL), strict=True):
        rows = where(table, case=law)
        right.plot(rows["nominal"], rows["delivered"], color=colour, label=label)
    right.plot([0.0, 1.0], [0.0, 1.0], color="#888888", linewidth=0.8, linestyle="--", label="what is asked for")
    right.set(xlabel="nominal restitution e", ylabel="restitution delivered")
    for axes in grid:
        axes.legend(fontsize=9)


def ends(rows: Table) -> tuple[float, float]:
    """Return the force at the touch, and that of the spring where the contact lets go, over the largest force."""
    pushing = np.flatnonzero(rows["force"] > 0.0)
    largest = rows["force"].max()
    return float(rows["force"][pushing[0]] / largest), float(rows["elastic"][pushing[-1]] / largest)


def statements(table: Table) -> Statements:
    spread = {case: np.ptp(where(table, case=case)["delivered"]) for case in CONTACTS}
    jumps = {case: ends(where(table, case=case, speed=1.0)) for case in CONTACTS}
    linear = where(table, case="linear", speed=1.0)["force"].max()
    error = {law: np.abs((rows := where(table, case=law))["delivered"] - rows["nominal"]) for law in LAWS}
    small = NOMINAL < SMALL
    yield section_2_2.given.claim(
        "The coefficient of restitution of the linear contact does not depend on the velocity before the impact, "
        "which is a drawback",
        spread["linear"] < 1e-6,
        f"varies by {spread['linear']:.1g} from {SPEEDS[0]:g} to {SPEEDS[-1]:g} m/s",
        "the same to 1e-6 at all speeds",
        why="A linear oscillator scales with its velocity. That real contacts do not was found by experiment.",
    )
    yield section_2_2.given.claim(
        "Its viscous component is discontinuous, since it suddenly increases at the beginning of the contact",
        jumps["linear"][0] > 0.1,
        f"jumps to {100 * jumps['linear'][0]:.0f} % of the largest force",
        "more than a tenth of the largest force at the touch",
    )
    yield section_2_2.given.claim(
        "... is not zero at the end of the contact and is opposed to the separation",
        jumps["linear"][1] > 0.1,
        f"the damper holds back with {linear * jumps['linear'][1]:.1f} N where it outweighs the spring",
        "more than a tenth of the largest force where the sum of spring and damper falls to zero",
        why="There our contact lets go. Left to itself the linear one would pull from there on.",
    )
    yield section_2_2.claim(
        "A non-linear contact model overcomes most of the above-mentioned limits",
        max(jumps["paper"]) < 1e-3 and spread["paper"] < 1e-6,
        f"begins and ends within {max(jumps['paper']):.0e} of the largest force; its restitution varies by "
        f"{spread['paper']:.1g} over the speeds",
        "begins and ends below 1/1000 of its largest force; of the three limits it may keep one",
        why="It keeps the first: chi of eq. 7 falls with the approach velocity, so that the restitution does not "
        "depend on it either.",
    )
    yield section_2_2.claim(
        "Eq. 7 improves the model of Hunt and Crossley and extends its validity to small restitution coefficients",
        (error["hu-guo"] < error["hunt-crossley"])[small].all() and error["hu-guo"][small].max() < 0.05,
        f"below e = {SMALL:g} eq. 7 is off by at most {error['hu-guo'][small].max():.3f}, theirs by up to "
        f"{error['hunt-crossley'][small].max():.2f}",
        f"below e = {SMALL:g} nearer to e than theirs everywhere, and within 0.05 of it",
    )
