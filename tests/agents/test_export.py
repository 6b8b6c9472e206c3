"""`impact-gym export`: its files, their contract and its checks; networks in C and ONNX equal the policy's."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from made_up_policies import KINDS, made_up_policy, observations
from refusal import refused

from agents import load_policy, load_setup
from agents.baselines import ConstantSpeed
from agents.export import __main__ as exporting
from agents.export.__main__ import Export, judged, judged_replay
from agents.export.c_header import header
from agents.export.contract import Subject, of_name, of_setup
from agents.export.onnx_graph import write_onnx
from impact_gym.envs import IDS
from impact_gym.envs.batch import Batch
from impact_gym.task import QUANTITIES, ActionSpec, Task
from impact_gym.task.observation import place

pytestmark = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")
FEW = {"episodes": 10, "calls": 10}


@pytest.fixture
def onnx():
    pytest.importorskip("onnxruntime")
    return pytest.importorskip("onnx")


@pytest.mark.usefixtures("onnx")
@pytest.mark.parametrize("kind", KINDS)
def test_run_writes_header_and_onnx_and_compares_both(tmp_path, capsys, kind):
    policy = made_up_policy(**KINDS[kind])
    assert (np.abs(policy.predict(observations(policy))[0]) < 1.0).any(axis=0).all()  # not only equal limits
    saved = policy.save(tmp_path / "my policy-2.npz")
    files = exporting.run(Export(str(saved), tmp_path / "out", **FEW))
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
    refused(lambda: judged_replay(tmp_path, (10.0 * error, np.ones(9)), 3, 0.016), f"differ by {10.0 * error:.1e}")


def entries(text):
    """Return the contract in the comment of a header: JSON by name. Later lines of an entry begin with spaces."""
    lines = text.partition("\n\n")[2].partition("\n\n")[0].replace("\n    ", " ").splitlines()
    return dict(line.split(": ", 1) for line in lines)


@pytest.mark.parametrize("environment", [{"range_noise": 0.01, "past_readings": 2, "control_period": 0.008},
                                         IDS["ImpactTeleop-v0"]], ids=["ranged", "teleop"])  # fmt: skip
def test_header_and_onnx_have_one_contract_of_the_task(tmp_path, onnx, environment):
    policy = made_up_policy(environment=environment | {"time_weight": [0.5, 6.0], "reaction_delay": [0.01, 0.02]})
    policy.provenance["command"] = "train */ /* ??/ evil"
    subject, task = Subject(policy), policy.task
    text = header(subject, "it")
    assert text.partition("#ifndef")[0].count("*/") == 1
    model = onnx.load(write_onnx(subject, tmp_path / "it.onnx"))
    assert entries(text) == {item.key: item.value for item in model.metadata_props} == subject.contract
    said = {name: json.loads(value) for name, value in subject.contract.items()}
    assert (Task(**said["environment"]), said["made_by"]) == (task, policy.provenance["command"])
    assert said["control_period"] == {"value": environment.get("control_period", 0.016), "unit": "s"}
    for name, (low, high) in {"time_weight": (0.5, 6.0), "reaction_delay": (0.01, 0.02)}.items():
        assert said[name] == {"low": low, "high": high, "unit": QUANTITIES[name].unit}
    for name, (low, high) in task.scenario.by_id().items():
        assert said["objects"][name] == {"low": low, "high": high, "unit": QUANTITIES[name].unit}
    inputs = [said[f"input {place:02}"] for place in range(policy.inputs)]
    outputs = [said[f"output {place:02}"] for place in range(policy.actions)]
    assert [row["id"] for row in inputs] == [*policy.spec.ids]
    assert [(row["id"], row["unit"]) for row in outputs] == [(row.id, row.unit) for row in ActionSpec(task).entries]
    for row in inputs:
        assert row["unit"] == QUANTITIES[re.sub(r"_\d$", "", row["id"])].unit
        ends = policy.spec.encode(row["id"], [row["low"], row["high"]])
        assert ends == pytest.approx([row["scaled_low"], 1.0])


def rule(*parameters, weights=(0.5, 2.0), **environment):
    controller = ConstantSpeed.of([parameters, [1.0, 8.0, 8.0]]).for_task(Task(**environment))
    controller.weights = weights
    return controller


def test_checksum_changes_with_each_parameter_and_the_task():
    policies = [made_up_policy() for _ in range(4)]
    for policy, array in zip(policies[1:], ("weight", "bias", "weight"), strict=True):
        layer = policy.network.hidden[0] if policy is policies[3] else policy.network.mean
        getattr(layer, array)[(0,) * getattr(layer, array).ndim] += 1e-6
    rules = [rule(0.5, 8.0, 8.0), rule(0.5 + 1e-9, 8.0, 8.0), rule(0.5, 8.0, 9.0), rule(0.5, 8.0, 8.0, tool_mass=0.2),
             rule(0.5, 8.0, 8.0, weights=(0.5, 4.0))]  # fmt: skip
    every = [*policies, made_up_policy(environment={"reaction_delay": 0.017}), *rules]
    assert len({Subject(each).contract["checksum"] for each in every}) == len(every)
    for make in (made_up_policy, lambda: rule(0.5, 8.0, 8.0)):
        assert Subject(make()).contract == Subject(make()).contract


def test_loader_of_the_page_runs_onnx_from_its_metadata(tmp_path, onnx):
    """It returns the commands of 50 episodes from readings in SI units."""
    page = Path(__file__).parents[2] / "docs" / "how-to" / "deploy-c.md"
    (code,) = re.findall(r'```python title="loader.py"\n(.*?)```', page.read_text(), re.DOTALL)
    exec(code, loader := {})
    subject, policy = of_name("teleop-spring"), load_policy("teleop-spring")
    command = loader["load"](write_onnx(subject, tmp_path / "it.onnx"))
    batch = Batch(50, subject.task)
    batch.begin_seeded(0, {})
    for _ in range(20):
        actions = policy.predict(batch.observations)[0]
        expected = ActionSpec(subject.task).decode(actions)
        now = batch.episodes.view(np.float64).reshape(50, -1)
        for row in range(0, 50, 7):
            seen = {name: now[row, place(name)] for name in subject.spec.ids}
            span = [action.high - action.low for action in subject.actions]
            assert np.abs((np.array([*command(seen).values()]) - expected[row]) / span).max() < 2e-6
        batch.step(actions, batch.ended)


def test_rules_are_exported_for_the_users_arm(mine):
    mine.write_text(mine.read_text().replace("[environment]", "[environment]\ncontrol_period = 0.01", 1))
    setup = load_setup(mine)
    for name, subject in (of_setup(setup) | {"paper-trapezoid": of_name("paper-trapezoid", setup)}).items():
        assert subject.task == setup.task, name
        said = {key: json.loads(value) for key, value in entries(header(subject, "it")).items()}
        assert said["acceleration_limits"] == {"low": 0.5, "high": 4.0, "unit": "m/s^2"}
        assert said["velocity_limits"] == {"low": -0.2, "high": 0.6, "unit": "m/s"}
        assert (said["control_period"]["value"], Task(**said["environment"])) == (0.01, setup.task)
