"""Designs: laws of pads and of a tool in flight, limits, and the study, which continues and chooses by loss."""

import re
from dataclasses import asdict, replace

import numpy as np
import polars as pl
import pytest

import impact_gym as ig
from agents.baselines import BlindProfile
from agents.evaluate.scenario_batch import TUNING_SEED, ScenarioBatch, Travel
from agents.setups import load_setup
from agents.setups.tuned import read_tuned
from experiments.design.__main__ import design
from experiments.design.options import CHOSEN, FRONT, PAPER, DesignOptions
from experiments.design.pads import PADS, Pad
from experiments.design.search import PENALTY, Candidate, Limits, objective, play
from experiments.design.study import PAPERS_RULE, Search, chart
from experiments.design.variables import SearchVariable, as_built
from experiments.lab.study import StudyOptions, StudyRun
from impact_gym.task import Task

PROFILE = list(read_tuned("blind-profile")["weights"]["2"]["parameters"].values())


@pytest.mark.parametrize("name", PADS)
def test_pad_and_object_are_two_springs_in_series(name):
    pad, restitution = Pad.of(name), 0.8
    for stiffness in (1e3, 1e5, 1e7):
        together, rebound = pad.contact(stiffness, restitution)
        pressed = np.array([pad.stiffness, stiffness]) ** (-2 / 3)  # m at 1 N; each stores 0.4 J/m of it
        assert together ** (-2 / 3) == pytest.approx(pressed.sum())
        lost = pressed @ [1.0 - pad.restitution**2, 1.0 - restitution**2]
        assert (1.0 - rebound**2) * pressed.sum() == pytest.approx(lost)
    material = ig.MATERIALS[name]  # the pad is a dome of it
    edges = [4 / 3 * E / (1 - nu**2) * pad.radius**0.5 for E in material.young for nu in material.poisson]
    assert min(edges) * (1 - 1e-12) <= pad.stiffness <= max(edges) * (1 + 1e-12)
    assert pad.restitution == max(material.restitution)


def test_search_allows_for_more_than_the_tolerance():
    """A critically damped spring deflects by m a / k: within the limit at 5.5 %, but not at the 6 % of a search."""
    coupling = {"type": "SpringDamper", "stiffness": [300.0, 400.0], "damping_ratio": 1.0}
    environment = {"coupling": coupling, "scenario": {"distance": 0.5}, "acceleration_range": [1.0, 5.0]}
    candidate = Candidate(environment | {"control_period": 0.002}, "ConstantSpeed")  # cubics between steps are exact
    variables = [SearchVariable("coupling.stiffness", 300.0, 400.0)]
    candidates = np.array([np.log(350.0), 1.5, 5.0, 5.0]) * np.ones((4, 1, 1))

    def loss(off):
        limits = Limits(0.125 * 5.0 / (350.0 * (1.0 - off)))
        return objective(candidate, variables, 9.0, limits, 0.05, 100, 4)(candidates)[0, 0]

    assert loss(0.055) - loss(0.5) == pytest.approx(PENALTY * (0.945 / 0.94 - 1.0), rel=0.2)  # 100 designs, not all
    assert loss(0.06) == loss(0.5)


def test_excess_is_the_sum_of_shares_beyond_the_limits():
    stage, travel = ScenarioBatch(TUNING_SEED, 40, threads=1), Travel(40)
    played = stage.play(BlindProfile(PROFILE), watch=travel)
    peak, twice = np.quantile(played.peak_force, 0.95), (played.contact_count > 1).mean()

    def excess(**limits):
        return Limits(**{"deflection": None, **limits}).excess(played, travel, pad=None)

    limited = {"deflection": travel.deflection.max(), "stroke": travel.stroke.max(), "peak_force": peak}
    for name, value in limited.items():
        assert excess(**{name: value / 1.5}) == pytest.approx(0.5)
        assert excess(**{name: value * 1.01}) == 0.0
    assert excess(touched_once=1.0 - twice / 2) == pytest.approx(1.0)
    assert excess(touched_once=0.5) == 0.0


def test_play_draws_each_design_within_its_tolerance():
    design = {"coupling.stiffness": 80.0, "coupling.damping_ratio": 0.4}
    assert as_built({"coupling.rear_stop": -0.02}, 0.05) == {"coupling.rear_stop": pytest.approx([-0.021, -0.019])}
    candidate = asdict(Candidate({}, "BlindProfile", PROFILE, design))
    alone = ScenarioBatch.of("test", None, Task().changed(design), threads=1).play(BlindProfile(PROFILE))
    assert (play(candidate, 0.0, {})["object_velocity"].to_numpy() == alone.object_velocity).all()
    assert (play(candidate, 0.05, {})["object_velocity"].to_numpy() != alone.object_velocity).all()
    soft = play({**candidate, "material": "neoprene"}, 0.0, {})
    through_pad = Pad.of("neoprene").contact(alone.scenario["contact_stiffness"], alone.scenario["restitution"])
    for name, values in zip(("contact_stiffness", "restitution"), through_pad, strict=True):
        assert soft[name].to_numpy() == pytest.approx(values)


@pytest.fixture
def small(tmp_path):
    spring = ("coupling.stiffness=20:200", "coupling.damping_ratio=0.2:2")
    few = {"scenarios": 12, "budget": 8, "population": 8, "seeds": 1, "processes": 0, "against": ()}
    return DesignOptions("linear-blind", spring, tmp_path / "out", times=(1.3, 1.0), **few)


def test_stopped_study_continues_to_a_set_up_and_a_page(small):
    search = Search(small)
    begun = StudyRun(search.study(), StudyOptions(small.out, processes=0), "the command")
    assert len(begun["searches"]) == 4  # stopped here
    design(small)
    run = StudyRun(search.study(), StudyOptions(small.out, processes=0))
    assert run["searches"].equals(begun["searches"])
    rows = pl.read_csv(small.out / "summary.csv")
    of_paper, *curve = rows.filter(pl.col("line").is_in([PAPER, CHOSEN]))[["approach_time", "object_velocity"]].rows()
    gain = 1.0 - np.interp(of_paper[0], *zip(*sorted(curve), strict=True)) / of_paper[1]
    said = re.search(r"rule, mean \S+ is (\S+) % \[", (small.out / "index.html").read_text())
    assert float(said[1]) == pytest.approx(100.0 * gain, abs=0.06)
    assert rows["lower"].to_numpy() == pytest.approx(1.0 - rows["object_velocity"].to_numpy() / of_paper[1])

    (axes,) = chart(rows.to_dicts()).axes
    assert ("time" in axes.get_xlabel(), "V_p" in axes.get_ylabel()) == (True, True)
    (points,) = [line.get_xydata() for line in axes.lines if line.get_label() == "chosen design"]
    assert points == pytest.approx(np.array(curve))

    chosen = search.candidate(search.chosen(run))
    (cell,) = search.controllers(False, run)  # searched with the design as it may be built
    searched = cell.arguments["candidate"]["environment"]["coupling"]["stiffness"]
    assert searched == pytest.approx([edge * chosen.design["coupling.stiffness"] for edge in (0.94, 1.06)])
    setup = load_setup(small.out / "linear-blind-designed.toml")
    assert setup.environment["coupling"]["stiffness"] == chosen.design["coupling.stiffness"]
    assert setup.environment["tool_mass"] == small.arm.environment["tool_mass"]
    assert setup.training == load_setup("linear-blind").training


def test_front_has_the_lowest_loss_at_each_time(small):
    found = [(1.0, 1, 0.3), (1.3, 1, 0.1), (1.0, 2, 0.2), (1.3, 2, 0.4), (1.3, 3, 0.2)]
    searches = pl.DataFrame(found, schema=["allowed", "seed", "loss"], orient="row").with_columns(line=pl.lit(FRONT))
    other = searches.with_columns(line=pl.lit("another coupling"), loss=0.0)
    front = Search(small).front({"searches": pl.concat([other, searches])})
    assert [(row["allowed"], row["seed"]) for row in front] == [(1.0, 2), (1.3, 1)]


def test_loss_has_costs_for_a_miss_and_for_lateness(small):
    """A candidate that is too slow to touch the object has no V_p, and must not win."""
    candidate = replace(Search(small).candidate(PAPERS_RULE), environment=small.searched)
    design = [float(variable.parameter().start) for variable in small.variables]
    gentle, never = [*design, 0.3, 8.0, 8.0], [*design, 0.01, 8.0, 8.0]

    def losses(allowed):
        of = objective(candidate, small.variables, allowed, small.limits, small.tolerance, small.scenarios, 8)
        return of(np.array([gentle, never] * 4)[:, None])[:2, 0]

    touched, missed = losses(9.0)
    assert touched < 0.5 < missed == pytest.approx(2.0)
    time = (losses(0.1)[0] - losses(0.2)[0]) / (PENALTY * (1 / 0.1 - 1 / 0.2))  # mean approach time, s
    assert 0.15 / 0.3 < time < 0.35 / 0.3 + 0.1
    assert losses(0.2)[0] - touched == pytest.approx(PENALTY * (time / 0.2 - 1.0))
