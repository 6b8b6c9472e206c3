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
from impact_gym.identify.held_out import UNITS

TRUTH = scene(1e5, 0.5)
BOTH = ("force", "object_velocity")
SLOW = replace(MOTION, speed=0.5)


@pytest.fixture
def identify(tmp_path):
    """Run the command on one log or several, with a change of the scene's file."""

    def run(*options, logs=(), change=("", "")):
        paths = [tmp_path / f"{k}.csv" for k in range(1 + len(logs))]
        for path, columns in zip(paths, [log(TRUTH), *logs], strict=True):
            write_log(path, columns)
        (tmp_path / "my.toml").write_text(SCENE_FILE.replace(*change))
        main([*map(str, paths), "--scene", str(tmp_path / "my.toml"), *map(str, options)])
        return tmp_path

    return run


def test_intervals_become_ranges_of_the_set_up(identify, tmp_path, capsys):
    out = tmp_path / "setup.toml"
    identify("--out", out, "--plot", tmp_path / "a.png")
    assert "contact.stiffness = " in capsys.readouterr().out
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
def test_number_whose_interval_has_no_limit_on_one_side_keeps_its_value(interval):
    content = {"environment": {"coupling": {"rear_stop": 0.03}, "scenario": {}}}
    lines = set_up(content, SimpleNamespace(interval={"coupling.rear_stop": interval}), "")
    assert tomllib.loads("\n".join(lines)) == content


def test_friction_of_the_set_up_is_that_of_the_object():
    content = tomllib.loads(SCENE_FILE)
    content["environment"]["friction"] = 0.3
    assert parse(content, ())[0].object == ig.Object(1.0, 0.2505, 0.3)


def test_set_up_is_printed_and_a_number_of_the_coupling_may_be_free(identify, tmp_path, capsys):
    with pytest.warns(UserWarning, match="csv.*force"):  # the object is four times lighter than the file says
        identify("--free", "contact.stiffness", "coupling.stiffness", change=("tool_mass = 0.125", ""))
    (tmp_path / "printed.toml").write_text(printed := capsys.readouterr().out)
    assert "# default tool_mass used: 0.125 kg\n# contact" in printed
    stiffness = load_setup(tmp_path / "printed.toml").environment["coupling"]["stiffness"]
    assert stiffness == 150.0 or stiffness[0] < stiffness[1]


def test_hold_out_prints_predictions_and_writes_them_beside_the_set_up(identify, capsys):
    slow = [log(TRUTH, motion=SLOW, seed=seed) for seed in (1, 3)]
    logs, speeds = [slow[0], log(TRUTH, seed=2), slow[1]], ("speed = 1.0", "speed = [1.0, 0.5, 1.0, 0.5]")
    with pytest.warns(UserWarning, match="force"):  # the log has another stiffness and mass than the file
        folder = identify("--free", "contact.restitution", "--hold-out", logs=logs, change=speeds)
    comments, _, rest = capsys.readouterr().out.partition("\ntitle")
    assert all(line.startswith("# ") for line in comments.splitlines())
    assert "# impulse: median error " in comments
    assert "contact" not in rest.partition("[environment.scenario]")[0]
    with pytest.warns(UserWarning, match="force"):
        identify("--free", "contact.restitution", "--hold-out", "--out", folder / "a.toml", logs=logs, change=speeds)
    printed = capsys.readouterr().out
    load_setup(folder / "a.toml")
    with (folder / "a.held-out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["log"] for row in rows] == [str(folder / f"{k}.csv") for k in range(4) for _ in range(3)]
    assert {row["quantity"]: row["unit"] for row in rows} == {name: UNITS[name] for name in UNITS if "vel" not in name}
    assert {row["equal blows"] for row in rows} == {"nan"}  # the halves have one speed each
    for row in rows:
        off = 100.0 * (float(row["predicted"]) / float(row["measured"]) - 1.0)
        assert re.search(rf"{row['log']}: {row['quantity']} .*, {re.escape(f'{off:+.1f}')} %\n", printed)


def test_only_the_right_model_predicts_held_out_blows_to_the_noise():
    """Fast blows predict slow blows and the reverse; compared with the independent solver without noise."""
    motions = [MOTION, SLOW] * 2
    logs = [log(TRUTH, noise=0.01, columns=BOTH, seed=k, motion=each) for k, each in enumerate(motions)]
    other = replace(TRUTH, contact=replace(TRUTH.contact, dissipation="fixed"))
    right = ig.hold_out(logs, TRUTH, motions)
    wrong = ig.hold_out(logs, other, motions)
    for each in right.predictions:
        motion = motions[int(each.log.removeprefix("log ")) - 1]
        true = blow(TRUTH, motion, 0.03)
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


def test_scatter_of_equal_blows_is_relative_to_the_median_of_the_fitted_blows():
    logs = [log(scene(1e5, e), noise=1e-4, columns=("object_velocity",)) for e in (0.3, 0.5, 0.6, 0.7, 0.4)]
    with pytest.warns(UserWarning, match="object_velocity"):  # one restitution is fitted to several
        found = ig.hold_out(logs, TRUTH, MOTION, free=("contact.restitution",))
    ends = [np.mean(each["object_velocity"][-40:]) for each in logs]  # the last quarter of 160
    assert [each.measured for each in found.predictions] == pytest.approx(ends)
    halves = [np.median(ends[1::2]), np.median(ends[::2])]
    assert [each.equal for each in found.predictions] == pytest.approx([halves[k % 2] for k in range(5)])
    predicted = [each.predicted for each in found.predictions]
    assert found.errors("object_velocity")[0] == pytest.approx(np.abs(np.divide(predicted, ends) - 1.0))
    assert predicted == pytest.approx([halves[k % 2] for k in range(5)], rel=0.03)  # e is near the middle of its half
