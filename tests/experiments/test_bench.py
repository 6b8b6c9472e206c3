"""The bench measures the parts asked for, writes them whole or not at all, and its arithmetic is right."""

import json
import sys

import polars as pl
import pytest

from experiments.bench import __main__ as bench
from experiments.bench import jobs, rates


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["bench", *map(str, arguments)])
    bench.main()


def test_a_run_writes_and_prints_the_parts_asked_for_and_no_others(monkeypatch, tmp_path, capsys):
    run(monkeypatch, "models", "--quick", "--out", tmp_path / "bench")
    written = json.loads((tmp_path / "bench/results.json").read_text())
    assert "models" in written
    assert not {"approaches", "environments", "rates", "jobs", "ten-million"} & written.keys()
    assert {"machine", "date", "versions", "load_before"} <= written.keys()
    models, advised = written["models"].values()
    assert all(0 <= model["within"] <= model["scenes"] <= 30 for model in models)
    assert 0 < advised[0]["scenes that need no more"] <= sum(model["within"] for model in models)
    tables = (tmp_path / "bench/tables.md").read_text()
    assert all(f"| {model['model']} " in tables for model in models)
    assert tables in capsys.readouterr().out


def test_a_part_that_fails_leaves_an_earlier_run_as_it_was(monkeypatch, tmp_path):
    def fail(quick):
        raise RuntimeError("no clock")

    monkeypatch.setitem(bench.PARTS, "models", lambda quick: {"a table": pl.DataFrame({"number": [1]})})
    run(monkeypatch, "models", "--out", tmp_path / "bench")
    before = (tmp_path / "bench/results.json").read_text()
    monkeypatch.setitem(bench.PARTS, "jobs", fail)
    with pytest.raises(SystemExit, match=r"experiments\.bench: no clock"):
        run(monkeypatch, "models", "jobs", "--out", tmp_path / "bench")
    assert (tmp_path / "bench/results.json").read_text() == before
    assert [path.name for path in tmp_path.iterdir()] == ["bench"]


def test_the_three_rates_are_measured_for_each_set_up():
    ((title, table),) = rates.measure(quick=True).items()
    assert "steps per second" in title
    assert table.columns == ["set-up", "environments", "environment", "environment with inference", "training"]
    assert table["set-up"].to_list() == list(rates.SETUPS)
    assert (table["training"] > 0.0).all()
    assert (table["environment"] > table["training"]).all()  # which steps the same, and learns


def test_a_part_that_is_not_there_is_refused(monkeypatch, capsys):
    with pytest.raises(SystemExit) as raised:
        run(monkeypatch, "fidelity")
    assert raised.value.code == 2
    assert "fidelity" in capsys.readouterr().err


def test_a_printed_table_is_markdown_with_three_digits():
    table = pl.DataFrame({"solver": ["ours", "Ray"], "steps": [1234567.0, 0.00012345], "hours": [None, 2.0]})
    assert [line.split() for line in bench.markdown(table).splitlines()] == [
        ["|", "solver", "|", "steps", "|", "hours", "|"],
        ["|--------|-----------|-------|"],
        ["|", "ours", "|", "1,230,000", "|", "null", "|"],
        ["|", "Ray", "|", "0.000123", "|", "2", "|"],
    ]


def test_a_cluster_takes_its_start_and_the_longer_of_computing_and_gathering():
    hours, seconds = 160.0, jobs.WHOLE / jobs.PER_JOB  # of computing on one core, of gathering at a second a job
    grid = {f"{jobs.WHOLE:,}, core hours": hours, "first result, s": 3.0}
    one, ten, hundred = jobs.extrapolated(grid, grid, {"ms a job": 1000.0}).to_dicts()
    assert (one["nodes"], ten["nodes"], hundred["nodes"]) == (1, 10, 100)
    assert one["in all, s"] == 3.0 + hours * 3600.0 / 16
    assert ten["compute, s"] == one["compute, s"] / 10
    assert hundred["in all, s"] == 3.0 + seconds


def test_a_blank_result_has_the_size_of_a_real_one():
    real = jobs.play(jobs.CONTROLLERS[jobs.RULE], jobs.scenarios(jobs.PER_JOB))
    blank = jobs.blank(0)
    assert {name: values.nbytes for name, values in blank.items()} == {name: v.nbytes for name, v in real.items()}
