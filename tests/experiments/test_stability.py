"""The storm covers what it says, its checks find what is planted, and what is on disk is not computed again."""

import math
from contextlib import closing
from functools import partial

import numpy as np
import pytest
from stability_scenes import COUPLINGS, ROBOTS, approach_of, asleep

import impact_gym as ig
from agents.jobs import JobsFailedError
from agents.jobs.store import Store
from experiments.lab import tables
from experiments.lab.results import KEPT
from experiments.lab.tables import gathered, rows_of
from experiments.stability import agreement, checks, promises, scenes, storm
from impact_gym import simulation
from impact_gym.scene import Dissipation


def ranges_of(number):
    """What a scene has of each range of the storm."""
    scene, motion, _ = scenes.draw(number).run
    coupling = scene.coupling
    found = {
        "contact stiffness": scene.contact.stiffness,
        "restitution": scene.contact.restitution,
        "mass ratio": scene.object.mass / scene.tool.mass,
        "speed": motion.speed,
        "coupling stiffness": getattr(coupling, "stiffness", None),
        "damping ratio": getattr(coupling, "damping_ratio", getattr(coupling, "stop_damping_ratio", None)),
        "deceleration": motion.brake.deceleration if motion.brake else None,
    }
    return {name: value for name, value in found.items() if value is not None}


def test_the_storm_fills_its_ranges_to_their_ends():
    drawn = [ranges_of(number) for number in range(1500)]
    for name, (low, high) in scenes.RANGES.items():
        values = np.array([ranges[name] for ranges in drawn if name in ranges])
        assert values.min() == pytest.approx(low, rel=1e-12)
        assert values.max() == pytest.approx(high, rel=1e-12)
        place = values / high if low == 0 else np.log(values / low) / math.log(high / low)
        inside = place[(place > 1e-9) & (place < 1 - 1e-9)]
        assert len(inside) > 400
        assert np.quantile(inside, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.06)


def test_the_storm_has_every_coupling_with_every_robot_and_all_laws():
    drawn = [scenes.draw(number).scene for number in range(900)]
    assert len({scenes.kind(scene) for scene in drawn[:9]}) == 9
    assert {scene.contact.dissipation for scene in drawn} == set(Dissipation.__args__)
    exponents = {(scene.contact.stiffness_exponent, scene.contact.damping_exponent) for scene in drawn}
    assert exponents == set(scenes.EXPONENTS)
    assert 0.15 < np.mean([scenes.draw(number).motion.brake is None for number in range(300)]) < 0.25


def test_a_scene_depends_on_its_number_alone():
    forwards = [scenes.draw(number) for number in range(40)]
    backwards = [scenes.draw(number) for number in reversed(range(40))]
    assert forwards == backwards[::-1]
    assert len({approach.description for approach in forwards}) == 40


def test_jobs_that_hang_die_or_raise_are_rows_and_told_apart(tmp_path):
    def named(arguments):
        return {"scene": arguments["scene"]}

    asked = [{"scene": str(place), "seconds": seconds} for place, seconds in enumerate((0.0, 60.0, -1.0, "1"))]
    rows = gathered(tmp_path, "any", asleep, asked, "", named, processes=2, seconds=1.0)
    assert [row["scene"] for row in rows] == list("0123")
    fine, hung, died, raised = (row["failure"] for row in rows)
    assert fine == ""
    assert hung == "no answer within 1 s"
    assert "its worker was lost 1 time" in died
    assert raised.startswith("TypeError")
    assert math.isnan(rows[1]["seconds"])  # what is not known is not a number
    with pytest.raises(JobsFailedError, match="no answer within 1 s"):
        gathered(tmp_path, "any", asleep, asked[1:2], "", processes=1, seconds=1.0)


def promises_broken(row):
    return {failure["contender"] for failure in promises.failures(row)}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("e", [0.3, 1.0])
def test_a_sound_run_breaks_no_promise(coupling, robot, e):
    approach = approach_of(COUPLINGS[coupling], ROBOTS[robot], e=e)
    row = storm.row_of(approach)
    assert row["contacts"] > 0
    assert row["traced"]
    assert promises_broken(row | {"milliseconds": 1.0}) == set()  # how fast is for the storm to say
    assert row["energy_doubt"] < 1e-3
    if e == 1.0:
        # nothing dissipates: what has gone in has come out again, but for a contact under way at the end
        outcome = ig.simulate(*approach.run)
        if outcome.contacts[-1].end is not None:
            assert abs(row["energy_created"]) < 1e-6 + row["energy_doubt"]


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_an_isolated_contact_loses_what_its_restitution_says(e):
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


def at(place, value):
    def put(column):
        column[place] = value

    return put


@pytest.mark.parametrize(
    ("fault", "promise"),
    [
        ({"separation_velocity": lambda v: 1.01 * v}, promises.PASSIVE),
        ({"trace.contact_force": at(400, -1e-9)}, promises.PUSHED),
        ({"impulse": lambda j: -j}, promises.PUSHED),
        ({"trace.object_velocity": at(slice(-30, None), 0.0)}, promises.RISING),
        ({"impulse": lambda j: j * (1 + 1e-8)}, promises.BALANCED),
        ({"momentum_error": lambda _: 2e-9}, promises.BALANCED),
        ({"momentum_error": lambda _: math.nan}, promises.BALANCED),
        ({"trace.tool_position": at(3, math.nan)}, promises.FINITE),
        ({"peak_force": lambda _: math.inf}, promises.FINITE),
    ],
)
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_a_planted_fault_is_found(fault, promise, coupling):
    row = storm.row_of(approach_of(COUPLINGS[coupling], e=1.0), planted(**fault))
    assert promise in promises_broken(row)


def test_an_object_that_is_slowed_between_two_contacts_is_found():
    outcome = ig.simulate(*approach_of(ig.SpringDamper(150.0), e=1.0).run)
    assert len(outcome.contacts) > 1
    assert checks.examine(approach_of().scene, outcome).pull <= 0.0
    first, second, *rest = outcome.contacts
    slowed = second._replace(object_velocity=first.object_velocity - 1e-6)
    found = checks.examine(approach_of().scene, outcome._replace(contacts=(first, slowed, *rest)))
    assert found.pull > promises.PULL


def test_a_run_that_cannot_finish_takes_too_long_or_is_not_settled_is_found(monkeypatch):
    approach = approach_of(ig.SpringDamper(150.0))
    row = storm.row_of(approach)
    assert promises_broken(row | {"milliseconds": 50.1}) == {promises.FAST}
    unsettled = row | {"milliseconds": 1.0, "finer_change": 2e-6}
    assert promises_broken(unsettled) == {promises.SETTLED}
    assert promises_broken(unsettled | {"finer_change": math.nan}) == {promises.SETTLED}
    monkeypatch.setattr(simulation, "MAX_STEPS", 10)
    stopped = storm.row_of(approach)
    assert promises_broken(stopped | {"milliseconds": 1.0}) == {promises.FINISHED}
    assert "integration steps" in promises.failures(stopped)[0]["failure"]
    hung = storm.blank(scenes.draw(3)) | {"failure": "no answer within 120 s"}
    assert promises_broken(hung) == {promises.FINISHED}


def test_a_disagreement_is_found_and_what_is_not_known_is_counted():
    number = 17
    (true,) = rows_of(agreement.truth(number, agreement.order(scenes.draw(number))[0]))
    assert true["failure"] == ""
    (same,) = rows_of(agreement.compared(number, true))
    assert promises.disagreement(same) == ""
    (apart,) = rows_of(agreement.compared(number, true | {"velocity": true["velocity"] * (1 + 3e-6)}))
    assert "3.0e-06" in promises.disagreement(apart)
    assert apart["spread"] < 1e-9 * abs(apart["velocity"])  # the scene is not to blame
    assert promises.disagreement(same | {"passes": same["passes"] + 1})
    kept = promises.over_agreement([same], 1)
    assert kept.met
    assert "1 scenes the independent solver could not do" in kept.found
    assert not promises.over_agreement([same, apart], 0).met
    assert not promises.over_agreement([], 0).met


def test_an_interrupted_storm_goes_on_where_it_stopped_and_other_sources_start_anew(tmp_path, monkeypatch):
    done, gather = [], partial(gathered, tmp_path, processes=0)

    def row_of(approach):
        done.append(approach.name)
        if done.count("4") == 1 and approach.name == "4":
            raise KeyboardInterrupt
        return storm.blank(approach) | {"failure": "not run"}

    monkeypatch.setattr(storm, "row_of", row_of)
    with pytest.raises(KeyboardInterrupt):
        storm.rows(gather, 8)
    assert done == list("01234")
    with closing(Store(tmp_path / KEPT)) as store:
        assert len(store) == 4
    for _ in range(2):
        rows = storm.rows(gather, 8)
        assert [row["scene"] for row in rows] == list("01234567")
        assert {row["failure"] for row in rows} == {"not run"}
        assert done == list("012344567")
    assert len(storm.rows(gather, 5)) == 5
    monkeypatch.setattr(storm, "solver_and", lambda *modules: "other")
    assert len(storm.rows(gather, 8)) == 8
    assert done == list("01234456701234567")


def test_what_a_row_depends_on_is_the_solver_as_it_is_compiled_and_who_judges_it(monkeypatch):
    solver_and = tables.solver_and.__wrapped__  # not what it said before
    judged = solver_and("experiments.stability.checks")
    assert judged != solver_and("experiments.stability.storm")
    assert judged == solver_and("experiments.stability.checks")
    monkeypatch.setattr(tables, "COMPILED_FROM", "another solver")
    assert judged != solver_and("experiments.stability.checks")


def test_a_promise_with_no_failure_is_kept():
    rows = [storm.row_of(approach_of(coupling)) for coupling in COUPLINGS.values()]
    kept = promises.over_storm(rows, [])
    assert [promise.text for promise in kept] == list(promises.PROMISES)
    assert all(promise.met for promise in kept)
    broken = promises.failures(rows[0] | {"finite": 0})
    (missed,) = (promise for promise in promises.over_storm(rows, broken) if not promise.met)
    assert missed.text == promises.FINITE
    assert "1 of 3 scenes" in missed.found
