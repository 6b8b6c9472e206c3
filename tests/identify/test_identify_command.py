"""From logs and a scene's file to a set-up that agents.load_setup accepts, and predictions of blows not fitted."""

import csv
import math
import re
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_hits import MOTION, SCENE_FILE, blow, log, scene, write_log

import impact_gym as ig
from agents import load_setup
from impact_gym.identify.__main__ import main, parse, set_up
from impact_gym.identify.held_out import UNITS, HeldOut, Prediction

TRUTH = scene(1e5, 0.5)
BOTH = ("force", "object_velocity")
SLOW = replace(MOTION, speed=0.5)


@pytest.fixture
def identify(tmp_path):
    """Run the command on logs, with other lines of the scene's file."""

    def run(*options, logs=(), **lines):
        logs = logs or [log(TRUTH)]
        for k, columns in enumerate(logs):
            write_log(tmp_path / f"{k}.csv", columns)
        scene_file = [lines.get(line.partition(" ")[0], line) for line in SCENE_FILE.splitlines()]
        (tmp_path / "my.toml").write_text("\n".join(scene_file))
        paths = [str(tmp_path / f"{k}.csv") for k in range(len(logs))]
        main([*paths, "--scene", str(tmp_path / "my.toml"), *map(str, options)])

    return run


def test_intervals_become_ranges_of_the_set_up(identify, tmp_path, capsys):
    out = tmp_path / "setup.toml"
    identify("--out", out, "--plot", tmp_path / "a.png")
    said = capsys.readouterr().out
    assert "contact.stiffness = " in said
    assert "is not reached" not in said
    setup = load_setup(out)
    scenario = setup.environment["scenario"]
    for name, truth in (("contact_stiffness", 1e5), ("restitution", 0.5), ("object_mass", 0.25)):
        low, high = scenario[name]
        assert 0.8 * truth < low < high < 1.25 * truth
    assert scenario["distance"] == 0.2505
    assert setup.environment["reaction_delay"] == [0.012, 0.020]
    assert setup.title == "Our arm"
    assert (tmp_path / "a.png").stat().st_size > 0


@pytest.mark.parametrize("interval", [(-0.05, -0.0), (-math.inf, -0.01), (0.0, 0.05), (0.01, math.inf)])
def test_number_without_a_limit_on_one_side_keeps_its_value(interval):
    content = {"environment": {"coupling": {"rear_stop": 0.03}, "scenario": {}}}
    lines = set_up(content, SimpleNamespace(interval={"coupling.rear_stop": interval}), "")
    assert tomllib.loads("\n".join(lines)) == content
    file = tomllib.loads(SCENE_FILE.replace("[environment]", "[environment]\nfriction = 0.3"))
    assert parse(file, ())[0].object == ig.Object(1.0, 0.2505, 0.3)


def test_set_up_is_printed_with_what_is_doubtful(identify, tmp_path, capsys):
    """The tool has 2.002 m/s where it touches: sqrt(2 * 8 m/s^2 * 0.2505 m)."""
    logs = [log(TRUTH, motion=replace(MOTION, speed=speed), after=0.012) for speed in (2.001, 2.003)]
    free = "contact.stiffness", "coupling.stiffness"
    with pytest.warns(UserWarning, match="csv.*force"):  # the object is four times lighter than the file says
        identify("--free", *free, logs=logs, tool_mass="", speed="speed = [2.001, 2.003]")
    (tmp_path / "printed.toml").write_text(printed := capsys.readouterr().out)
    assert "# default tool_mass used: 0.125 kg\n# motion.speed = 2.003 m/s is not reached in 0.2505 m" in printed
    assert printed.count("is not reached") == 1
    stiffness = load_setup(tmp_path / "printed.toml").environment["coupling"]["stiffness"]
    assert stiffness == 150.0 or stiffness[0] < stiffness[1]


def test_held_out_errors_are_relative_to_the_measured_values():
    rows = [("a", "impulse", 2.0, 2.2, 1.9), ("b", "impulse", -4.0, -3.0, math.nan), ("c", "duration", 0.0, 1.0, 1.0)]
    held = HeldOut(tuple(Prediction(*row) for row in rows))
    assert held.errors("impulse")[0] == pytest.approx([0.1, 0.25])
    assert [held.errors("impulse")[1][0], held.errors("duration")[0][0]] == pytest.approx([0.05, math.inf])
    first, second, summary = str(replace(held, predictions=held.predictions[:2])).splitlines()[1:]
    assert first == "a: impulse 2 N s, predicted 2.2, +10.0 %"
    assert second == "b: impulse -4 N s, predicted -3, -25.0 %"
    assert re.findall(r"[\d.]+ %", summary) == ["17.5 %", "24.2 %", "5.0 %"]  # median, 0.1 + 0.95 * 0.15, equal blows


def test_hold_out_writes_predictions_beside_the_set_up(identify, tmp_path, capsys):
    logs = [log(TRUTH, motion=motion, seed=seed) for seed, motion in enumerate((MOTION, SLOW, MOTION, SLOW))]
    with pytest.warns(UserWarning, match="force"):  # the log has another stiffness and mass than the file
        identify("--free", "contact.restitution", "--hold-out", "--out", tmp_path / "a.toml", logs=logs,
                 speed="speed = [1.0, 0.5, 1.0, 0.5]")  # fmt: skip
    printed, text = capsys.readouterr().out, (tmp_path / "a.toml").read_text()
    comments, _, rest = text.partition("\ntitle")
    assert comments == "\n".join(f"# {line}" for line in printed.splitlines())
    assert "contact" not in rest.partition("[environment.scenario]")[0]
    load_setup(tmp_path / "a.toml")
    rows = list(csv.DictReader((tmp_path / "a.held-out.csv").read_text().splitlines()))
    assert [row["log"] for row in rows] == [str(tmp_path / f"{k}.csv") for k in range(4) for _ in range(3)]
    assert {row["quantity"]: row["unit"] for row in rows} == {name: UNITS[name] for name in UNITS if "vel" not in name}
    assert {row["equal blows"] for row in rows} == {"nan"}  # the halves have one speed each
    for row in rows:
        off = 100.0 * (float(row["predicted"]) / float(row["measured"]) - 1.0)
        assert re.search(rf"{row['log']}: {row['quantity']} .*, {re.escape(f'{off:+.1f}')} %\n", printed)


def test_only_the_right_model_predicts_to_the_noise():
    """Fast blows predict slow blows and the reverse; compared with the independent solver without noise."""
    motions = [MOTION, SLOW]
    logs = [log(TRUTH, noise=0.01, columns=BOTH, seed=k, motion=each) for k, each in enumerate(motions)]
    other = replace(TRUTH, contact=replace(TRUTH.contact, dissipation="fixed"))
    right, wrong = (ig.hold_out(logs, start, motions) for start in (TRUTH, other))
    for each in right.predictions:
        true = blow(TRUTH, motions[int(each.log.removeprefix("log ")) - 1], 0.03)
        widths = np.ptp(true.time[true.force > 0.5 * true.force.max()])
        last = true.object_velocity[true.time > true.time[0] + 0.02].mean()  # the last quarter of a log of 40 ms
        exact = {"object_velocity": last, "peak_force": true.force.max(), "duration": widths,
                 "impulse": 0.25 * true.object_velocity[-1]}  # fmt: skip
        assert each.predicted == pytest.approx(exact[each.quantity], rel=0.02)
        assert each.measured == pytest.approx(exact[each.quantity], rel=0.05)
        assert np.isnan(each.equal)
    ours, theirs = (np.median(each.errors("object_velocity")[0]) for each in (right, wrong))
    assert ours < 0.005
    assert theirs > 4.0 * ours


def test_equal_blows_are_the_median_of_the_fitted_half():
    logs = [log(scene(1e5, e), noise=1e-4, columns=("object_velocity",)) for e in (0.3, 0.5, 0.6, 0.7, 0.4)]
    with pytest.warns(UserWarning, match="object_velocity"):  # one restitution is fitted to several
        found = ig.hold_out(logs, TRUTH, MOTION, free=("contact.restitution",))
    ends = [np.mean(each["object_velocity"][-40:]) for each in logs]  # the last quarter of 160
    assert [each.measured for each in found.predictions] == pytest.approx(ends)
    halves = [np.median(ends[1::2]), np.median(ends[::2])]
    assert [each.equal for each in found.predictions] == pytest.approx([halves[k % 2] for k in range(5)])
    predicted = [each.predicted for each in found.predictions]
    assert predicted == pytest.approx([halves[k % 2] for k in range(5)], rel=0.03)  # e is near the middle of its half
