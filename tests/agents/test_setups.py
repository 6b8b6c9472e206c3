"""Set-ups: what is shipped is whole, and a file says what it means or is refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from agents import load_policy
from agents.baselines import PaperTrapezoid, load_baseline
from agents.baselines.tuned import RULES, TUNED, names, read_tuned
from agents.evaluate import Validation
from agents.evaluate.stage import Stage
from agents.policies.policy import SHIPPED
from agents.setups import RULES as SETUP_RULES
from agents.setups import load_setup, owner, same_environment, shipped
from agents.setups.evaluation import WEIGHTS
from agents.train.settings import default_settings
from experiments.report.measures import play_as_late
from impact_gym.envs.task import Task


@pytest.mark.parametrize("name", shipped())
def test_what_is_shipped_of_a_set_up_was_made_for_it(name):
    there = load_setup(name)
    assert default_settings(name).environment == {**there.environment, "time_weight": [0.3, 8.0]}
    for path in (SHIPPED / name).glob("seed-*.npz"):
        assert there.describes(load_policy(path).environment)
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
    assert [name for name, rule in RULES.items() if rule.needs_estimate] == ["Ranged", "WaryRanged"]
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
    assert (settings.steps, settings.rollout, there.seeds, there.budget) == (2000, 16, 2, 16)


def test_validation_draws_from_a_set_ups_own_scenarios(mine):
    there = load_setup(mine)
    validation = Validation(there.environment, WEIGHTS, 20)
    validation.score(PaperTrapezoid())
    drawn = validation._batch.info()["scenario"]
    assert 0.2 <= drawn["object_mass"].min() < drawn["object_mass"].max() <= 1.0
    assert 0.1 <= drawn["distance"].min() < drawn["distance"].max() <= 0.3


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
    ("epoch = 3", "unknown key epoch; did you mean 'epochs'"),
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
