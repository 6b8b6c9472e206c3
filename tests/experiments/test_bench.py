"""The bench measures the parts asked for, writes them whole or not at all, and its arithmetic is right."""

import json

import polars as pl
import pytest

from experiments.bench import __main__ as bench
from experiments.bench import environments
from experiments.bench.__main__ import BenchOptions


def test_run_writes_and_prints_the_parts_asked_for_and_no_others(tmp_path, capsys):
    bench.run(BenchOptions(("models",), quick=True, out=tmp_path / "bench"))
    written = json.loads((tmp_path / "bench/results.json").read_text())
    assert written.keys() & bench.PARTS.keys() == {"models"}
    assert {"machine", "date", "versions", "load_before"} <= written.keys()
    models, advised = written["models"].values()
    assert all(0 <= model["within"] <= model["scenes"] <= 30 for model in models)
    assert 0 < advised[0]["scenes that need no more"] <= sum(model["within"] for model in models)
    tables = (tmp_path / "bench/tables.md").read_text()
    assert all(f"| {model['model']} " in tables for model in models)
    assert tables in capsys.readouterr().out


def test_run_leaves_an_earlier_one_as_it_was_where_a_part_fails(tmp_path):
    def fail(quick):
        raise RuntimeError("no clock")

    measures = {"models": lambda quick: {"a table": pl.DataFrame({"number": [1]})}, "cost": fail}
    bench.run(BenchOptions(("models",), out=tmp_path / "bench"), measures)
    before = (tmp_path / "bench/results.json").read_text()
    with pytest.raises(RuntimeError, match="no clock"):
        bench.run(BenchOptions(("models", "cost"), out=tmp_path / "bench"), measures)
    assert (tmp_path / "bench/results.json").read_text() == before
    assert [path.name for path in tmp_path.iterdir()] == ["bench"]


def test_three_rates_are_measured_for_a_set_up():
    ((title, table),) = environments.three_rates(quick=True, setups=["linear-blind"]).items()
    training = "training, torch threads: 1"
    assert "steps per second" in title
    assert table.columns == ["set-up", "environments", "environment", "environment with inference", training]
    assert table["set-up"].to_list() == ["linear-blind", environments.BATCH_SCALE, environments.SCALE]
    assert (table[training] > 0.0).all()
    assert (table["environment"] > table[training]).all()  # which steps the same, and learns


def test_environments_are_measured_beside_those_of_gymnasium():
    table = environments.stepped(quick=True)
    rows = {(name, envs): (steps, ratio) for name, envs, steps, ratio in table.rows()}
    steps, ratio = rows["Pendulum-v1", 1]
    assert ratio == rows["ImpactApproach-v0", 1][0] / steps
    assert {envs for name, envs in rows if name == "ImpactApproach-v0"} == {1, *environments.SIZES[::2]}
    assert min(steps for steps, _ in rows.values()) > 0.0


@pytest.mark.parametrize("rounds", [1, 3])
@pytest.mark.parametrize(("takes", "steps", "expected"), [(0.25, 5, 20.0), (8.0, 4, 0.5)])
def test_rate_counts_every_step_of_the_calls_made(rounds, takes, steps, expected):
    now = [0.0]

    def wait():
        now[0] += takes

    assert environments.rate(wait, steps, 3.0, rounds, lambda: now[0]) == expected


def test_markdown_has_three_digits():
    table = pl.DataFrame({"solver": ["ours", "Ray"], "steps": [1234567.0, 0.00012345], "hours": [None, 12_345]})
    assert bench.markdown(table).splitlines() == [
        "| solver | steps | hours |", "| --- | --- | --- |", "| ours | 1,230,000 |  |", "| Ray | 0.000123 | 12,345 |",
    ]  # fmt: skip
