"""Generate the code of the explicit integrator: the 8(5,3) pair of Dormand and Prince, called DOP853 in Hairer's code.

The pair has order 8 and 12 stages; the rate at the end of a step is the first stage of the next step. Coefficients,
error estimates and dense output of order 7 are from Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I
(1993), II.10, in SciPy's double precision. setup.py writes `dop853.pxi` with functions for each kind of chain. They
have no loops, so a compiler can keep their local variables in registers.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from scipy.integrate import DOP853


def by_stage(rows: Iterable[Iterable[float]]) -> tuple[dict[int, float], ...]:
    """Return, for each row of coefficients, its nonzero weights by the index of the stage."""
    return tuple({stage: float(weight) for stage, weight in enumerate(row) if weight} for row in rows)


A = by_stage([*DOP853.A, DOP853.B, *DOP853.A_EXTRA])
"""Row i: weights of the earlier stages in stage i. Row 12 is also the solution; rows 13 to 15 are for dense output."""
ERROR = by_stage([DOP853.E5, DOP853.E3])
"""Weights of the stages in the error estimates of orders 5 and 3."""
DENSE = by_stage(DOP853.D)
"""Weights of the stages in the upper four coefficients of the polynomial through a step."""

NOTICE = '"""The steps of `solver/tableau.py` written out by setup.py: edit that."""'
LAST = 12  # the stage at the end of the step
KEPT = range(5, LAST)  # stages for dense output, in addition to the first and the last


@dataclass(frozen=True)
class Layout:
    """The components of a chain's scaled state."""

    name: str  # first part of the names of the generated functions
    places: str  # one letter for each component, in order
    used: str  # the components on which the rates depend; the others are integrals


LAYOUTS = (
    Layout("rigid", "zwtp", "zw"),
    Layout("spring", "zwtpyvq", "zwyv"),
    Layout("integrated", "zwtpyvsjqr", "zwtyvqr"),
)


def weighed(weights: dict[int, float], place: str) -> str:
    """Return code for the weighted sum of the stages' rates of the component `place`."""
    return " + ".join(f"{weight!r} * k{stage}.{place}" for stage, weight in weights.items())


def moved(stage: int, place: str, newest: bool) -> str:
    """Return code that computes a component at a stage; with `newest`, the newest rate is added last."""
    *earlier, last = A[stage].items()
    if not newest:
        return f"{place}{stage} = {place}0 + h * ({weighed(A[stage], place)})"
    start = f"({place}0 + h * ({weighed(dict(earlier), place)}))" if earlier else f"{place}0"
    return f"{place}{stage} = {start} + h{stage} * k{last[0]}.{place}"


def stage_lines(layout: Layout, stage: int) -> list[str]:
    """Return lines of code that compute the state at a stage and its rates."""
    lines = [f"h{stage} = h * {list(A[stage].values())[-1]!r}"]
    lines += [moved(stage, place, newest=True) for place in layout.used]
    arguments = ", ".join(f"{place}{stage}" for place in layout.used)
    return [*lines, f"k{stage} = {layout.name}_rates(now, {arguments})"]


def header(layout: Layout, name: str, stages: range, given: dict[int, str]) -> list[str]:
    """Return the first lines of a function: declarations, the state `work.x`, and copies of the rates in `given`."""
    kind = f"{layout.name.title()}Rates"
    return [
        f"cdef {name} noexcept nogil:",
        f"    cdef {kind} {', '.join(f'k{stage}' for stage in (*given, *stages))}",
        f"    cdef double {', '.join(f'{place}0 = work.x[{i}]' for i, place in enumerate(layout.places))}",
        f"    cdef double {', '.join(f'{place}{stage}' for stage in stages for place in layout.used)}",
        f"    cdef double {', '.join(f'h{stage}' for stage in stages)}",
        *(f"    memcpy(&k{stage}, {where}, sizeof({kind}))" for stage, where in given.items()),
    ]


def step(layout: Layout) -> list[str]:
    """Return the code of a function that steps from `work.x` to `work.trial` and returns the estimated error."""
    integrals = [place for place in layout.places if place not in layout.used]
    lines = header(
        layout, f"double {layout.name}_step(const Piece *now, Work *work, double h)",
        range(1, LAST + 1), {0: "work.rate"},
    )  # fmt: skip
    body = ["cdef double e5, e3, size, fifth = 0.0, third = 0.0"]
    if integrals:
        body.append(f"cdef double {', '.join(f'{place}{LAST}' for place in integrals)}")
    for stage in range(1, LAST + 1):
        body += stage_lines(layout, stage)
    body += [moved(LAST, place, newest=False) for place in integrals]
    for place in layout.places:
        body += [f"e{5 - 2 * i} = {weighed(weights, place)}" for i, weights in enumerate(ERROR)]
        body.append(f"size = 1.0 / max(max(fabs({place}0), fabs({place}{LAST})), 1.0)")
        body.append("fifth += (e5 * size) * (e5 * size)")
        body.append("third += (e3 * size) * (e3 * size)")
    body += [f"work.trial[{i}] = {place}{LAST}" for i, place in enumerate(layout.places)]
    body += [f"work.late[{layout.places.index(place)}] = {place}{LAST - 1}" for place in layout.used]
    body += [f"memcpy(work.stage[{i}], &k{stage}, sizeof(k{stage}))" for i, stage in enumerate(KEPT)]
    body += [f"memcpy(work.trial_rate, &k{LAST}, sizeof(k{LAST}))", "if not isfinite(fifth + third):"]
    body += ["    return INFINITY", "if fifth == 0.0:", "    return 0.0"]
    body.append(f"return h * fifth / (now.tolerance * sqrt((fifth + 0.01 * third) * {len(layout.places)}.0))")
    return lines + ["    " + line for line in body]


def dense(layout: Layout) -> list[str]:
    """Return the code of a function that computes the upper coefficients of the polynomial through the last step."""
    given = {0: "work.rate", **{stage: f"work.stage[{i}]" for i, stage in enumerate(KEPT)}, LAST: "work.trial_rate"}
    stages = range(LAST + 1, len(A))
    lines = header(layout, f"void {layout.name}_dense(const Piece *now, Work *work, double h)", stages, given)
    body = [line for stage in stages for line in stage_lines(layout, stage)]
    for i, weights in enumerate(DENSE):
        body += [f"work.dense[{3 + i}][{j}] = h * ({weighed(weights, place)})" for j, place in enumerate(layout.places)]
    return lines + ["    " + line for line in body]


def eigenvalue(layout: Layout) -> list[str]:
    """Return the code of a function that estimates an eigenvalue from the last two stages, see `stepper.pxi`."""
    lines = [f"cdef double {layout.name}_eigenvalue(const Work *work) noexcept nogil:"]
    body = ["cdef double apart, rates = 0.0, states = 0.0"]
    for place in layout.used:
        i = layout.places.index(place)
        body += [f"apart = work.trial_rate[{i}] - work.stage[{len(KEPT) - 1}][{i}]", "rates += apart * apart"]
        body += [f"apart = work.trial[{i}] - work.late[{i}]", "states += apart * apart"]
    body.append("return sqrt(rates / states) if states > 0.0 else 0.0")
    return lines + ["    " + line for line in body]


def text() -> str:
    """Return the text of `dop853.pxi`."""
    parts = [NOTICE, *("\n".join(write(layout)) for layout in LAYOUTS for write in (step, dense, eigenvalue))]
    return "\n\n\n".join(parts) + "\n"
