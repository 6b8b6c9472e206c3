"""Fig. 18: V_p against the stiffness of the coupling for three contact stiffnesses; zeta = 1, e = 0.1."""

from itertools import product

from experiments.paper import figure_16
from experiments.paper.layouts import Panels, panels
from experiments.paper.statements import Statements, section_4_1, section_4_2
from experiments.paper.tables import Table

TITLE = "Effects of the impulses of the damping and elastic forces on V_p, e = 0.1"
ALT = """V_p against coupling stiffness for three contact stiffnesses, e = 0.1: all curves rise; the softest contact
lies lowest, the other two cross near 100 N/m."""


def compute() -> Table:
    """Simulate the curves, and some of their points without a brake."""
    pairs = product(figure_16.CONTACT_STIFFNESSES, figure_16.SETTLED_STIFFNESSES)
    return figure_16.sweep(0.1, [figure_16.point(k_t, k_c, 0.1, braked=False) for k_c, k_t in pairs])


@panels(7.0, 4.6)
def plot(table: Table, axes: Panels) -> None:
    figure_16.draw(axes, table)
    axes.set_title("e = 0.1, $\\zeta$ = 1")


def statements(table: Table) -> Statements:
    soft, middle, stiff = (figure_16.on_grid(table, k_c) for k_c in figure_16.CONTACT_STIFFNESSES)
    unbraked = [figure_16.curve(table, k_c, braked=False)["object_velocity"] for k_c in figure_16.CONTACT_STIFFNESSES]
    steadily = (unbraked[0] < unbraked[1]) & (unbraked[1] < unbraked[2])
    ordered = (soft < middle) & (middle < stiff)
    at = (figure_16.COUPLING_STIFFNESSES == 150.0).argmax()
    rising = figure_16.rising_from(table)
    yield section_4_2.claim(
        "The decrease in k_c leads to a reduction in V_p, opposite to e = 1",
        ordered.all(),
        f"{figure_16.places(ordered)}; the softest contact is slowest at {((soft < middle) & (soft < stiff)).sum()}",
        "V_p at 1e3 below that at 1e4 below that at 1e5, at every k_t of the grid from 5 to 200 N/m",
        why="The two terms of eq. 22 compete. The stiffer contact lasts less long under the brake, so the coupling "
        "gives more; but it also parts more slowly (at k_t = 50 N/m with 0.025 m/s at 1e5 against 0.141 m/s at 1e4), "
        "which is the 1 + e of eq. 22. On soft couplings the second outweighs the first between 1e4 and 1e5, by at "
        "most 0.02 m/s.",
    ).read_as(
        "no brake at all ('braking after the collision', section 4.2)",
        steadily.all(),
        f"in this order at {steadily.sum()} of {steadily.size} values of k_t",
    )
    yield section_4_2.repeated.claim(
        "The same at the coupling of Fig. 19 (k_t = 150 N/m)",
        ordered[at],
        f"{soft[at]:.4f}, {middle[at]:.4f}, {stiff[at]:.4f} m/s at k_c = 1e3, 1e4, 1e5",
        "in this order at k_t = 150 N/m",
    )
    yield section_4_1.claim(
        "The impulse of the decoupling system increases V_p: V_p rises with k_t",
        max(rising.values()) == figure_16.COUPLING_STIFFNESSES[0],
        figure_16.by_curve({k_c: f"rises from {k_t:g} N/m on" for k_c, k_t in rising.items()}),
        "rises at every step of the grid from 5 to 200 N/m, on all curves",
    )
