"""The storm covers its ranges, its checks find planted faults, and the page lists every failure."""

import math

import numpy as np
import polars as pl
import pytest
from browser_pages import text_of_a_page_that_stands_on_its_own
from small_studies import small_run
from solver_scenes import COUPLINGS, MOTION, ROBOTS, scene

import impact_gym as ig
from experiments.lab.study import Cell
from experiments.studies import stability
from experiments.studies.solvers import approaches
from experiments.studies.solvers.approaches import Approach
from experiments.studies.stability import promises, storm
from impact_gym.scene import Dissipation

FEW = 27  # scenes: every coupling with every robot, three times


def approach_of(coupling=None, robot=None, e=0.5, motion=MOTION):
    return Approach("7", "planted", scene(1e5, e, coupling, robot), motion, 0.8)


def test_storm_covers_its_ranges_with_every_chain_and_law_and_depends_on_its_number_alone():
    drawn = [approaches.storm(number) for number in range(1500)]
    scenes, contacts = [approach.scene for approach in drawn], [approach.scene.contact for approach in drawn]
    couplings = [each.coupling for each in scenes if not isinstance(each.coupling, ig.Rigid)]
    brakes = [approach.motion.brake for approach in drawn if approach.motion.brake]
    for name, values in {
        "contact stiffness": [contact.stiffness for contact in contacts],
        "restitution": [contact.restitution for contact in contacts],
        "mass ratio": [each.object.mass / each.tool.mass for each in scenes],
        "speed": [approach.motion.speed for approach in drawn],
        "coupling stiffness": [each.stiffness for each in couplings],
        "damping ratio": [
            each.stop_damping_ratio if isinstance(each, ig.Bistable) else each.damping_ratio for each in couplings
        ],
        "deceleration": [brake.deceleration for brake in brakes],
    }.items():
        low, high = approaches.RANGES[name]
        assert (min(values), max(values)) == pytest.approx((low, high), rel=1e-12)
        place = np.array(values) / high if low == 0 else np.log(np.array(values) / low) / math.log(high / low)
        inside = place[(place > 1e-9) & (place < 1 - 1e-9)]
        assert len(inside) > 400
        assert np.quantile(inside, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.06)
    assert len({approaches.kind(each) for each in scenes[:9]}) == 9
    assert {contact.dissipation for contact in contacts} == set(Dissipation.__args__)
    exponents = {(contact.stiffness_exponent, contact.damping_exponent) for contact in contacts}
    assert exponents == set(approaches.EXPONENTS)
    assert {each.object.friction is not None for each in scenes} == {False, True}
    assert {getattr(each.coupling, "stroke", None) is not None for each in scenes} == {False, True}
    assert 0.15 < np.mean([approach.motion.brake is None for approach in drawn]) < 0.25
    assert [approaches.storm(number) for number in reversed(range(40))] == drawn[39::-1]
    assert len({repr(each) for each in scenes}) == 1500


def frame_of(*rows):
    return pl.DataFrame([{"scene": number, **row} for number, row in enumerate(rows)], infer_schema_length=None)


def promises_broken(row):
    return {*promises.failures(frame_of(row))["promise"]}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("e", [0.3, 1.0])
def test_row_of_a_sound_run_breaks_no_promise(coupling, robot, e):
    approach = approach_of(COUPLINGS[coupling], ROBOTS[robot], e)
    row = storm.row_of(approach)
    assert row["contacts"] > 0
    assert row["traced"]
    assert promises_broken(row | {"milliseconds": 1.0}) == set()  # the storm judges the time
    assert row["energy_doubt"] < 1e-3
    if e == 1.0 and ig.simulate(*approach.run).contacts[-1].end is not None:
        # nothing dissipates, so a finished contact returns all its energy
        assert abs(row["energy_created"]) < 1e-6 + row["energy_doubt"]


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_row_of_an_isolated_contact_loses_the_energy_of_its_restitution(e):
    row = storm.row_of(approach_of(e=e, motion=ig.Trapezoid(1.0, 8.0)))
    lost = 1.0 - ig.effective_restitution("hu-guo", e) ** 2
    assert row["energy_created"] == pytest.approx(-lost, rel=1e-7)


def planted(**changes):
    """`simulate` with a fault in its trace or in its first contact."""

    def simulate(scene, motion, duration, trace):
        outcome = ig.simulate(scene, motion, duration, trace=trace)
        for name in ig.Trace._fields:
            changes.get(f"trace.{name}", len)(getattr(outcome.trace, name))
        first, *rest = outcome.contacts
        wrong = {name: f(getattr(first, name)) for name, f in changes.items() if hasattr(first, name)}
        return outcome._replace(contacts=(first._replace(**wrong), *rest))

    return simulate


@pytest.mark.parametrize(("fault", "promise"), [
    ({"separation_velocity": lambda v: 1.01 * v}, promises.PASSIVE),
    ({"trace.contact_force": lambda force: force.put(400, -1e-9)}, promises.PUSHED),
    ({"impulse": lambda j: -j}, promises.PUSHED),
    ({"impulse": lambda j: j * (1 + 1e-8)}, promises.BALANCED),
    ({"momentum_error": lambda _: 2e-9}, promises.BALANCED),
    ({"momentum_error": lambda _: math.nan}, promises.BALANCED),
    ({"trace.tool_position": lambda place: place.put(3, math.nan)}, promises.FINITE),
    ({"peak_force": lambda _: math.inf}, promises.FINITE),
])  # fmt: skip
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_row_of_a_planted_fault_breaks_its_promise(fault, promise, coupling):
    row = storm.row_of(approach_of(COUPLINGS[coupling], e=1.0), planted(**fault))
    assert promise.text in promises_broken(row)


def test_checked_finds_an_object_that_is_slowed_between_two_contacts():
    outcome = ig.simulate(*approach_of(ig.SpringDamper(150.0), e=1.0).run)
    first, second, *rest = outcome.contacts
    slowed = second._replace(object_velocity=first.object_velocity - 1e-6)
    wrong = outcome._replace(contacts=(first, slowed, *rest))
    assert storm.checked(approach_of().scene, wrong)["pull"] > promises.PULL


def test_failures_name_a_run_that_cannot_finish_takes_too_long_or_is_not_settled():
    row = storm.row_of(approach_of(ig.SpringDamper(150.0)))
    assert promises_broken(row | {"milliseconds": 50.1}) == {promises.FAST.text}
    for change in (2e-6, math.nan, None):
        assert promises_broken(row | {"milliseconds": 1.0, "finer_change": change}) == {promises.SETTLED.text}
    for_ever = scene(1e12, 1.0, distance=1e-7)  # bounces of 0.2 ms
    stopped = storm.row_of(Approach("7", "", for_ever, ig.Trapezoid(2000.0, 20.0), 20.0))
    hung = approaches.storm(3).about | {"failure": "no answer within 120 s"}
    broken = promises.failures(frame_of(row | {"milliseconds": 1.0}, stopped | {"milliseconds": 1.0}, hung))
    assert broken["scene"].to_list() == [1, 2]
    assert {*broken["promise"]} == {promises.ENDED.text}
    assert "integration steps" in broken["reason"][0]


def test_agreement_finds_differences_and_counts_scenes_without_a_truth():
    ours = frame_of(storm.row_of(approaches.storm(17)))
    (truth,) = storm.truth_row(17, 60.0)
    changes = ({}, {"velocity": truth["velocity"] * (1 + 3e-6)}, {"passes": truth["passes"] + 1})
    same, elsewhere, passed = (promises.agreement(ours, frame_of(truth | change)) for change in changes)
    assert [each["apart"].to_list() for each in (same, elsewhere, passed)] == [[False], [True], [True]]
    assert elsewhere["velocity_error"].item() == pytest.approx(3e-6, rel=1e-3)
    unknown = frame_of(truth | {"failure": "no answer"})
    for without in (unknown, frame_of({"failure": "no answer"})):  # the second has no columns of a solution
        assert promises.agreement(ours, without).is_empty()
    assert promises.over_agreement(same, 1)[-1]
    assert not promises.over_agreement(pl.concat([same, elsewhere]), 0)[-1]
    assert not promises.over_agreement(same.clear(), 0)[-1]


def test_page_lists_every_failure(tmp_path):
    storm_cells = [Cell({"scene": number}, {"number": number}) for number in range(FEW)]
    patience = {2: 1e-3, 17: 60.0}  # s; too little for the independent solver, and enough
    truths = [Cell({"scene": number}, {"number": number, "patience": seconds}) for number, seconds in patience.items()]
    run = small_run(stability.STUDY, tmp_path, storm=lambda *_: storm_cells, truth=lambda *_: truths)
    run.write()
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=0)
    assert all(promise.text in text for promise in promises.PROMISES)
    late, _ = run["truth"].to_dicts()
    assert (late["speed"], late["velocity"]) == (approaches.storm(2).motion.speed, None)
    assert "TimeoutError" in late["failure"]
    changes = (
        {"scene": 3, "milliseconds": 77.0}, {"scene": 5, "failure": "RuntimeError: the run stopped"},
        {"scene": 8, "energy_created": 1e-3, "energy_doubt": 1e-9, "traced": True},
    )  # fmt: skip
    wrong = run["storm"]
    for change in changes:
        wrong = wrong.update(pl.DataFrame(change), on="scene")
    findings = stability.STUDY.analyse(run | {"storm": wrong}, False)
    listed = {row[:3] for row in findings.tables["failures"].iter_rows()}
    assert listed >= {(3, promises.FAST.text, "77"), (5, promises.ENDED.text, "RuntimeError: the run stopped")}
    assert (8, promises.PASSIVE.text) in {row[:2] for row in listed}
    verdicts = {text: met for text, _, met in findings.sections[0].parts[0].rows}
    assert [verdicts[promise.text] for promise in (promises.PASSIVE, promises.FINITE)] == ["missed", "met"]
