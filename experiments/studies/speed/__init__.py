"""`impact-gym study speed`: time of an approach at an error and by robot; step rates of environments and trainings.

Times at an error are compared as in the work-precision diagrams of SciMLBenchmarks (Rackauckas et al.).
"""

from collections.abc import Iterator

import polars as pl

from experiments.lab.page import factor
from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS
from experiments.studies.solvers import comparison
from experiments.studies.solvers.approaches import named
from experiments.studies.solvers.comparison import HEYOKA, JUDGES, OURS, SCIPY, power
from experiments.studies.speed import rates

FINE, OTHER = 1e-6, (1e-4, 1e-8, 1e-10)  # m/s, errors of V_p at which solvers are compared
RTOLS = tuple(float(f"1e-{k}") for k in range(3, 14))
VARIANTS = {OURS: (OURS,), HEYOKA: (HEYOKA,), SCIPY: tuple(f"{SCIPY} {method}" for method in comparison.METHODS)}
LONGEST = 800.0  # s, time limit of a cell, including the time in which heyoka compiles


def cells(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each named approach, which times all solvers in turn."""
    rtols, rounds = ((1e-3, 1e-6, 1e-9), 1) if quick else (RTOLS, 5)
    names = sum(VARIANTS.values(), ())
    settings = [[name, rtol] for rtol in rtols for name in names if name != OURS or rtol > 1e-13]
    for name, (description, _approach) in named().items():
        arguments = {"approach": name, "settings": settings, "rounds": rounds}
        yield Cell({"scene": name, "description": description}, arguments)


def cheapest(rows: pl.DataFrame, solver: str, error: float) -> float | str:
    """Return the least time (µs) of a setting whose error, like the errors at finer settings, is at most `error` (m/s).

    If there is none, return the failures of the solver, or "not reached".
    """
    rows = rows.filter(pl.col("solver").is_in(VARIANTS[solver])).sort("setting")
    keeps = (pl.col("velocity_error") <= error).fill_null(value=False).cast(pl.Int8).cum_min().over("solver") == 1
    times = rows.filter(keeps)["microseconds"].to_list()
    return min(times) if times else "; ".join(sorted({*rows["failure"]} - {"", None})) or "not reached"


def table_of(times: pl.DataFrame, error: float) -> Table:
    """Return the times of all solvers at an error (m/s) and their ratios to ours, a row for each approach."""
    lines = []
    for (scene, what), cell in times.group_by("scene", "description", maintain_order=True):
        ours, *theirs = (cheapest(cell, name, error) for name in VARIANTS)
        ratio = (factor(each / ours) if isinstance(each, float) and isinstance(ours, float) else "-" for each in theirs)
        shown = (f"{each:,.0f}" if isinstance(each, float) else each for each in (ours, *theirs))
        lines.append([str(scene), str(what), *shown, *ratio])
    heads = (*(f"{name} (µs)" for name in VARIANTS), *(f"{name} / {OURS}" for name in [*VARIANTS][1:]))
    caption = (f"Processor time of an approach, fastest setting with an error of at most {power(error)} m/s in V_p; "
               f"{SCIPY}: only of the approach's contacts")  # fmt: skip
    return Table(caption, ("approach", "what it is", *heads), lines, "speed-cheapest" if error == FINE else "")


def about_times(times: pl.DataFrame) -> tuple[str, list[Section]]:
    """Return answer and sections of the table `times`."""
    found = table_of(times, FINE)
    words = []
    for head, *ratios in zip(found.head, *found.rows, strict=True):
        if "/" in head and (known := sorted(float(each.replace(",", "")) for each in ratios if each != "-")):
            words.append(f"{head} {factor(known[0])} to {factor(known[-1])}")
    answer = f"Ratios of processor time at an error of {power(FINE)} m/s in V_p: {', '.join(words)}."
    return answer, [
        Section("Who is cheapest at an error", [
            found,
            "Each time is of the fastest setting that keeps the error, if every finer setting keeps the error, too.",
        ]),
        Section("Who is cheapest at other errors", [table_of(times, each) for each in OTHER], folded=True),
        Section("What is compared, and how fair it is", [
            "Truth: the slow independent solver (experiments/reference) with DOP853 at rtol "
            f"{power(comparison.TRUE_RTOL)}.",
            "impact_gym: the whole call of simulate, flights and records included, on one core.",
            "heyoka: the same equations, in the root of the penetration, where they are smooth. Only the calls of the "
            "library count, flights included, on one thread; compiling does not count.",
            "SciPy: RK45, DOP853, LSODA, Radau with events through the same slow solver. Only the time inside contacts "
            "counts, because these methods compute no flights. Equations are Python functions, as SciPy requires.",
            "Time: processor time of the shortest of many calls, in several rounds of all solvers in one process. "
            "Calls over 0.2 s are made once.",
        ]),
    ]  # fmt: skip


def analyse(frames: Frames, quick: bool) -> Findings:
    """Return the sections of the tables that were measured."""
    found = [about_times(frames["times"])] if "times" in frames else []
    found += [rates.about(name, frames[name]) for name in rates.TABLES if name in frames]
    return Findings(" ".join(answer for answer, _ in found), [each for _, sections in found for each in sections])


STUDY = Study(
    name="speed",
    question=QUESTIONS["speed"],
    measurements=(
        Measurement(
            "times", cells, comparison.timed, (*SOLVER, *JUDGES), seconds=LONGEST, processes=1,
            failed=lambda _: {"solver": OURS, "setting": FINE},
        ),
        # processes=0, because other processes are limited to one thread
        Measurement("cost", lambda quick, _: [Cell({}, {"quick": quick})], rates.cost,
                    ("impact_gym", "agents.setups", "experiments.lab.scenes"), processes=0),
        Measurement("environments", lambda quick, _: [Cell({}, {"quick": quick})], rates.stepped,
                    ("impact_gym", "agents"), processes=0),
        Measurement(
            "rates", lambda quick, _: [Cell({"set-up": name}, {"name": name, "quick": quick}) for name in rates.SETUPS],
            rates.three_rates, ("impact_gym", "agents"), processes=0,
        ),
    ),
    analyse=analyse,
    packages=("gymnasium", "torch", "stable-baselines3"),
)  # fmt: skip
