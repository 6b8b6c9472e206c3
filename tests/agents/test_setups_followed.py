"""From a set-up to a controller and its report: what is told of it beforehand is true, and what is left is its own."""

import json
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from policies import made_up_policy

import impact_gym as ig
from agents import load_policy, setup
from agents.controller import ControllerOptions, copy_setup, stages
from agents.setups import feasible, load_setup
from agents.train.run import resume, train
from agents.train.settings import default_settings
from agents.train_seeds import Seeds, train_all
from experiments.report import matchups
from experiments.report.__main__ import ReportOptions, matchups_of
from impact_gym.envs.task import Task


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def far_flight(task, acceleration, duration):
    """Trace of a chain that only accelerates."""
    tool, struck, contact = ig.Tool(task.tool_mass), ig.Object(1.0, 1e6), ig.Contact(1e4, 0.5)
    one = ig.Scene(tool, struck, contact, task.coupling, task.robot)
    return ig.simulate(one, ig.Trapezoid(1e3, acceleration), duration, trace=True).trace


@pytest.mark.parametrize("robot", [None, ig.Robot(5.0, 3e3, 200.0)])
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(200.0, 1.0)])
def test_the_lag_is_that_of_a_long_run_at_full_acceleration(coupling, robot):
    task = Task(tool_mass=0.3, coupling=coupling, robot=robot)
    trace = far_flight(task, 20.0, 5.0)
    behind = trace.command_position[-1] - trace.tool_position[-1]
    assert setup.lag(task) == pytest.approx(behind, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_mechanism_leaves_its_stop_above_what_it_holds(share):
    task = Task(coupling=ig.Bistable())
    trace = far_flight(task, share * feasible.held(task), 2.0)
    behind = np.abs(trace.command_position - trace.tool_position).max()
    assert (behind > 0.01) == (share > 1.0)


@pytest.mark.parametrize("robot", [None, ig.Robot(2.0, 1e3, 5.0)])
@pytest.mark.parametrize("coupling", [ig.Rigid(), ig.SpringDamper(50.0, 1.0)])
def test_the_estimate_is_the_impact_of_a_hard_contact(coupling, robot):
    task = Task(coupling=coupling, robot=robot)
    scenario = {"object_mass": 0.4, "restitution": 0.6, "distance": 0.3}
    scene = ig.Scene(ig.Tool(task.tool_mass), ig.Object(0.4, 0.3), ig.Contact(1e12, 0.6, "exact"), coupling, robot)
    first = ig.simulate(scene, ig.Trapezoid(1.0, 8.0), 1.0).contacts[0]
    speed = first.approach_velocity if isinstance(coupling, ig.SpringDamper) or robot else 1.0
    assert setup.estimate(task, scenario) * speed == pytest.approx(first.object_velocity, rel=1e-3)


@pytest.mark.parametrize("restitution", [1.0, 0.3])
def test_an_object_is_counted_as_never_pressing_loose_a_tool_if_its_peak_force_is_below_what_holds_it(restitution):
    """The peak is that of a simulated contact with a rigid tool."""
    masses = np.array([0.1, 0.3, 1.0, 2.5])
    peaks = []
    for mass in masses:
        scene = ig.Scene(ig.Tool(0.125), ig.Object(mass, 0.3), ig.Contact(1e4, restitution), ig.Rigid())
        peaks.append(ig.simulate(scene, ig.Trapezoid(setup.SLOW, 8.0), 2.0).contacts[0].peak_force)
    assert np.all(np.diff(peaks) > 0.0)
    scenario = {"object_mass": masses, "contact_stiffness": np.full(4, 1e4), "restitution": np.full(4, restitution)}
    for count, force in enumerate([0.999 * peaks[0], *(1.001 * np.array(peaks))]):
        stiffness = 50.0 * force / float(ig.Bistable().force(ig.Bistable().rest))
        task = Task(coupling=ig.Bistable(stiffness, stop_stiffness=2e3 * stiffness))
        assert setup.rigid_to(task, scenario) == pytest.approx((force, count / 4), rel=1e-9)


def test_what_follows_is_said(mine):
    lags = [setup.lag(one) for one in feasible.corners(Task(**load_setup(mine).environment))]
    assert len(lags) == 8
    hand = [4.0 * m / k + 4.0 * (8.0 + m) / k_r for m in (0.3, 0.5) for k in (200, 400) for k_r in (5e4, 2e5)]
    assert sorted(lags) == pytest.approx(sorted(hand), rel=1e-12)
    said = "\n".join(setup.lines(load_setup(mine), str(mine)))
    drawn = "robot.stiffness: 50000 to 200000 N/m, log-uniform"
    assert all(part in said for part in (drawn, "agents.train", "mine-profile", "distance estimate"))
    assert "warning" not in said
    held = "the front stop holds the tool up to 8.38"
    assert held in "\n".join(setup.lines(load_setup("bistable-paper"), "bistable-paper"))


def test_without_pygame_all_but_the_picture_is_there(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "pygame", None)
    monkeypatch.setattr(sys, "argv", ["setup", "linear-blind", "--picture", str(tmp_path / "picture.png")])
    setup.main()
    assert capsys.readouterr().out.splitlines()[-1].startswith("no picture: rendering needs pygame")


def test_a_folder_keeps_its_set_up_and_takes_no_other(mine, tmp_path):
    out = tmp_path / "out"
    copy = copy_setup(load_setup(mine), out)
    assert copy.read_bytes() == mine.read_bytes()
    assert copy_setup(load_setup(mine), out) == copy
    change(mine, "A slow arm", "A slower arm")
    assert "slower" in copy_setup(load_setup(mine), out).read_text()
    with pytest.raises(ValueError, match="holds the whole: name another folder"):
        copy_setup(load_setup(mine), out, quick=True)
    change(mine, "0.7", "0.8")
    with pytest.raises(ValueError, match=r"mine\.toml as it was.*name another folder"):
        copy_setup(load_setup(mine), out)
    with pytest.raises(ValueError, match=r"holds something else \(mine\.toml\)"):
        copy_setup(load_setup("linear-blind"), out)
    assert "0.7" in copy.read_text()
    with pytest.raises(ValueError, match="is no folder"):
        copy_setup(load_setup(mine), mine)


def test_a_quick_run_takes_no_more_than_the_set_up_says(mine, tmp_path):
    tune, seeds, report, export = stages(mine, ControllerOptions(str(mine), tmp_path / "out", quick=True))
    assert tune[tune.index("--budget") + 1] == "16"
    assert seeds[seeds.index("--seeds") + 1] == "2"
    assert report[report.index("--folder") + 1] == str(tmp_path / "out")
    assert export[2] == str(tmp_path / "out" / "policies" / "mine.npz")


@pytest.mark.storm
def test_one_command_goes_from_a_file_to_a_controller_and_on_where_it_was(mine, tmp_path):
    out = tmp_path / "out"
    policy = out / "policies" / "mine.npz"
    command = [sys.executable, "-m", "agents.controller", str(mine), "--out", str(out), "--quick"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    for path in ("tuned/mine-profile.json", "policies/mine.npz", "report/index.html", "export/mine.h"):
        assert (out / path).is_file(), path
    weights = json.loads((out / "tuned" / "mine-profile.json").read_text())["weights"]
    assert {found["search"]["budget"] for found in weights.values()} == {16}
    assert load_setup(mine).describes(load_policy(policy).environment)
    found = matchups.of_setup(load_setup(out / "mine.toml"), {"set": "test", "count": 30}, out)
    assert found.scenarios["ranges"]["object_mass"] == [0.2, 1.0]
    assert [one.name for one in found.baselines] == ["paper's rule", "mine-profile"]
    first = policy.read_bytes()
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert policy.read_bytes() == first
    assert "training for" not in again.stdout


def test_less_than_a_set_up_wants_is_said(mine, tmp_path):
    there = load_setup(mine)
    contestant = matchups.Contestant(
        next(iter(there.tuned)), {"tuned": {"weights": {"2": {"search": {"budget": 8}}}}}, (2.0,), ""
    )
    assert matchups.quick_look_note(there, {"settings": {"steps": 2000}}, []) == ""
    said = matchups.quick_look_note(there, {"settings": {"steps": 500}}, [contestant])
    assert said == "; A QUICK LOOK, trained for 500 steps of 2,000, baselines tuned with 8 candidates of 16"


@pytest.mark.parametrize(("addition", "message"), [
    ('against = ["mine-profil"]', "unknown key baselines.against.mine-profil; did you mean 'mine-profile'"),
    ('bound = "nonsense"', "unknown key baselines.bound.nonsense"),
], ids=str)  # fmt: skip
def test_what_would_show_hours_later_shows_at_once(mine, addition, message):
    mine.write_text(mine.read_text() + addition)
    with pytest.raises(ValueError, match=rf"mine\.toml: {message}"):
        setup.check(load_setup(mine), str(mine))


def test_two_set_ups_of_one_name_cannot_share_a_report(mine, tmp_path):
    other = tmp_path / "there" / "mine.toml"
    other.parent.mkdir()
    other.write_bytes(mine.read_bytes())
    with pytest.raises(ValueError, match="the same name"):
        matchups_of(ReportOptions(setups=(str(mine), str(other))))


def test_policies_that_were_trained_for_another_arm_are_refused(mine, tmp_path):
    folder = tmp_path / "policies" / "mine"
    made_up_policy(environment={"range_noise": 0.01}).save(folder / "seed-0.npz")
    (folder / "seeds.json").write_text('{"median": 0}')
    with pytest.raises(ValueError, match=r"seed-0\.npz was trained for another environment than .*mine\.toml"):
        matchups.of_setup(load_setup(mine), {"set": "test", "count": 5}, tmp_path)


def test_seeds_of_a_set_up_that_has_changed_are_not_taken_for_its_own(mine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = {"runs": tmp_path / "runs", "policies": tmp_path / "policies"}
    wanted = Seeds(("mine.toml",), seeds=1, steps=512, processes=1, **folders)
    settings = replace(default_settings("mine.toml"), steps=512, validate_every=512)
    assert settings.setup == str(mine)  # from wherever it is gone on with
    shipped_to = train_all("mine", wanted, settings)
    assert load_setup(mine).describes(load_policy(shipped_to).environment)
    change(mine, "damping_ratio = 0.7", "damping_ratio = 0.9")
    with pytest.raises(ValueError, match="for another environment: remove it"):
        train_all("mine", wanted, replace(default_settings("mine.toml"), steps=512, validate_every=512))
    with pytest.raises(ValueError, match="has changed since"):
        resume(tmp_path / "runs" / "mine" / "seed-0")


def reaching(acceleration, speed):
    return {"acceleration_range": (1.0, acceleration), "velocity_range": (-0.1, speed)}


@pytest.mark.parametrize(("acceleration", "speed"), [(20.0, 1.5), (2.0, 0.4), (1.5, 10.0)])
def test_no_arm_gets_farther_before_the_end_than_is_said(acceleration, speed):
    """At full acceleration the flange touches what stands a hair nearer than that, and misses what stands beyond."""
    for share, missed in ((0.999, False), (1.001, True)):
        arm = reaching(acceleration, speed)
        distance = share * feasible.reached(Task(**arm))
        env = gym.make("ImpactApproach-v0", coupling={"type": "Rigid"}, scenario={"distance": distance}, **arm)
        env.reset(seed=0)
        terminated = False
        while not terminated:
            _, _, terminated, _, info = env.step(np.ones(2, np.float32))
        assert info["missed"] == missed


@pytest.mark.parametrize(("environment", "words"), [
    ({"scenario": {"distance": (1.8, 2.0)}}, r"distance must begin below 1\.74 m.*got 1\.8 m: every object would"),
    (reaching(2.0, 0.1), r"distance must begin below 0\.117 m.*got 0\.15 m"),
    ({"coupling": ig.Bistable(5.0), "acceleration_range": (2.0, 20.0)}, r"must hold the tool at 2 m/s\^2.*0\.838"),
], ids=["far", "slow", "loose"])  # fmt: skip
def test_what_can_never_be_done_is_refused_before_it_is_trained(mine, tmp_path, environment, words):
    with pytest.raises(ValueError, match=words):
        feasible.warnings(Task(**environment))
    change(mine, "distance = ", "distance = [9.0, 9.1]  # ")
    with pytest.raises(ValueError, match=r"mine\.toml.*distance must begin below"):
        train(replace(default_settings(str(mine)), out=tmp_path / "run"))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("environment", "words"), [
    ({}, []),
    ({"scenario": {"distance": (0.2, 1.75)}}, ["gets only 1.74 m", "ends at a flange position of 0.75"]),
    ({"scenario": {"distance": (0.01, 0.3)}}, ["from 10 mm on, where the tool can be before the first reading"]),
    ({"coupling": ig.Bistable()}, ["holds the tool up to 8.38 m/s^2, the arm can make 20: above that"]),
    ({"coupling": ig.Bistable(), "acceleration_range": (1.0, 8.0)}, []),
    ({"coupling": ig.Bistable(), "acceleration_range": (1.0, 8.0), "robot": ig.Robot(5.0, 1e5, 50.0)},
     ["the arm can make 8, and a compliant robot swings to 2 times that and more"]),
], ids=str)  # fmt: skip
def test_what_goes_wrong_in_some_episodes_is_said(environment, words):
    said = feasible.warnings(Task(**environment))
    assert len(said) == len(words)
    assert all(part in sentence for part, sentence in zip(words, said, strict=True))


def test_a_compliant_robot_swings_from_rest_as_is_said():
    robot = ig.Robot(5.0, 1e5, 1e-6)
    task = Task(coupling=ig.Rigid(), robot=robot)
    scene = ig.Scene(ig.Tool(0.125), ig.Object(1.0, 1e6), ig.Contact(1e4, 0.5), task.coupling, robot)
    trace = ig.simulate(scene, ig.Trapezoid(1e3, 10.0), 0.2, trace=True).trace
    swing = np.diff(trace.tool_velocity) / np.diff(trace.time)
    assert 0.98 * feasible.OVERSHOOT < swing.max() / 10.0 < 1.001 * feasible.OVERSHOOT
