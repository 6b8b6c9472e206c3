"""Designs: laws of pads and of a tool in flight, searches that go on, and one line for whatever cannot be searched."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import impact_gym as ig
from agents.baselines import BlindProfile, ConstantSpeed
from agents.baselines.tuned import read_tuned
from agents.design import __main__ as command
from agents.design.__main__ import DesignOptions
from agents.design.free import as_built, designed, read
from agents.design.limits import Limits, Travel
from agents.design.pads import PADS, on_pad, pad_of
from agents.design.search import play_one
from agents.evaluate import TUNING_SEED, Stage
from agents.setups import load_setup
from impact_gym.envs.task import Task

STIFFNESS, SPRING = "coupling.stiffness=20:200", ("coupling.stiffness=20:200", "coupling.damping_ratio=0.2:2")
PROFILE = list(read_tuned("blind-profile")["weights"]["2"]["parameters"].values())


@pytest.fixture
def small(tmp_path):
    """A search that takes seconds and finds little."""
    few = {"scenarios": 12, "budget": 24, "population": 8, "seeds": 1, "processes": 0, "against": ()}
    return DesignOptions("linear-blind", SPRING, tmp_path / "out", times=(1.0, 1.3), **few)


@pytest.mark.parametrize(("setup", "free", "said"), [
    ("linear-blind", (), "--free must name a number"),
    ("linear-blind", ("coupling.stifness=1:2",), "did you mean 'coupling.stiffness'"),
    ("linear-blind", ("object_mass=1:2",), "unknown key --free object_mass"),
    ("linear-blind", ("coupling.height=0.01:0.02",), "has a SpringDamper coupling, whose design is tool_mass, coup"),
    ("rigid-blind", (STIFFNESS,), "has a Rigid coupling, whose design is tool_mass"),
    ("linear-blind", ("coupling.stiffness=300:10",), "LOW below HIGH, got 300:10"),
    ("linear-blind", ("coupling.stiffness=10:10",), "LOW below HIGH, got 10:10"),
    ("linear-blind", ("coupling.stiffness=",), "must be NAME=LOW:HIGH"),
    ("linear-blind", ("coupling.stiffness=:",), "must be NAME=LOW:HIGH"),
    ("linear-blind", ("coupling.stiffness",), "must be NAME=LOW:HIGH"),
    ("linear-blind", ("coupling.stiffness=10:inf",), "must be finite"),
    ("linear-blind", (STIFFNESS, STIFFNESS), "coupling.stiffness is named twice"),
    ("linear-blind", ("coupling.stiffness=-5:10",), "SpringDamper.stiffness must be finite and above 0"),
    ("linear-blind", ("coupling.stiffness=0.5:2",), "no design in these ranges holds the tool within 50 mm"),
    ("bistable-blind", ("coupling.stiffness=10:50",), "its front stop holds"),
    ("bistable-blind", ("coupling.height=0.01:0.08",), "height must be below"),
], ids=str)  # fmt: skip
def test_what_cannot_be_searched_is_refused_before_anything_is_played(setup, free, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        DesignOptions(setup, free, tmp_path).study()


@pytest.mark.parametrize(("changes", "said"), [
    ({"pad": "felt"}, "unknown key --pad felt"),
    ({"times": ()}, "times must name an approach time"),
    ({"times": (0.0,)}, "times must be finite and above 0"),
    ({"deflection": 0.0}, "deflection must be finite and above 0"),
    ({"touched_once": 1.5}, "touched_once must be finite and above 0 and at most 1"),
    ({"tolerance": -0.1}, "tolerance must be finite and at least 0"),
    ({"population": 2}, "population must be a whole number of at least 4"),
    ({"against": ("nobody",)}, "no set-up 'nobody'"),
], ids=str)  # fmt: skip
def test_a_setting_out_of_range_is_named(changes, said, small):
    with pytest.raises(ValueError, match=said):
        replace(small, **changes).study()


def test_the_command_line_says_what_is_wrong_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(
        sys, "argv", ["design", "linear-blind", "--free", "coupling.stiffness=9:1", "--out", str(tmp_path)]
    )
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert str(ended.value).startswith("agents.design: --free coupling.stiffness must have LOW below HIGH")
    assert "\n" not in str(ended.value)


@pytest.mark.parametrize("name", PADS)
def test_a_pad_and_an_object_share_a_force_and_their_penetrations_add_up(name):
    pad = pad_of(name)
    for stiffness in (1e3, 1e5, 1e7):
        together, _ = on_pad(name, stiffness, 0.5)
        for force in (0.1, 10.0):
            penetration = brentq(lambda x, k=together, f=force: k * x**1.5 - f, 0.0, 1.0, xtol=1e-16)
            assert penetration == pytest.approx((force / pad.stiffness) ** (2 / 3) + (force / stiffness) ** (2 / 3))


@pytest.mark.parametrize("name", PADS)
def test_what_a_contact_with_a_pad_loses_is_what_its_two_halves_lose_of_what_they_store(name):
    pad, stiffness, restitution, force = pad_of(name), 3e4, 0.8, 5.0
    stored = np.array([0.4 * force * (force / k) ** (2 / 3) for k in (pad.stiffness, stiffness)])
    lost = stored @ [1.0 - pad.restitution**2, 1.0 - restitution**2]
    _, together = on_pad(name, stiffness, restitution)
    assert (1.0 - together**2) * stored.sum() == pytest.approx(lost)


@pytest.mark.parametrize("name", PADS)
def test_a_pad_is_a_dome_of_a_material_of_the_table_no_less_bouncy_than_the_table_has_it(name):
    pad, material = pad_of(name), ig.MATERIALS[name]
    edges = [4 / 3 * E / (1 - nu**2) * pad.radius**0.5 for E in material.young for nu in material.poisson]
    assert min(edges) * (1 - 1e-12) <= pad.stiffness <= max(edges) * (1 + 1e-12)
    assert pad.restitution == max(material.restitution)


def test_a_pad_may_be_pressed_in_by_half_its_radius_in_all_but_a_twentieth_of_the_episodes():
    stage = Stage(TUNING_SEED, 40, threads=1)
    played, pad = stage.play(BlindProfile(PROFILE)), pad_of("norbornene")
    peak = np.quantile(played.peak_force, 0.95)
    soft = pad._replace(young=pad.young * peak / (pad.stiffness * (0.6 * pad.radius) ** 1.5))
    assert soft.pressed(peak) == pytest.approx(0.6 * pad.radius)
    none, travel = Limits(deflection=None), Travel(40)
    assert none.excess(played, travel, np.zeros(1), soft) == pytest.approx(0.2)
    assert none.excess(played, travel, np.zeros(1), soft._replace(young=10.0 * soft.young)) == 0.0


def test_a_pad_does_nothing_to_a_far_softer_object_and_stands_for_a_far_stiffer_one():
    pad = pad_of("norbornene")
    assert on_pad("norbornene", 1e-6, 0.7) == pytest.approx((1e-6, 0.7), rel=1e-5)
    assert on_pad("norbornene", 1e18, 0.7) == pytest.approx((pad.stiffness, pad.restitution), rel=1e-5)


@pytest.mark.parametrize(("stiffness", "damping_ratio"), [(300.0, 0.2), (120.0, 0.0), (80.0, 1.0)])
def test_the_deflection_in_flight_is_that_of_a_spring_and_damper_set_going_evenly(stiffness, damping_ratio):
    """It swings over m a / k by exp(-pi zeta / sqrt(1 - zeta^2)), given half a period of its own."""
    coupling = {"type": "SpringDamper", "stiffness": stiffness, "damping_ratio": damping_ratio}
    environment = {"coupling": coupling, "scenario": {"distance": 0.5}, "acceleration_range": [1.0, 5.0]}
    travel = Travel(4)
    rule = ConstantSpeed(1.5, 5.0).for_environment(environment)
    Stage(TUNING_SEED, 4, threads=1, **environment).play(rule, watch=travel)
    over = np.exp(-np.pi * damping_ratio / np.sqrt(1.0 - damping_ratio**2)) if damping_ratio < 1.0 else 0.0
    assert travel.deflection == pytest.approx(0.125 * 5.0 / stiffness * (1.0 + over), rel=0.01)
    assert (travel.stroke >= travel.deflection).all()


def test_rows_that_are_given_a_design_are_played_as_a_set_up_with_that_design():
    ranges = {"coupling": {"type": "SpringDamper", "stiffness": [10.0, 300.0], "damping_ratio": [0.1, 2.0]}}
    designs = {"coupling.stiffness": np.array([40.0, 150.0]), "coupling.damping_ratio": np.array([1.5, 0.3])}
    stage = Stage(TUNING_SEED, 10, copies=2, threads=1, **ranges)
    together = stage.play(BlindProfile(PROFILE), {name: np.repeat(values, 10) for name, values in designs.items()})
    for copy in range(2):
        alone = designed({}, {name: float(values[copy]) for name, values in designs.items()})
        played = Stage(TUNING_SEED, 10, threads=1, **alone).play(BlindProfile(PROFILE))
        assert np.array_equal(together.object_velocity[10 * copy : 10 * copy + 10], played.object_velocity)


def test_numbers_that_are_a_coupling_only_together_are_put_in_together():
    before = load_setup("bistable-blind").environment
    made = designed(before, {"coupling.height": 0.06, "coupling.rear_stop": -0.03, "tool_mass": 0.1})
    assert made["coupling"] == before["coupling"] | {"height": 0.06, "rear_stop": -0.03} | {
        "free_length": 0.07, "stop_stiffness": 1e5, "stop_damping_ratio": 1.0
    }  # fmt: skip
    assert made["tool_mass"] == 0.1
    drawn = designed({"coupling": {"type": "SpringDamper", "stiffness": [40, 60]}}, {"coupling.damping_ratio": 0.5})
    assert drawn["coupling"] == {"type": "SpringDamper", "stiffness": [40, 60], "damping_ratio": 0.5}
    with pytest.raises(ValueError, match="rear_stop must be above minus the stroke"):
        Task(**designed(before, {"coupling.height": 0.06}))


def test_a_design_is_played_as_it_may_be_built_each_scenario_with_another():
    design, mine = {"coupling.stiffness": 80.0, "coupling.damping_ratio": 0.4}, ["validation", 60]
    assert as_built({"coupling.rear_stop": -0.02}, 0.05) == {"coupling.rear_stop": pytest.approx([-0.021, -0.019])}
    exact, built = (play_one({}, design, "BlindProfile", PROFILE, "", off, mine) for off in (0.0, 0.05))
    alone = Stage.of(*mine, threads=1, **designed({}, design)).play(BlindProfile(PROFILE))
    assert np.array_equal(exact["object_velocity"], alone.object_velocity)
    changes = built["object_velocity"] / exact["object_velocity"] - 1.0
    assert (changes != 0.0).all()
    assert np.abs(np.median(changes)) < np.abs(changes).max() < 0.5


def test_each_limit_counts_what_exceeds_it_as_a_share_of_it():
    stage = Stage(TUNING_SEED, 40, threads=1)
    travel = Travel(40)
    played = stage.play(BlindProfile(PROFILE), watch=travel)
    release, none = np.array([2.0]), Limits(deflection=None)
    found = {
        "deflection": travel.deflection.max(),
        "stroke": travel.stroke.max(),
        "peak_force": np.quantile(played.peak_force, 0.95),
        "energy": np.quantile(0.5 * played.scenario["object_mass"] * played.object_velocity**2, 0.95),
        "release": 2.0,
    }
    assert none.excess(played, travel, release) == 0.0
    for name, value in found.items():
        assert none._replace(**{name: value / 1.5}).excess(played, travel, release) == pytest.approx(0.5)
        assert none._replace(**{name: value * 1.01}).excess(played, travel, release) == 0.0
    twice = (played.contact_count > 1).mean()
    assert 0.0 < twice < 0.5
    assert none._replace(touched_once=1.0 - twice / 2).excess(played, travel, release) == pytest.approx(1.0)
    assert none._replace(touched_once=0.5).excess(played, travel, release) == 0.0


def test_a_number_is_searched_by_ratio_where_that_is_how_it_matters_and_begins_with_what_the_set_up_has():
    for text, begin, logarithmic in (
        ("coupling.stiffness=20:80", 50.0, True),
        ("coupling.damping_ratio=0.5:2", 1.0, False),
        ("coupling.damping_ratio=0.1:2", 1.0, True),
        ("coupling.damping_ratio=0:2", 0.0, False),
        ("coupling.stiffness=100:400", 200.0, True),  # what the set-up has, 50 N/m, is not in it
    ):
        one = read(text)
        assert one.logarithmic is logarithmic
        parameter = one.parameter(50.0 if "stiffness" in text else begin)
        assert one.value(np.array([parameter.low, parameter.start, parameter.high])) == pytest.approx([
            one.low, begin, one.high,
        ])  # fmt: skip
