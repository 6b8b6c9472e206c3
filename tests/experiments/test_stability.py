"""Random approaches cover their ranges, and the checks of the study find planted faults."""

import math

import polars as pl
import pytest
from solver_scenes import COUPLINGS, MOTION, ROBOTS, scene

import impact_gym as ig
from experiments.studies import stability
from experiments.studies.solvers import approaches
from experiments.studies.stability import checks


def approach_of(coupling=None, robot=None, e=0.5, motion=MOTION):
    return approaches.Approach(scene(1e5, e, coupling, robot), motion, 0.8)


def test_approaches_cover_their_ranges_by_number_alone():
    drawn = [approaches.random_approach(number) for number in range(600)]
    scenes, contacts = [approach.scene for approach in drawn], [approach.scene.contact for approach in drawn]
    for name, values in {
        "contact stiffness": [contact.stiffness for contact in contacts],
        "restitution": [contact.restitution for contact in contacts],
        "mass ratio": [each.object.mass / each.tool.mass for each in scenes],
        "speed": [approach.motion.speed for approach in drawn],
        "coupling stiffness": [each.coupling.stiffness for each in scenes if not isinstance(each.coupling, ig.Rigid)],
        "deceleration": [approach.motion.brake.deceleration for approach in drawn if approach.motion.brake],
    }.items():
        assert (min(values), max(values)) == pytest.approx(approaches.RANGES[name], rel=1e-12)
    assert len({approaches.kind(each) for each in scenes[:9]}) == 9
    assert {(each.stiffness_exponent, each.damping_exponent) for each in contacts} == {*approaches.EXPONENTS}
    assert [approaches.random_approach(number) for number in reversed(range(40))] == drawn[39::-1]
    assert len({repr(each) for each in scenes}) == 600


def frame_of(*rows):
    return pl.DataFrame([{"scene": number, **row} for number, row in enumerate(rows)], infer_schema_length=None)


def promises_broken(row):
    return {*stability.failures(frame_of(row | {"milliseconds": 1.0}))["promise"]}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("e", [0.3, 1.0])
def test_row_of_a_sound_run_breaks_no_promise(coupling, robot, e):
    approach = approach_of(COUPLINGS[coupling], ROBOTS[robot], e)
    row = checks.row_of(approach)
    assert row["traced"]
    assert (row["contacts"] > 0, promises_broken(row)) == (True, set())
    if e == 1.0 and ig.simulate(*approach).contacts[-1].end is not None:
        # nothing dissipates, so a finished contact returns all its energy
        assert abs(row["energy_created"]) < 1e-6 + row["energy_doubt"]


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_isolated_contact_loses_the_energy_of_its_restitution(e):
    row = checks.row_of(approach_of(e=e, motion=ig.Trapezoid(1.0, 8.0)))
    assert row["energy_created"] == pytest.approx(ig.effective_restitution("hu-guo", e) ** 2 - 1.0, rel=1e-7)


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
    ({"separation_velocity": lambda v: 1.01 * v}, stability.PASSIVE),
    ({"trace.contact_force": lambda force: force.put(400, -1e-9)}, stability.PUSHED),
    ({"impulse": lambda j: -j}, stability.PUSHED),
    ({"impulse": lambda j: j * (1 + 1e-8)}, stability.BALANCED),
    ({"momentum_error": lambda _: 2e-9}, stability.BALANCED),
    ({"momentum_error": lambda _: math.nan}, stability.BALANCED),
    ({"trace.tool_position": lambda place: place.put(3, math.nan)}, stability.FINITE),
    ({"peak_force": lambda _: math.inf}, stability.FINITE),
])  # fmt: skip
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_row_of_a_planted_fault_breaks_its_promise(fault, promise, coupling):
    row = checks.row_of(approach_of(COUPLINGS[coupling], e=1.0), planted(**fault))
    assert promise.text in promises_broken(row)


def test_check_finds_an_object_slowed_between_two_contacts():
    outcome = ig.simulate(*approach_of(ig.SpringDamper(150.0), e=1.0))
    first, second, *rest = outcome.contacts
    slowed = first, second._replace(object_velocity=first.object_velocity - 1e-6), *rest
    assert checks.checked(approach_of().scene, outcome._replace(contacts=slowed))["pull"] > stability.PULL


def test_failures_name_runs_that_stop_hang_or_do_not_settle():
    row = checks.row_of(approach_of(ig.SpringDamper(150.0))) | {"milliseconds": 1.0}
    for name, value, promise in (("milliseconds", 50.1, stability.FAST), *(
        ("finer_change", change, stability.SETTLED) for change in (2e-6, math.nan, None))):  # fmt: skip
        assert {*stability.failures(frame_of(row | {name: value}))["promise"]} == {promise.text}
    for_ever = scene(1e12, 1.0, distance=1e-7)  # bounces of 0.2 ms
    stopped = checks.row_of(approaches.Approach(for_ever, ig.Trapezoid(2000.0, 20.0), 20.0)) | {"milliseconds": 1.0}
    hung = approaches.random_approach(3).about | {"failure": "no answer within 120 s"}
    broken = stability.failures(frame_of(row, stopped, hung))
    assert [row[:2] for row in broken.select("scene", "promise").rows()] == [(k, stability.ENDED.text) for k in (1, 2)]


def test_agreement_finds_differences_and_counts_the_unknown():
    ours, (truth,) = frame_of(checks.row_of(approaches.random_approach(5))), checks.truth_row(5)
    elsewhere, passed = {"velocity": truth["velocity"] * (1 + 3e-6)}, {"passes": truth["passes"] + 1}
    for change, apart in (({}, [False]), (elsewhere, [True]), (passed, [True]), ({"failure": "no answer"}, [])):
        found = stability.agreement(ours, frame_of(truth | change))
        assert found["apart"].to_list() == apart
        assert stability.AGREES.finding(found)["kept"] == ("yes" if apart == [False] else "no")
