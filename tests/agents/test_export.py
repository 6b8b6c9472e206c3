"""`impact-gym export`: its files, their documentation and its checks; networks in C and ONNX equal the policy's."""

import json
import re
import runpy
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from made_up_policies import KINDS, made_up_policy, observations
from refusal import refused

from agents import load_policy, load_setup
from agents.baselines import ConstantSpeed, Rule
from agents.baselines.profile import REACTION, ReactingRule
from agents.export.__main__ import Export, judged, judged_replay, run
from agents.export.c_header import header
from agents.export.documentation import Exported, of_name, of_setup
from agents.export.onnx_graph import write_onnx
from agents.policies.networks import to_arrays
from agents.setups.setup import UNSAID
from impact_gym.envs import IDS
from impact_gym.task import QUANTITIES, Task

onnx, _ = map(pytest.importorskip, ("onnx", "onnxruntime"))
pytestmark = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")


@pytest.mark.parametrize("kind", KINDS)
def test_run_writes_header_and_onnx_and_compares_both(tmp_path, capsys, kind):
    policy = made_up_policy(**KINDS[kind])
    assert (np.abs(policy.predict(observations(policy))[0]) < 1.0).any(axis=0).all()  # not only equal limits
    saved = policy.save(tmp_path / "my policy-2.npz")
    files = run(Export(str(saved), tmp_path / "out", episodes=10, calls=10))
    assert [file.name for file in files] == ["my policy-2.h", "my policy-2.onnx"]
    printed = capsys.readouterr().out
    assert (printed.count("16,000 us"), printed.count("differs from the policy by at most")) == (1, 2)


@pytest.mark.parametrize("error", [2e-6, np.nan])
def test_one_wrong_action_of_many_is_refused(tmp_path, error):
    """If it differs by a little more than rounding, or is no number."""
    actions, computed = np.zeros((2, 10_000, 2), np.float32)
    assert "by at most 0.0e+00" in judged(tmp_path, computed, "", actions, 1e-6)
    computed[-1, 1] += error
    refused(lambda: judged(tmp_path, computed, "", actions, 1e-6), f"differs from the policy by {error:.1e}")
    said = judged_replay(tmp_path, (0.0, np.array([2e-6] * 9)), 3, 0.016)  # s
    assert "of 9 calls here 99.9 % take at most 2.0 us of the control period of 16,000 us" in said
    refused(lambda: judged_replay(tmp_path, (10.0 * error, np.ones(9)), 3, 0.016), f"differ by {10.0 * error:.1e}")


@pytest.mark.parametrize("environment", [IDS["ImpactTeleop-v0"], {
    "range_noise": 0.01, "past_readings": 2, "control_period": 0.008, "acceleration_range": [0.5, 4.0],
}], ids=["teleop", "ranged"])  # fmt: skip
def test_header_and_onnx_have_one_contract_of_the_task(tmp_path, environment):
    policy = made_up_policy(environment=environment | {"time_weight": [0.5, 6.0], "reaction_delay": [0.01, 0.02]})
    policy.provenance["command"] = "train */ /* ??/ evil"
    exported, task = Exported(policy), policy.task
    text = header(exported, "it")
    assert text.partition("#ifndef")[0].count("*/") == 1
    model = onnx.load(write_onnx(exported, tmp_path / "it.onnx"))
    assert {item.key: item.value for item in model.metadata_props} == exported.documentation
    entries = text.split("\n\n")[1].replace("\n    ", " ").splitlines()  # later lines of an entry begin with spaces
    assert dict(line.split(": ", 1) for line in entries) == exported.documentation
    said = {name: json.loads(value) for name, value in exported.documentation.items()}
    assert (Task(**said["environment"]), said["made_by"]) == (task, policy.provenance["command"])
    assert said["control_period"] == {"value": environment.get("control_period", 0.016), "unit": "s"}
    limits = {
        "velocity_limits": (*task.velocity_range, "m/s"), "acceleration_limits": (*task.acceleration_range, "m/s^2"),
        "time_weight": (0.5, 6.0, "m/s per s"), "reaction_delay": (0.01, 0.02, "s"),
    }  # fmt: skip
    limits |= {name: (*ends, QUANTITIES[name].unit) for name, ends in task.scenario.by_id().items()}
    for name, values in limits.items():
        assert (said | said["objects"])[name] == dict(zip(("low", "high", "unit"), values, strict=True))
    inputs = [said[f"input {place:02}"] for place in range(policy.inputs)]
    outputs = [said[f"output {place:02}"] for place in range(policy.actions)]
    assert [row["id"] for row in inputs] == [*policy.spec.ids]
    assert [(row["id"], row["unit"]) for row in outputs] == [(row.id, row.unit) for row in task.action.entries]
    for row in inputs:
        assert row["unit"] == QUANTITIES[re.sub(r"_\d$", "", row["id"])].unit
        ends = policy.spec.encode(row["id"], [row["low"], row["high"]])
        assert ends == pytest.approx([row["scaled_low"], 1.0])


def test_checksum_changes_with_each_parameter_and_the_task():
    def rule(*parameters, weights=(0.5, 2.0), **environment):
        controller = ConstantSpeed.of([parameters, [1.0, 8.0, 8.0]]).for_task(Task(**environment))
        controller.weights = weights
        return controller

    every = [made_up_policy(), made_up_policy(environment={"reaction_delay": 0.017}), rule(0.5, 8.0, 8.0),
             rule(0.5 + 1e-9, 8.0, 8.0), rule(0.5, 8.0, 9.0), rule(0.5, 8.0, 8.0, tool_mass=0.2),
             rule(0.5, 8.0, 8.0, weights=(0.5, 4.0))]  # fmt: skip
    for name in to_arrays(every[0].network):
        every.append(made_up_policy())
        to_arrays(every[-1].network)[name].flat[0] += 1e-6
    assert len({Exported(each).documentation["checksum"] for each in every}) == len(every)
    for make in (made_up_policy, lambda: rule(0.5, 8.0, 8.0)):
        assert Exported(make()).documentation == Exported(make()).documentation


def test_loader_of_the_page_runs_onnx_from_its_metadata(tmp_path):
    """It returns the commands from readings in SI units, also from readings beyond their scales."""
    loader = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "examples" / "run_onnx.py"))
    exported, policy = of_name("teleop-spring"), load_policy("teleop-spring")
    command = loader["load"](write_onnx(exported, tmp_path / "it.onnx"))
    span = [action.high - action.low for action in exported.actions]
    wide = 1.2 * observations(policy, 150)
    actions = policy.predict(np.clip(wide, policy.spec.scaled_low, 1.0))[0]
    for row, expected in zip(wide, exported.task.action.decode(actions), strict=True):
        seen = {name: policy.spec.decode(row, name) for name in policy.spec.ids}
        assert np.abs((np.array([*command(seen).values()]) - expected) / span).max() < 2e-6


def test_header_says_where_its_own_controller_fails(tmp_path):
    """By the report beside it, if that is about the same controller of the same arm."""
    (tmp_path / "report").mkdir()
    saved = made_up_policy().save(tmp_path / "policies" / "mine.npz")
    key = sha256(load_policy(saved).to_bytes()).hexdigest()
    for fails, expected in (({key: "beyond 0.6 m"}, "beyond 0.6 m"), ({"other": "no"}, UNSAID)):
        runs = [{"numbers": {"fails": {"mine": {"older": ""}}}}, {"numbers": {"fails": {"mine": fails}}}]
        (tmp_path / "report" / "results.json").write_text(json.dumps({"runs": runs}))
        said = of_name(str(saved)).documentation
        assert (json.loads(said["fails"]), "position 0" in said["coordinates"]) == (expected, True)
    (tmp_path / "report" / "results.json").write_text("{")
    assert of_name(str(saved)).fails == UNSAID


def test_rules_are_exported_for_the_users_arm(mine):
    setup = load_setup(mine)
    for name, exported in (of_setup(setup) | {"paper-trapezoid": of_name("paper-trapezoid", setup)}).items():
        assert exported.task == setup.task, name


def test_rule_without_c_is_refused_by_name():
    """Also if its parameters have the names of another rule's."""

    class Mine(Rule):
        PARAMETERS = ConstantSpeed.PARAMETERS

    class OnProfile(ReactingRule):
        PARAMETERS = REACTION

    for rule in (Mine([0.5, 8.0, 8.0]), OnProfile([parameter.start for parameter in REACTION])):
        refused(lambda rule=rule: header(rule, "it"), f"{type(rule).__name__} has no part in rule.h.jinja")


def test_tuned_baseline_is_read_from_the_named_folder(tmp_path):
    refused(lambda: of_name(str(tmp_path / "blind-profile.json")), f"no file {tmp_path / 'blind-profile.json'}")
    assert {*of_setup(load_setup("linear-blind"), tmp_path)} == {"paper-trapezoid", "local-brake"}
