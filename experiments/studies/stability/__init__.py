"""`impact-gym study stability`: robustness of the solver on 10,000 random scenes."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import polars as pl

from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies import QUESTIONS
from experiments.studies.solvers.approaches import random_approach
from experiments.studies.solvers.comparison import JUDGES
from experiments.studies.stability.checks import scene_row, truth_row

SCENES = 10_000  # number of random scenes
HANG = 120.0  # s, time limit of one scene, of each solver
EVERY, FIRST = 50, 17  # the independent solver also solves scenes 17, 67, 117, ...
SLOWEST = 50.0  # ms, allowed processor time of a run
MOMENTUM = 1e-9  # allowed ratio of the error of momentum to the impulse of a contact
ENERGY = 1e-6  # allowed `energy_created` minus `energy_doubt`, see CHECKS in `checks`
PULL = 1e-12  # allowed `pull`, see CHECKS in `checks`; rounding alone causes less
AGREEMENT = 1e-6  # allowed relative difference of V_p between two solutions
FINISHED = pl.col("failure") == ""
TRACED = FINISHED & pl.col("traced")


class Promise(NamedTuple):
    """A promise about rows of the table `scenes`. A row breaks the promise if `kept` is false or null."""

    text: str
    number: pl.Expr  # shown for each row that breaks the promise
    kept: pl.Expr
    about: pl.Expr = FINISHED  # rows to which the promise applies

    def broken(self, rows: pl.DataFrame) -> pl.DataFrame:
        """Return scene, promise, reason and coupling for each row that breaks the promise."""
        wrong = rows.filter(self.about, ~self.kept.fill_null(value=False))
        number = self.number.map_elements(lambda value: f"{value:.3g}", pl.String)
        reason = pl.when(FINISHED).then(number).otherwise("failure")
        return wrong.select("scene", promise=pl.lit(self.text), reason=reason, coupling="coupling")

    def finding(self, rows: pl.DataFrame) -> Row:
        """Return the row of the table of promises: how many rows break the promise, and what `number` was."""
        about, broken = rows.filter(self.about), self.broken(rows).height
        numbers = about.select(number=self.number)["number"]
        known = (numbers.filter(numbers.is_finite()) if numbers.dtype.is_float() else numbers.clear()).to_numpy()
        middle, largest = (f"{np.median(known):.3g}", f"{np.max(known):.3g}") if known.size else ("-", "-")
        return {"promise": self.text, "kept": "yes" if about.height and not broken else "no",
                "scenes": f"{about.height:,}", "scenes that break it": f"{broken:,}",
                "median": middle, "largest": largest}  # fmt: skip


CREATED = pl.col("energy_created") - pl.col("energy_doubt")
TIME = pl.col("milliseconds")  # null if the run was stopped at the time limit
PROMISES = (
    Promise("every run ends by itself, with an outcome", FINISHED, FINISHED, pl.lit(value=True)),
    Promise("every number is finite", pl.col("finite"), pl.col("finite")),
    Promise("slowest run under 50 ms", TIME, TIME < SLOWEST, FINISHED | TIME.is_not_null()),
    Promise("momentum error under 1e-9 of the impulse", pl.col("momentum_error"), pl.col("momentum_error") < MOMENTUM),
    Promise("no contact creates energy", CREATED, CREATED <= ENERGY, TRACED),
    Promise("the object is never pulled", pl.col("pull"), pl.col("pull") <= PULL),
    Promise("V_p within 1e-6 of a run at a hundredth of rtol", pl.col("finer_change"),
            pl.col("finer_change") <= AGREEMENT, TRACED),
)  # fmt: skip
ENDED, FINITE, FAST, BALANCED, PASSIVE, PUSHED, SETTLED = PROMISES
AGREES = Promise("V_p within 1e-6 of the independent solver", pl.col("velocity_error"), ~pl.col("apart"),
                 pl.lit(value=True))  # of the rows of `agreement`  # fmt: skip


def failures(rows: pl.DataFrame) -> pl.DataFrame:
    """Return a row for each scene and each promise that it breaks."""
    return pl.concat([promise.broken(rows) for promise in PROMISES]).sort("scene")


def agreement(scenes: pl.DataFrame, truths: pl.DataFrame) -> pl.DataFrame:
    """Return the scenes that the independent solver solved.

    The column `apart` is true if V_p or the number of snap-throughs (`passes`) differs, or if our solver failed.
    """
    true = {f"true_{name}": name for name in ("velocity", "contacts", "passes")}
    empty = pl.DataFrame(schema=dict.fromkeys(true.values(), pl.Float64))  # for the columns, if no scene was solved
    known = pl.concat([truths.filter(FINISHED), empty], how="diagonal_relaxed").select("scene", **true)
    size = pl.max_horizontal(pl.col("true_velocity").abs(), 1e-6 * pl.col("speed"))  # V_p may be 0
    error = (pl.col("object_velocity") - pl.col("true_velocity")).abs() / size
    alike = (pl.col("velocity_error") <= AGREEMENT) & (pl.col("passes") == pl.col("true_passes"))
    apart = ~(FINISHED & alike.fill_null(value=False))
    return scenes.join(known, on="scene").with_columns(velocity_error=error).with_columns(apart=apart)


def analyse(frames: Frames, quick: bool) -> Findings:
    """Return which of `PROMISES` are kept, and tables of the scenes that break a promise."""
    rows, truth = frames["scenes"], frames["truth"]
    judged, broken = agreement(rows, truth), failures(rows)
    found = [*(each.finding(rows) for each in PROMISES), AGREES.finding(judged)]
    missed, failing = sum(row["kept"] != "yes" for row in found), broken["scene"].n_unique()
    of = f"{rows.height:,} random scenes"
    answer = f"All {len(found)} promises are kept on {of}."
    if missed:
        answer = f"{missed} of {len(found)} promises are missed on {of}; scenes that break at least one: {failing}."
    caption = "Scenes that break a promise; median and largest value of the promised number"
    return Findings(answer, [
        Section("What was promised", [
            Table.of(caption, found, {name: f"{{{name}}}" for name in found[0]}, "stability-promises"),
            "failures.csv lists the scenes that break a promise, agreement.csv the scenes that the independent solver "
            "also solved (apart: the solvers differ), truth.csv its results. It failed in "
            f"{truth.filter(~FINISHED).height} of {truth.height} scenes.",
        ]),
        Section("How it is checked", [
            "Scenes: every coupling with every robot, every published law of dissipation, several exponents. Scene k "
            "depends on the number k alone: random_approach(k) of experiments/studies/solvers/approaches.py.",
            "Time (ms): processor time of one simulate without trace; the shorter of two if the first took over 20 ms. "
            "Errors of momentum and energy, pull: see the docstrings of experiments/studies/stability/checks.py.",
        ]),
    ], {"failures": broken, "agreement": judged})  # fmt: skip


def cells(numbers: Iterable[int]) -> list[Cell]:
    """Return a cell for each scene."""
    return [Cell({"scene": number}, {"number": number}) for number in numbers]


def described(labels: Row) -> Row:
    """Return the columns of a scene that was not solved."""
    return random_approach(labels["scene"]).about


STUDY = Study(
    name="stability",
    question=QUESTIONS["stability"],
    measurements=(
        Measurement("scenes", lambda quick, _: cells(range(SCENES // 50 if quick else SCENES)), scene_row,
                    (*SOLVER, *JUDGES), described, HANG),
        Measurement("truth", lambda _, of: cells(range(FIRST, of["scenes"].height, EVERY)), truth_row, JUDGES,
                    described, HANG),
    ),
    analyse=analyse,
)  # fmt: skip
