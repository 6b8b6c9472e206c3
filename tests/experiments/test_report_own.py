"""The report of a user's own policy, baseline, ranges and tool; what makes no sense is refused before it is played."""

import json
import re
import shutil
import sys
from dataclasses import replace

import polars as pl
import pytest
from jinja2 import Environment, FileSystemLoader

from agents import Policy, load_policy
from agents.baselines import ConstantSpeed
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.jobs import job, local
from agents.policies.policy import SHIPPED
from agents.setups import TUNED
from experiments.lab.page import EXPERIMENTS, typeset
from experiments.report import __main__ as report
from experiments.report.__main__ import ReportOptions, write
from experiments.report.tables import Table


def of(episodes, contestant):
    return episodes.filter(pl.col("contestant") == contestant)


def test_report_takes_a_users_baseline_ranges_and_tool(tmp_path, monkeypatch):
    (tmp_path / "my_rules.py").write_text(
        "from agents.baselines import ConstantSpeed\n"
        "class Half(ConstantSpeed):\n    def __init__(self):\n        super().__init__(0.5)\n"
        "idle = 3\n"
        "class Crooked:\n    def predict(self, observation, **more):\n        return observation, None\n"
        "class Lost:\n    def predict(self, observation, **more):\n"
        "        return observation[:, :2] * float('nan'), None\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    scenarios = tmp_path / "mine.json"
    wanted = {"ranges": {"object_mass": 0.4, "distance": [0.2, 0.3]}, "seed": 5, "count": 6,
              "environment": {"tool_mass": 0.2}}  # fmt: skip
    scenarios.write_text(json.dumps(wanted))
    settings = ReportOptions(policy=("linear-blind",), baseline=("my_rules:Half",), scenarios=str(scenarios),
                             out=tmp_path / "out", processes=0)  # fmt: skip
    write(settings)
    episodes = pl.read_parquet(tmp_path / "out" / "episodes.parquet")
    assert set(episodes["object_mass"]) == {0.4}
    assert episodes["distance"].is_between(0.2, 0.3).all()
    half = of(episodes, "my_rules:Half").sort("scenario")
    ranges = {"object_mass": 0.4, "distance": (0.2, 0.3)}
    judged = ScenarioBatch(5, 6, scenario=ranges, tool_mass=0.2).play(ConstantSpeed(0.5))
    assert (half["object_velocity"].to_numpy() == judged.object_velocity).all()
    write(replace(settings, count=4))
    assert len(of(pl.read_parquet(tmp_path / "out" / "episodes.parquet"), "my_rules:Half")) == 4
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == [".out.episodes"]
    for bad, message in (
        (["my_rules:idle"], "no controller"), (["my_rules:nothing"], "no controller"), (["nowhere:x"], "no controller"),
        (["my_rules"], "module:object"), (["my_rules:Crooked"], "must return actions"), (["my_rules:Lost"], "finite"),
        (["blind-profile", "blind-profile"], "differ"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=message):
            write(replace(settings, baseline=tuple(bad), out=tmp_path / "bad"))
    sys.modules.pop("my_rules")


def test_report_of_a_single_weight_plays_baselines_at_that_weight(tmp_path):
    policy = load_policy("linear-blind")
    Policy(policy.network, {"time_weight": 3.0}, {}).save(tmp_path / "three & a bit.npz")
    write(ReportOptions(policy=(str(tmp_path / "three & a bit.npz"),), baseline=("blind-profile",), count=6,
                   out=tmp_path / "out", processes=0))  # fmt: skip
    episodes = pl.read_parquet(tmp_path / "out" / "episodes.parquet")
    assert set(of(episodes, "three-a-bit")["time_weight"]) == {3.0}
    assert 3.0 in set(of(episodes, "blind-profile")["time_weight"])
    assert "no weight makes its approach as long" in (tmp_path / "out" / "index.html").read_text()


def test_report_claims_nothing_for_a_policy_that_misses(tmp_path):
    (tmp_path / "far.json").write_text('{"ranges": {"distance": [0.9, 1.0]}, "count": 5}')
    out = tmp_path / "out"
    write(ReportOptions(policy=("linear-blind",), scenarios=str(tmp_path / "far.json"), out=out, processes=0))
    answer = json.loads((out / "results.json").read_text())["answers"]["linear-blind"]
    assert answer["missed"] == answer["episodes"]
    assert answer["improvement"]["value"] == 0.0
    page = (out / "index.html").read_text()
    assert "nothing is claimed" in page
    assert "slower at the paper" not in page


@pytest.mark.parametrize(("wanted", "message"), [
    ({"scenarios": "nowhere"}, "nowhere"),
    ({"policy": ("linear-ranged",), "scenarios": '{"environment": {"range_noise": null}}'}, "network takes 9.*shows 8"),
    ({"policy": ("linear-blind",), "scenarios": '{"tool": 1}'}, "tool"),
    ({"policy": ("linear-blind",), "scenarios": '{"ranges": {"mass": 1}}'}, "mass"),
    ({"policy": ("linear-blind",), "scenarios": "{"}, "not read"),
    ({"policy": ("linear-blind",), "scenarios": '{"environment": {"time_weight": 3}}'}, "leave out.*time_weight"),
    ({"policy": ("linear-blind",), "scenarios": '{"environment": [1]}'}, "environment must be a mapping"),
    ({"policy": ("linear-blind", "agents/policies/linear-blind.npz")}, "two policies"),
    ({"policy": ("linear-blind",), "baseline": ("paper-trapezoid",)}, "there anyway"),
    ({"policy": ("linear-blind",), "baseline": ("fastest",)}, "no controller 'fastest'"),
    ({"scenarios": '{"environment": {"tool_mass": 1.0}}'}, "--policy"),
    ({"count": 2001}, "at most 2000"),
    ({"count": 1}, r"count.*at least 2"),
    ({"baseline": ("ranged",)}, "baseline needs --policy"),
])  # fmt: skip
def test_report_refuses_bad_options_before_playing(wanted, message, tmp_path):
    if wanted.get("scenarios", "").startswith("{"):
        (tmp_path / "mine.json").write_text(wanted["scenarios"])
        wanted = {**wanted, "scenarios": str(tmp_path / "mine.json")}
    with pytest.raises(ValueError, match=message):
        write(ReportOptions(out=tmp_path / "out", **wanted))
    assert not (tmp_path / "out").exists()


def test_report_leaves_out_set_ups_without_policies_and_says_so(tmp_path, capsys):
    archive = tmp_path / "policies" / "linear-blind.npz"
    archive.parent.mkdir()
    shutil.copy(SHIPPED / archive.name, archive)
    shutil.copytree(TUNED, tmp_path / "tuned")
    (matchup,) = report.matchups_of(ReportOptions(folder=tmp_path))
    assert matchup.name == "linear-blind"
    assert "paper-limits is left out, it has no policies yet: impact-gym train-seeds" in capsys.readouterr().out
    with pytest.raises(ValueError, match="there are no policies"):
        report.matchups_of(ReportOptions(setups=("paper-limits",), folder=tmp_path))
    archive.unlink()
    with pytest.raises(ValueError, match="no set-up has policies yet"):
        report.matchups_of(ReportOptions(folder=tmp_path))


def test_report_refuses_a_folder_that_no_report_wrote(tmp_path):
    (tmp_path / "letter").write_text("dear")
    with pytest.raises(ValueError, match="is not replaced"):
        write(ReportOptions(out=tmp_path, force=True))


def test_report_plays_and_writes_only_what_changed(tmp_path, monkeypatch, capsys):
    settings = ReportOptions(policy=("rigid-blind",), count=12, out=tmp_path / "out", processes=0)
    of_other_sources = tmp_path / ".out.episodes" / "0"
    of_other_sources.mkdir(parents=True)
    page = write(settings)
    assert not of_other_sources.exists()
    answer, before = capsys.readouterr().out, page.stat()
    (store,) = tmp_path.glob(".out.episodes/*/results.sqlite")
    (megabytes,) = re.findall(rf"results are kept in {store.parent}: about (\S+) MB in all", answer)
    assert float(megabytes) == pytest.approx(store.stat().st_size / 1e6, rel=0.4)
    performed = []

    def perform(function, arguments):
        performed.append(function)
        return job.perform(function, arguments)

    monkeypatch.setattr(local, "perform", perform)
    assert write(settings).stat().st_mtime_ns == before.st_mtime_ns
    assert capsys.readouterr().out.splitlines()[-1] == answer.splitlines()[-1]
    page.unlink()
    write(settings)
    assert performed == []
    (sentence,) = json.loads((tmp_path / "out" / "results.json").read_text())["sentences"]
    assert sentence == answer.splitlines()[-1]
    write(replace(settings, count=10))
    first_time = len(performed)
    assert first_time > 50
    write(replace(settings, count=10, force=True))
    assert len(performed) >= 2 * first_time


def test_table_without_rows_is_left_out():
    pages = Environment(loader=FileSystemLoader(EXPERIMENTS), autoescape=True)
    pages.filters["typeset"] = typeset
    table = pages.get_template("report/parts.html.jinja").module.table
    assert str(table(Table("changes", ("what", "V_p (m/s)"), ()))).strip() == ""
    html = str(table(Table("changes", ("what", "V_p (m/s)"), [("robot", "0.3")])))
    assert html.count("<th scope") == 3
    assert "0.3" in html
