"""Set-ups: what is shipped is whole, a file says what it means or is refused in one line, and what follows is true."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from policies import made_up_policy

import impact_gym as ig
from agents import load_policy, setup
from agents.baselines import PaperTrapezoid, load_baseline
from agents.baselines.tuned import RULES, TUNED, names, read_tuned
from agents.controller import Wanted, kept, stages
from agents.evaluation import Stage
from agents.many import Many, train_all
from agents.policy import SHIPPED
from agents.settings import default_settings
from agents.setups import RULES as SETUP_RULES
from agents.setups import load_setup, owner, same_environment, shipped
from agents.train import resume
from agents.validation import Validation
from experiments.report import arenas
from experiments.report.__main__ import Settings, arenas_of
from experiments.report.play import play_as_late
from experiments.report.robustness import MECHANISM, VARIANTS
from impact_gym.envs.task import Task

MINE = """
title = "A slow arm"
[environment]
tool_mass = [0.3, 0.5]
coupling = { type = "SpringDamper", stiffness = [200.0, 400.0], damping_ratio = 0.7 }
robot = { type = "Robot", mass = 8.0, stiffness = [5e4, 2e5], damping = 80.0 }
range_noise = [0.005, 0.02]
velocity_range = [-0.2, 0.6]
acceleration_range = [0.5, 4.0]
[environment.scenario]
object_mass = [0.2, 1.0]
distance = [0.1, 0.3]
[training]
steps = 2000
envs = 16
batch = 64
validation_scenarios = 10
seeds = 2
[training.on_policy]
rollout = 16
[baselines]
budget = 16
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MINE)
    return path


@pytest.mark.parametrize("name", shipped())
def test_what_is_shipped_of_a_set_up_was_made_for_it(name):
    there = load_setup(name)
    assert default_settings(name).environment == {**there.environment, "time_weight": [0.3, 8.0]}
    for path in (SHIPPED / name).glob("seed-*.npz"):
        assert there.is_of(load_policy(path).environment)
    for baseline in there.tuned:
        assert owner(baseline) == there
    assert {*there.against} <= {*there.tuned, *names()}


def test_every_tuned_baseline_belongs_to_a_set_up():
    for path in TUNED.glob("*.json"):
        found = owner(path.stem)
        assert found is not None
        assert read_tuned(path.stem)["rule"] == found.tuned[path.stem].rule


def test_a_set_up_may_name_every_rule_that_is_tuned_and_one_of_them_needs_an_estimate():
    assert {*SETUP_RULES} == {*RULES}
    assert [name for name, rule in RULES.items() if rule.needs_estimate] == ["Ranged"]
    with pytest.raises(ValueError, match="Ranged needs an estimate"):
        load_baseline("ranged", 1.0).for_environment({})


@pytest.mark.parametrize(("one", "other"), [
    ({}, {"tool_mass": 0.125, "coupling": {"type": "SpringDamper", "stiffness": 50.0}, "time_weight": [0.3, 8.0]}),
    ({"reaction_delay": [0.01, 0.02]}, {"reaction_delay": np.array([0.01, 0.02])}),
    ({"scenario": {"distance": [0.1, 0.2]}}, {"scenario": {"distance": (0.1, 0.2)}}),
    ({"scenario": "train"}, {"scenario": {"distance": [0.15, 0.35]}}),
], ids=str)  # fmt: skip
def test_an_environment_is_the_same_whatever_is_left_to_defaults_or_written_as(one, other):
    assert same_environment(one, other)
    for another in ({"tool_mass": 0.2}, {"tool_mass": [0.1, 0.15]}):
        assert not same_environment(one, another)


def test_a_policy_names_what_differs_whatever_numbers_and_ranges_are_written_as():
    policy = load_policy("linear-blind")
    for delay in (0.016, (0.016, 0.016), [0.016, 0.016], np.array([0.016, 0.016])):
        assert policy.differs_in(Task(reaction_delay=delay)) == []
    assert policy.differs_in(Task(reaction_delay=[0.01, 0.02])) == ["reaction_delay"]
    array = {"type": "SpringDamper", "stiffness": np.array([40.0, 60.0])}
    assert Task(coupling=array).drawn == {"coupling.stiffness": (40.0, 60.0)}


def test_a_file_says_what_is_played(mine):
    there = load_setup(mine)
    one, many = there.make(), there.make_vec(3)
    assert np.array_equal(one.reset(seed=5)[0], many.reset(seed=5)[0][0])
    task = one.unwrapped._batch.task
    assert {*task.drawn} == {"tool_mass", "coupling.stiffness", "robot.stiffness", "range_noise"}
    assert (task.velocity_range, task.ranges.object_mass) == ((-0.2, 0.6), (0.2, 1.0))
    assert [*there.tuned] == ["mine-profile"] == [*there.against]  # what is usual, where the file says nothing
    assert there.tuned["mine-profile"].rule == "Ranged"
    assert there.folder == Path("runs/mine")
    settings = default_settings(str(mine))
    assert (settings.steps, settings.on_policy.rollout, there.seeds, there.budget) == (2000, 16, 2, 16)
    assert default_settings(str(mine), "sac").steps == 300_000  # its settings are for the algorithm it names


def test_validation_draws_from_a_set_ups_own_scenarios(mine):
    there = load_setup(mine)
    validation = Validation(there.environment, 20)
    validation.play(PaperTrapezoid())
    drawn = validation._batch.info()["scenario"]
    assert 0.2 <= drawn["object_mass"].min() < drawn["object_mass"].max() <= 1.0
    assert 0.1 <= drawn["distance"].min() < drawn["distance"].max() <= 0.3


def test_a_file_that_changes_is_read_again(mine):
    assert load_setup(mine).title == "A slow arm"
    mine.write_text(MINE.replace("A slow arm", "Another arm"))
    assert load_setup(mine).title == "Another arm"


@pytest.mark.parametrize(("text", "message"), [
    ("nonsense", "is not read as TOML: Expected"),
    ('titel = "x"', "unknown key titel; did you mean 'title'"),
    ("title = 3", "title must be a text, got 3"),
    ("version = 2", "version must be 1, got 2.*another version"),
    ("environment = 3", "environment must be a table"),
    ("[environment]\ntool_mas = 1.0", "unknown key environment.tool_mas; did you mean 'tool_mass'"),
    ("[environment]\ntime_weight = 1.0", "unknown key environment.time_weight"),
    ("[environment]\ntool_mass = [0.2, 0.1]", "environment: tool_mass.*inverted.*0.2.*0.1 kg"),
    ("[environment]\ntool_mass = []", "environment: tool_mass.*pair"),
    ('[environment]\ncoupling = {type = "Bistable", front_stop = [0.01, 0.07]}', "front_stop.*below the stroke.*0.07"),
    ("[environment.scenario]\nobject_mas = [1.0, 2.0]", "scenario has no field 'object_mas'.*object_mass"),
    ("[baselines]\nagainst = 'x'", "baselines.against must be a list of names"),
    ("[baselines]\nagainst = ['x', 'x']", "must not name one twice"),
    ("[baselines]\nbudget = 0", "baselines.budget.*at least 1"),
    ("[baselines]\nbound = 3", "baselines.bound must be a text"),
    ("[baselines.tuned]\na = 'Rule'", "baselines.tuned.a must be a rule, one of BlindProfile.*'Rule'"),
    ("[baselines.tuned]\na = {rule = 'Ranged', rtoll = 1.0}", "baselines.tuned.a.rtoll; did you mean 'rtol'"),
    ("[baselines.tuned]\na = {rule = 'Ranged', rtol = 1.0}", "baselines.tuned.a.rtol.*at most"),
    ("[environment]\ndeflection_sensor = true\n[baselines.tuned]\na = 'Ranged'", "baselines.tuned.a: Ranged needs"),
    ("[training]\nseeds = 0", "training.seeds.*at least 1"),
], ids=str)  # fmt: skip
def test_a_mistake_gets_one_line_with_the_file(tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"bad\.toml.*{message}") as raised:
        load_setup(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("text", "message"), [
    ("bacth = 3", "training: unknown key bacth; did you mean 'batch'"),
    ("on_policy = 3", r"on_policy must be a table, \[training.on_policy\]"),
    ("[training.on_policy]\nepoch = 3", "unknown key on_policy.epoch; did you mean 'epochs'"),
    ('algo = "dqn"', "algo must be one of ppo.*'dqn'"),
    ('steps = "many"', "training: steps must be a whole number"),
    ("seed = 1", "unknown key seed"),
    ('activation = "sine"', "activation must be tanh or relu"),
], ids=str)  # fmt: skip
def test_a_mistake_in_the_training_too(tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(f"[training]\n{text}")
    with pytest.raises(ValueError, match=rf"bad\.toml: .*{message}"):
        default_settings(str(path))


def test_a_set_up_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(ValueError, match=r"no set-up 'cubic'.*bistable-blind.*linear-ranged"):
        load_setup("cubic")


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
    trace = far_flight(task, share * setup.held(task), 2.0)
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


def test_what_follows_is_said(mine):
    lags = [setup.lag(one) for one in setup.corners(Task(**load_setup(mine).environment))]
    assert len(lags) == 8
    hand = [4.0 * m / k + 4.0 * (8.0 + m) / k_r for m in (0.3, 0.5) for k in (200, 400) for k_r in (5e4, 2e5)]
    assert sorted(lags) == pytest.approx(sorted(hand), rel=1e-12)
    said = "\n".join(setup.lines(load_setup(mine), str(mine)))
    drawn = "robot.stiffness: 50000 to 200000 N/m, log-uniform"
    assert all(part in said for part in (drawn, "agents.train", "mine-profile", "distance estimate"))
    assert "warning" not in said
    held = "the front stop holds the tool up to 8.38"
    assert held in "\n".join(setup.lines(load_setup("bistable-paper"), "bistable-paper"))


def test_a_folder_keeps_its_set_up_and_takes_no_other(mine, tmp_path):
    out = tmp_path / "out"
    copy = kept(load_setup(mine), out)
    assert copy.read_text() == MINE
    assert kept(load_setup(mine), out) == copy
    mine.write_text(MINE.replace("A slow arm", "A slower arm"))
    assert "slower" in kept(load_setup(mine), out).read_text()
    with pytest.raises(ValueError, match="holds the whole: name another folder"):
        kept(load_setup(mine), out, quick=True)
    mine.write_text(MINE.replace("0.7", "0.8"))
    with pytest.raises(ValueError, match=r"mine\.toml as it was.*name another folder"):
        kept(load_setup(mine), out)
    with pytest.raises(ValueError, match=r"holds something else \(mine\.toml\)"):
        kept(load_setup("linear-blind"), out)
    assert "0.7" in copy.read_text()
    with pytest.raises(ValueError, match="is no folder"):
        kept(load_setup(mine), mine)


def test_a_quick_run_takes_no_more_than_the_set_up_says(mine, tmp_path):
    tune, many, report, export = stages(mine, Wanted(str(mine), tmp_path / "out", quick=True))
    assert tune[tune.index("--budget") + 1] == "16"
    assert many[many.index("--seeds") + 1] == "2"
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
    assert load_setup(mine).is_of(load_policy(policy).environment)
    arena = arenas.of_setup(load_setup(out / "mine.toml"), {"set": "test", "count": 30}, out)
    assert arena.scenarios["ranges"]["object_mass"] == [0.2, 1.0]
    assert [one.name for one in arena.baselines] == ["paper's rule", "mine-profile"]
    first = policy.read_bytes()
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert policy.read_bytes() == first
    assert "training for" not in again.stdout


def test_less_than_a_set_up_wants_is_said(mine, tmp_path):
    there = load_setup(mine)
    contestant = arenas.Contestant("a", {"tuned": {"weights": {"2": {"search": {"budget": 8}}}}}, (2.0,), "")
    assert arenas.with_less(there, {"settings": {"steps": 2000}}, []) == ""
    said = arenas.with_less(there, {"settings": {"steps": 500}}, [contestant])
    assert said == "; A QUICK LOOK, trained for 500 steps of 2,000, baselines tuned with 8 candidates of 16"


def test_a_policy_says_once_that_it_is_played_elsewhere(recwarn):
    policy = load_policy("bistable-blind")
    elsewhere = Stage(5, 3, coupling={"type": "Bistable"})
    with pytest.warns(UserWarning, match="another environment, which differs in coupling$"):
        elsewhere.play(policy)
    recwarn.clear()
    elsewhere.play(policy)
    at_home = load_setup("bistable-blind").environment
    Stage(5, 3, **at_home, time_weight=[1.0]).play(load_policy("bistable-blind"))
    Stage(5, 3, coupling={"type": "Bistable"}, quiet=True).play(load_policy("bistable-blind"))
    assert not recwarn.list
    assert policy.differs_in(Task(**{**at_home, "tool_mass": [0.1, 0.15], "privileged": True})) == ["tool_mass"]


@pytest.mark.parametrize(("change", "message"), [
    ('against = ["mine-profil"]', "unknown key baselines.against.mine-profil; did you mean 'mine-profile'"),
    ('bound = "nonsense"', "unknown key baselines.bound.nonsense"),
], ids=str)  # fmt: skip
def test_what_would_show_hours_later_shows_at_once(mine, change, message):
    mine.write_text(MINE + change)
    with pytest.raises(ValueError, match=rf"mine\.toml: {message}"):
        setup.check(load_setup(mine), str(mine))


def test_nobody_can_change_a_set_up_for_all():
    load_setup("linear-blind").environment["tool_mass"] = 9.0
    assert load_setup("linear-blind").environment["tool_mass"] == 0.125


def test_a_policy_is_made_as_late_as_the_rule_is_on_that_arm():
    arm = {"velocity_range": [-0.2, 1.2], "acceleration_range": [1.0, 10.0]}
    scenarios = {"set": "test", "count": 200}
    late = play_as_late({"shipped": "linear-blind"}, arm, scenarios, [0.3, 8.0])
    rule = Stage.of("test", 200, **arm).play(PaperTrapezoid().for_environment(arm))
    assert late["approach_time"].mean() == pytest.approx(rule.approach_time.mean(), rel=0.03)


def test_a_baseline_follows_its_profile_in_its_own_control_period():
    slow = {"control_period": 0.1, "time_weight": [2.0]}
    rule, stage = load_baseline("blind-profile", 2.0), Stage.of("validation", 100, **slow)
    fitted = rule.for_environment(slow | {"time_weight": 2.0})
    assert stage.play(fitted).loss(2.0).mean() < stage.play(rule).loss(2.0).mean()


def test_a_change_that_leaves_no_environment_is_left_out():
    tight = {"type": "Bistable", "free_length": 0.07, "height": 0.06995, "front_stop": 0.001, "rear_stop": -0.001}
    changed = [one.environment({"coupling": tight}) for one in VARIANTS if one.factor == MECHANISM]
    assert None in changed
    assert any(changed)


def test_two_set_ups_of_one_name_cannot_share_a_report(mine, tmp_path):
    other = tmp_path / "there" / "mine.toml"
    other.parent.mkdir()
    other.write_text(MINE)
    with pytest.raises(ValueError, match="the same name"):
        arenas_of(Settings(setups=(str(mine), str(other))))


def test_policies_that_were_trained_for_another_arm_are_refused(mine, tmp_path):
    folder = tmp_path / "policies" / "mine"
    made_up_policy(environment={"range_noise": 0.01}).save(folder / "seed-0.npz")
    (folder / "seeds.json").write_text('{"median": 0}')
    with pytest.raises(ValueError, match=r"seed-0\.npz was trained for another environment than .*mine\.toml"):
        arenas.of_setup(load_setup(mine), {"set": "test", "count": 5}, tmp_path)


def test_seeds_of_a_set_up_that_has_changed_are_not_taken_for_its_own(mine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folders = {"runs": tmp_path / "runs", "policies": tmp_path / "policies"}
    wanted = Many(("mine.toml",), seeds=1, steps=512, processes=1, **folders)
    settings = replace(default_settings("mine.toml"), steps=512, validate_every=512)
    assert settings.setup == str(mine)  # from wherever it is gone on with
    shipped_to = train_all("mine", wanted, settings)
    assert load_setup(mine).is_of(load_policy(shipped_to).environment)
    mine.write_text(MINE.replace("damping_ratio = 0.7", "damping_ratio = 0.9"))
    with pytest.raises(ValueError, match="for another environment: remove it"):
        train_all("mine", wanted, replace(default_settings("mine.toml"), steps=512, validate_every=512))
    with pytest.raises(ValueError, match="has changed since"):
        resume(tmp_path / "runs" / "mine" / "seed-0")
