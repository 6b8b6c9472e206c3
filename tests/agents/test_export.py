"""`impact-gym export`: its files, their contract and its checks; networks in C and ONNX equal the policy's."""

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from made_up_policies import KINDS, made_up_policy, observations
from refusal import refused

from agents import load_policy, load_setup
from agents.export import __main__ as exporting
from agents.export.__main__ import Export, judged, judged_replay
from agents.export.c_header import header
from agents.export.contract import Subject, of_name
from agents.export.onnx_graph import write_onnx
from impact_gym.envs import IDS
from impact_gym.envs.batch import Batch
from impact_gym.task import ActionSpec, Task
from impact_gym.task.observation import place

pytestmark = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")


@pytest.fixture
def onnx():
    pytest.importorskip("onnxruntime")
    return pytest.importorskip("onnx")


@pytest.mark.usefixtures("onnx")
@pytest.mark.parametrize("kind", KINDS)
def test_run_writes_header_and_onnx_and_prints_their_checks_and_missing_ones(tmp_path, monkeypatch, capsys, kind):
    """Some actions lie within their limits: equal limits would prove nothing."""
    policy = made_up_policy(**KINDS[kind])
    assert (np.abs(policy.predict(observations(policy))[0]) < 1.0).any(axis=0).all()
    saved = policy.save(tmp_path / "my policy-2.npz")
    options = Export(str(saved), tmp_path / "out", episodes=300, calls=1000)
    assert [file.name for file in exporting.run(options)] == ["my policy-2.h", "my policy-2.onnx"]
    printed = capsys.readouterr().out
    assert (printed.count("16,000 us"), printed.count("differs from the policy by at most")) == (1, 2)
    monkeypatch.setenv("PATH", str(tmp_path))
    exporting.run(options)
    printed = capsys.readouterr().out
    assert "my policy-2.h: its network is not checked, no C compiler is here" in printed
    assert "my policy-2.h: its controller is not checked: no C compiler" in printed
    monkeypatch.setitem(sys.modules, "onnx", None)
    refused(lambda: exporting.run(options), "ONNX needs the package onnx: pip install")


def test_judged_refuses_a_network_or_controller_with_other_results(tmp_path):
    """If one action of 10,000 differs by a little more than rounding."""
    actions, computed = np.zeros((2, 10_000, 2), np.float32)
    assert "by at most 0.0e+00" in judged(tmp_path, computed, "", actions, 1e-6)
    computed[-1, 1] += 2e-6
    refused(lambda: judged(tmp_path, computed, "", actions, 1e-6), "differs from the policy by 2")
    played = 2e-5, np.full(9, 1e-6)
    refused(lambda: judged_replay(tmp_path, played, 3, 0.016), "differ by 2.0e-05 of their range")


def entries(text):
    """Return the contract in the comment of a header: JSON by name. Later lines of an entry begin with spaces."""
    lines = text.partition("\n\n")[2].partition("\n\n")[0].replace("\n    ", " ").splitlines()
    return dict(line.split(": ", 1) for line in lines)


@pytest.mark.parametrize("environment", [{"range_noise": 0.01, "past_readings": 2}, IDS["ImpactTeleop-v0"]], ids=str)
def test_header_and_onnx_have_the_same_contract_which_describes_the_task(tmp_path, onnx, environment):
    policy = made_up_policy(environment=environment)
    policy.provenance["command"] = "train */ /* ??/ evil"
    subject = Subject(policy)
    text = header(subject, "it")
    assert text.partition("#ifndef")[0].count("*/") == 1
    model = onnx.load(write_onnx(subject, tmp_path / "it.onnx"))
    assert entries(text) == {item.key: item.value for item in model.metadata_props} == subject.contract
    said, task = {name: json.loads(value) for name, value in subject.contract.items()}, Task(**environment)
    assert Task(**said["environment"]) == task
    assert (said["control_period"], said["made_by"]) == ({"value": 0.016, "unit": "s"}, policy.provenance["command"])
    assert said["objects"]["object_mass"] == {"low": 0.1, "high": 2.5, "unit": "kg"}
    inputs = [said[f"input {place:02}"] for place in range(policy.inputs)]
    outputs = [said[f"output {place:02}"] for place in range(policy.actions)]
    assert [row["id"] for row in inputs] == [*policy.spec.ids]
    assert [(row["id"], row["unit"]) for row in outputs] == [(row.id, row.unit) for row in ActionSpec(task).entries]
    for row in inputs:
        ends = policy.spec.encode(row["id"], [row["low"], row["high"]])
        assert ends == pytest.approx([row["scaled_low"], 1.0])


def test_checksum_changes_with_a_weight_and_with_the_task():
    policy, other = made_up_policy(), made_up_policy()
    other.network.mean.weight[0, 0] += 1e-6
    longer = made_up_policy(environment={"reaction_delay": 0.017})
    assert len({Subject(each).contract["checksum"] for each in (policy, other, longer)}) == 3
    assert Subject(policy).contract == Subject(made_up_policy()).contract


@pytest.mark.parametrize("name", ["linear-ranged", "linear-robust", "teleop-spring"])
def test_loader_of_the_page_runs_onnx_from_its_metadata_alone(tmp_path, onnx, name):
    """It returns the commands of 50 episodes from readings in SI units."""
    page = Path(__file__).parents[2] / "docs" / "how-to" / "deploy-c.md"
    (code,) = re.findall(r'```python title="loader.py"\n(.*?)```', page.read_text(), re.DOTALL)
    exec(code, loader := {})
    subject, policy = of_name(name), load_policy(name)
    command = loader["load"](write_onnx(subject, tmp_path / "it.onnx"))
    batch = Batch(50, subject.task)
    batch.begin_seeded(0, {})
    for _ in range(30):
        actions = policy.predict(batch.observations)[0]
        expected = ActionSpec(subject.task).decode(actions)
        now = batch.episodes.view(np.float64).reshape(50, -1)
        for row in range(0, 50, 7):
            seen = {name: now[row, place(name)] for name in subject.spec.ids}
            span = [action.high - action.low for action in subject.actions]
            assert np.abs((np.array([*command(seen).values()]) - expected[row]) / span).max() < 2e-6
        batch.step(actions, batch.ended)
    model = onnx.load(tmp_path / "it.onnx")
    del model.metadata_props[:]
    onnx.save(model, tmp_path / "it.onnx")
    refused(lambda: loader["load"](tmp_path / "it.onnx"), "has no contract")


def test_all_controllers_of_a_set_up_are_exported_to_one_folder(tmp_path, capsys):
    setup = load_setup("linear-blind")
    shutil.copytree(setup.folder / "tuned", tmp_path / "tuned")
    (tmp_path / "tuned" / "constant-speed.json").unlink()
    run = Export("linear-blind", tmp_path / "out", all=True, folder=tmp_path, episodes=10, calls=100)
    written = {path.name for path in exporting.run(run)}
    assert written == {"paper-trapezoid.h", "local-brake.h", "blind-profile.h", "constant-deceleration.h"}
    printed = capsys.readouterr().out
    for left_out in ("constant-speed is left out: baseline 'constant-speed' was not tuned", "linear-blind is left out"):
        assert left_out in printed
    run = Export("paper-trapezoid", tmp_path / "rule", setup="paper-limits", episodes=10, calls=100)
    assert '"low": 1.0, "high": 8.0, "unit": "m/s^2"' in exporting.run(run)[0].read_text()
