"""The storm covers what it says, its checks find what is planted, rivals are judged as said, and the page tells it."""

import math
from functools import partial

import numpy as np
import polars as pl
import pytest
from impact_gym.kernels import COMPILED_FROM
from pages import text_of_a_page_that_stands_on_its_own
from scenes import COUPLINGS, MOTION, ROBOTS, scene

import impact_gym as ig
from agents.jobs import JobsFailedError
from experiments.lab import experiment
from experiments.lab.tables import gathered, solver_and
from experiments.solver import approaches, promises, solutions, storm, timing
from experiments.solver.approaches import Approach
from experiments.solver.solutions import OURS
from experiments.solver.stability import __main__ as study
from impact_gym.scene import Dissipation

FEW = 27  # scenes: every coupling with every robot, three times
EXTENT = study.Extent(10.0, 2, [(OURS, 1e-8), ("solve_ivp LSODA", 1e-6), ("RK4", 1e-4)])


def approach_of(coupling=None, robot=None, e=0.5, motion=MOTION):
    return Approach("7", "planted", scene(1e5, e, coupling, robot), motion, 0.8)


def ranges_of(number):
    """What a scene has of each range of the storm."""
    scene, motion, _ = approaches.storm(number).run
    coupling = scene.coupling
    values = {
        "contact stiffness": scene.contact.stiffness,
        "restitution": scene.contact.restitution,
        "mass ratio": scene.object.mass / scene.tool.mass,
        "speed": motion.speed,
        "coupling stiffness": getattr(coupling, "stiffness", None),
        "damping ratio": getattr(coupling, "damping_ratio", getattr(coupling, "stop_damping_ratio", None)),
        "deceleration": motion.brake.deceleration if motion.brake else None,
    }
    return {name: value for name, value in values.items() if value is not None}


def test_storm_fills_its_ranges_to_their_ends():
    drawn = [ranges_of(number) for number in range(1500)]
    for name, (low, high) in approaches.RANGES.items():
        values = np.array([ranges[name] for ranges in drawn if name in ranges])
        assert values.min() == pytest.approx(low, rel=1e-12)
        assert values.max() == pytest.approx(high, rel=1e-12)
        place = values / high if low == 0 else np.log(values / low) / math.log(high / low)
        inside = place[(place > 1e-9) & (place < 1 - 1e-9)]
        assert len(inside) > 400
        assert np.quantile(inside, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.06)


def test_storm_has_every_coupling_with_every_robot_all_laws_and_depends_on_its_number_alone():
    drawn = [approaches.storm(number) for number in range(900)]
    assert len({approaches.kind(approach.scene) for approach in drawn[:9]}) == 9
    contacts = [approach.scene.contact for approach in drawn]
    assert {contact.dissipation for contact in contacts} == set(Dissipation.__args__)
    rough = {approach.scene.object.friction is not None for approach in drawn}
    ended = {getattr(approach.scene.coupling, "stroke", None) is not None for approach in drawn}
    assert rough == ended == {False, True}
    exponents = {(contact.stiffness_exponent, contact.damping_exponent) for contact in contacts}
    assert exponents == set(approaches.EXPONENTS)
    assert 0.15 < np.mean([approach.motion.brake is None for approach in drawn]) < 0.25
    assert [approaches.storm(number) for number in reversed(range(40))] == drawn[39::-1]
    assert len({approach.description for approach in drawn}) == 900


def promises_broken(row):
    return {failure["contender"] for failure in promises.failures(row)}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("e", [0.3, 1.0])
def test_row_of_a_sound_run_breaks_no_promise(coupling, robot, e):
    approach = approach_of(COUPLINGS[coupling], ROBOTS[robot], e)
    row = storm.row_of(approach)
    assert row["contacts"] > 0
    assert row["traced"]
    assert promises_broken(row | {"milliseconds": 1.0}) == set()  # how fast is for the storm to say
    assert row["energy_doubt"] < 1e-3
    if e == 1.0 and ig.simulate(*approach.run).contacts[-1].end is not None:
        # nothing dissipates: what has gone in has come out again, but for a contact under way at the end
        assert abs(row["energy_created"]) < 1e-6 + row["energy_doubt"]


@pytest.mark.parametrize("number", [882, 2628, 1177, 1678, 1845, 2197])
def test_row_of_an_object_that_is_pushed_on_or_sticks_breaks_no_promise(number):
    """The first two are pushed on until the brake has ended, the others come to stick under the tool."""
    approach = approaches.storm(number)
    assert approach.scene.object.friction
    assert promises_broken(storm.row_of(approach) | {"milliseconds": 1.0}) == set()


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_row_of_an_isolated_contact_has_lost_what_its_restitution_says(e):
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
def test_row_of_a_planted_fault_breaks_its_promise(fault, promise, coupling):
    row = storm.row_of(approach_of(COUPLINGS[coupling], e=1.0), planted(**fault))
    assert promise.text in promises_broken(row)


def test_checked_finds_an_object_that_is_slowed_between_two_contacts():
    outcome = ig.simulate(*approach_of(ig.SpringDamper(150.0), e=1.0).run)
    first, second, *rest = outcome.contacts
    assert storm.checked(approach_of().scene, outcome)["pull"] <= 0.0
    slowed = second._replace(object_velocity=first.object_velocity - 1e-6)
    wrong = outcome._replace(contacts=(first, slowed, *rest))
    assert storm.checked(approach_of().scene, wrong)["pull"] > promises.PULL


def test_failures_name_a_run_that_cannot_finish_takes_too_long_or_is_not_settled():
    row = storm.row_of(approach_of(ig.SpringDamper(150.0)))
    assert promises_broken(row | {"milliseconds": 50.1}) == {promises.FAST.text}
    for change in (2e-6, math.nan):
        assert promises_broken(row | {"milliseconds": 1.0, "finer_change": change}) == {promises.SETTLED.text}
    for_ever = scene(1e12, 1.0, distance=1e-7)  # bounces of 0.2 ms
    stopped = storm.row_of(Approach("7", "", for_ever, ig.Trapezoid(2000.0, 20.0), 20.0))
    assert promises_broken(stopped | {"milliseconds": 1.0}) == {promises.FINISHED.text}
    assert "integration steps" in promises.failures(stopped)[0]["failure"]
    hung = storm.blank(approaches.storm(3)) | {"failure": "no answer within 120 s"}
    assert promises_broken(hung) == {promises.FINISHED.text}


def test_over_storm_says_which_promise_is_missed_by_how_many():
    rows = [storm.row_of(approach_of(coupling)) for coupling in COUPLINGS.values()]
    kept = promises.over_storm(rows, [])
    assert [verdict.text for verdict in kept] == [promise.text for promise in promises.PROMISES]
    assert all(verdict.met for verdict in kept)
    broken = promises.failures(rows[0] | {"finite": 0})
    (missed,) = (verdict for verdict in promises.over_storm(rows, broken) if not verdict.met)
    assert missed.text == promises.FINITE.text
    assert "1 of 3 scenes" in missed.finding


def test_disagreement_finds_a_difference_and_over_agreement_counts_what_is_not_known(tmp_path):
    number = 17
    truths = solutions.storm_truths(partial(gathered, tmp_path, processes=0), [number], seconds=60.0)
    ours = {number: storm.row_of(approaches.storm(number))}
    (same,) = promises.agreement(ours, truths)
    assert promises.disagreement(same) == ""
    elsewhere = truths[number] | {"velocity": truths[number]["velocity"] * (1 + 3e-6)}
    (apart,) = promises.agreement(ours, {number: elsewhere})
    assert "3.0e-06" in promises.disagreement(apart)
    assert promises.disagreement(same | {"passes": same["passes"] + 1})
    assert promises.agreement(ours, {number: elsewhere | {"failure": "no answer"}}) == []
    kept = promises.over_agreement([same], 1)
    assert kept.met
    assert "1 scenes the independent solver could not do" in kept.finding
    assert not promises.over_agreement([same, apart], 0).met
    assert not promises.over_agreement([], 0).met


def test_gathered_makes_a_row_of_a_job_that_fails(tmp_path):
    asked = [{"approach": 2, "contender": method, "rtol": 1e-6} for method in ("DOP853", "Euler")]
    gather = partial(gathered, tmp_path, "any", solutions.true_row, depends="", processes=0)
    fine, failed = gather(asked=asked, failed=solutions.known)
    assert (fine["failure"], failed["scene"], failed["contender"]) == ("", "2", "Euler")
    assert failed["failure"].startswith("ValueError: method must be one of")
    assert math.isnan(failed["velocity"])  # what is not known is not a number
    with pytest.raises(JobsFailedError, match="method must be one of"):
        gather(asked=asked[1:])


def test_solver_and_is_the_solver_as_it_is_compiled_and_who_judges_it():
    judged, otherwise = solver_and("experiments.solver.storm"), solver_and("experiments.solver.promises")
    assert judged.startswith(COMPILED_FROM)
    assert otherwise.startswith(COMPILED_FROM)
    assert judged != otherwise


def test_shares_are_those_of_each_class_and_of_missed_contacts():
    of = {"contender": OURS, "setting": 1e-8, "true_contacts": 2.0, "microseconds": 1e6}
    kinds = (("", 2), (solutions.WRONG, 1), (solutions.LATE, math.nan), ("", 2), ("gave up: it did", math.nan))
    rows = [of | {"failure": kind, "contacts": contacts} for kind, contacts in kinds]
    (line,) = timing.shares(rows)
    assert sum(line[kind] for kind in solutions.CLASSES) == pytest.approx(1.0)
    assert (line[solutions.GOOD], line[solutions.GAVE_UP], line["missed"], line["seconds"]) == (0.4, 0.2, 0.2, 1.0)
    nothing = dict.fromkeys(("contacts", "microseconds"), math.nan)
    (hung,) = timing.shares([of | nothing | {"contender": "RK4", "failure": "no answer within 60 s"}])
    assert hung["contender"] == "RK4, 1e-8 s"
    assert (hung[solutions.LATE], hung["missed"], hung["seconds"]) == (1.0, 0.0, math.inf)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The folder of a study, and its tables."""
    folder = tmp_path_factory.mktemp("study") / "stability"
    tables = study.tables(FEW, EXTENT, partial(gathered, folder, processes=0))
    experiment.run("solver/stability", folder, "first", lambda _: tables, study.shown, processes=0)
    return folder, tables


def read(path):
    return pl.read_csv(path, infer_schema=False).to_dicts()


def test_page_stands_on_its_own_with_a_row_for_each_scene_and_shares_of_the_rivals(quick):
    folder, tables = quick
    assert [int(row["scene"]) for row in read(folder / "storm.csv")] == list(range(FEW))
    text = text_of_a_page_that_stands_on_its_own(folder, figures=2)
    assert all(promise.text in text for promise in promises.PROMISES)
    shares = {line["contender"]: line[solutions.GOOD] for line in timing.shares(tables["rivals"])}
    assert shares.keys() == {OURS, "solve_ivp LSODA", "RK4, 0.0001 s"}
    assert shares[OURS] == 1.0


def test_page_lists_every_failure(quick, tmp_path):
    rows = [dict(row) for row in quick[1]["storm"]]
    rows[3] |= {"milliseconds": 77.0}
    rows[5] |= {"failure": "RuntimeError: the run stopped", "object_velocity": math.nan}
    rows[8] |= {"energy_created": 1e-3, "energy_doubt": 1e-9, "traced": 1}
    wrong = quick[1] | {"storm": rows, "failures": [failure for row in rows for failure in promises.failures(row)]}
    (tmp_path / "storm.svg").touch()
    (tmp_path / "rivals.svg").touch()
    text = experiment.write("solver/stability", tmp_path, wrong, {}, study.shown(wrong)[1], []).read_text()
    listed = {(row["scene"], row["contender"]) for row in read(tmp_path / "failures.csv")}
    assert {("3", promises.FAST.text), ("5", promises.FINISHED.text), ("8", promises.PASSIVE.text)} <= listed
    assert "RuntimeError: the run stopped" in text
    assert "promises are missed" in text
    assert text.count('class="missed"') >= 3
