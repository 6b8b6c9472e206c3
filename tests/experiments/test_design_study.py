"""The study of a design: a stopped study continues, validation chooses, the chosen design is a set-up; the page."""

import re
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from agents.setups import load_setup
from experiments.design.__main__ import design
from experiments.design.findings import summary
from experiments.design.options import CHOSEN, FRONT, PAPER, DesignOptions, write_setup
from experiments.design.pads import on_pad, pad_of
from experiments.design.search import SearchBudget, objective
from experiments.design.study import PAPERS_RULE, Search, study_of
from experiments.lab.study import Run, StudyOptions


@pytest.fixture
def small(tmp_path):
    """Options of a search of a few seconds."""
    spring = ("coupling.stiffness=20:200", "coupling.damping_ratio=0.2:2")
    budget = SearchBudget(scenarios=12, budget=24, population=8)
    few = {"search": budget, "seeds": 1, "processes": 0, "against": ()}
    return DesignOptions("linear-blind", spring, tmp_path / "out", times=(1.0, 1.3), **few)


def run_of(options):
    return Run(study_of(options), StudyOptions(options.out, processes=0), "the command")


def test_stopped_study_continues_and_ends_with_a_set_up(small):
    begun = run_of(small)
    assert len(begun["searches"]) > 0  # stopped here
    kept = {file.name: file.stat().st_mtime_ns for file in small.out.rglob("*.pkl")}
    run = run_of(small)
    run.write()
    assert run["searches"].equals(begun["searches"])
    assert {file.stat().st_mtime_ns for file in small.out.rglob("*.pkl")} >= {*kept.values()}
    rows = summary(run["designs"])
    assert [(row["line"], row["allowed"]) for row in rows if row["line"] != FRONT] == [
        (PAPER, 1.0), *((name, time) for name in (CHOSEN, "paper's spring") for time in (1.0, 1.3))
    ]  # fmt: skip
    search = Search(small)
    chosen = search.candidate(search.chosen(run))
    (cell,) = search.controllers(False, run)  # searched with the design as it may be built
    searched = cell.arguments["candidate"]["environment"]["coupling"]["stiffness"]
    assert np.mean(searched) == pytest.approx(chosen.design["coupling.stiffness"])
    setup = load_setup(write_setup(small.out / "it-designed.toml", small.arm, chosen, "the command"))
    assert setup.environment["coupling"]["stiffness"] == chosen.design["coupling.stiffness"]
    assert setup.environment["tool_mass"] == small.arm.environment["tool_mass"]
    assert setup.training == load_setup("linear-blind").training


def test_design_with_a_pad_writes_set_up_and_page(small, capsys):
    design(replace(small, pad="memory-foam", search=replace(small.search, budget=8), times=(1.0,)))
    assert capsys.readouterr().out.splitlines()[-1].startswith("results: file:")
    scenario = load_setup(small.out / "linear-blind-designed.toml").environment["scenario"]
    assert scenario["contact_stiffness"][1] < pad_of("memory-foam").stiffness
    assert scenario["contact_stiffness"][0] == pytest.approx(on_pad("memory-foam", 1e3, 0.5)[0])
    rows = pl.read_csv(small.out / "summary.csv")
    (paper,), (chosen,) = (rows.filter(line=line).to_dicts() for line in (PAPER, CHOSEN))
    gain = 100.0 * (1.0 - chosen["object_velocity"] / paper["object_velocity"])
    assert chosen["lower"] == pytest.approx(gain / 100.0)
    said = re.search(r"its mean \S+ is (\d+\.\d) % \[", (small.out / "index.html").read_text())
    assert float(said[1]) == pytest.approx(gain, abs=0.06)  # a single point has its own time


def results(velocity, time, excess=0.0, **labels):
    """A table of 40 plays with equal results, of which the first `missed` miss and leave the object at rest."""
    entry = {"line": FRONT, "allowed": 1.0, "seed": 1, "missed": 0} | labels
    number = pl.int_range(pl.len()) < pl.col("missed")
    plays = pl.DataFrame([entry | {"object_velocity": velocity, "approach_time": time, "excess": excess}] * 40)
    return plays.with_columns(missed=number, object_velocity=pl.when(number).then(0.0).otherwise("object_velocity"))


@pytest.mark.parametrize(("played", "seed"), [
    ([(0.20, 0.30, 0.0), (0.19, 0.30, 0.0)], 2),
    ([(0.20, 0.30, 0.0), (0.19, 0.306, 0.0)], 1),  # 2 % later
    ([(0.20, 0.30, 0.0), (0.10, 0.28, 0.1)], 1),  # a tenth beyond a limit
    ([(0.20, 0.30, 0.2), (0.19, 0.30, 0.1)], 2),
    ([(0.20, 0.30, 0.0, 0), (0.19, 0.30, 0.0, 1)], 1),  # a miss of 40 costs 2 / 40 m/s, and has no V_p
    ([(0.20, 0.30, 0.0, 0), (0.15, 0.30, 0.0, 1)], 2),
])  # fmt: skip
def test_front_penalises_late_approaches_exceeded_limits_and_misses(small, played, seed):
    allowed = 1.25
    searches = [{"line": FRONT, "allowed": allowed, "seed": k, "loss": 0.0, "design": "{}", "parameters": "[]"}
                for k in (1, 2)]  # fmt: skip
    validation = [results(v, allowed * time, excess, allowed=allowed, seed=k, missed=sum(missed))
                  for k, (v, time, excess, *missed) in enumerate(played, 1)]  # fmt: skip
    validated = pl.concat([results(0.6, 0.30, line=PAPER), *validation])
    frames = {"searches": pl.DataFrame(searches), "validation": validated}
    (front,) = Search(replace(small, times=(allowed,))).front(frames)
    assert front["seed"] == seed


def test_loss_of_a_miss_is_the_missed_cost_of_the_environment(small):
    """A candidate that is too slow to touch the object has no V_p, and must not win."""
    variables, budget = small.variables, replace(small.search, population=4)
    candidate = replace(Search(small).candidate(PAPERS_RULE), environment=small.searched)
    losses = objective(candidate, variables, 9.0, small.limits, budget)
    design = [float(variable.parameter().start) for variable in variables]
    gentle, never = [*design, 0.3, 8.0, 8.0], [*design, 0.01, 8.0, 8.0]
    touched, missed, *_ = losses(np.array([gentle, never, gentle, gentle])[:, None])[:, 0]
    assert touched < 0.5 < missed == pytest.approx(2.0)
