"""Measured hits: made up with known numbers, and files that are no table of hits."""

import csv

import numpy as np
import pytest
from pages import text_of_a_page_that_stands_on_its_own

from experiments.lab import experiment
from experiments.measured import __main__ as measured
from experiments.measured import hits
from impact_gym.physics.impact import free_tool, sliding_distance

E, MU = 0.6, 0.25
COLUMNS = {"distance": "way", "flux": "phi", "by": ["arm"], "repeat": ["asked"], "at_least": {"way": 0.01}}


def written(folder, count=400, noise=0.1, seed=0, bad=()):
    """A table of hits that our closed forms make, distances off by a share; rows that are none on top."""
    rng, path = np.random.default_rng(seed), folder / "hits.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["arm", "asked", "phi", "way"])
        for k in range(count):
            asked = 0.5 + 0.1 * (k // 2 % 5)
            speed, mass, target = 2.0 * asked * rng.normal(1.0, 0.02), 4.0, 1.2
            kept = float(free_tool(mass, target, speed, 0.0, E)[1])
            way = float(sliding_distance(kept, MU)) * np.exp(rng.normal(0.0, noise))
            writer.writerow([k % 2, f"{asked:.1f}", mass * speed / (mass + target), way])
        writer.writerows(bad)
    return path


def test_one_number_is_found_and_its_error_on_other_hits_is_that_of_repeats(tmp_path):
    one, two = hits.read(
        written(tmp_path, 2000, bad=[[0, "x", "nan", 1.0], [0, "x", 0.5, ""], [0, "x", 0.5, -1.0]]), **COLUMNS
    )
    assert (one.name, len(one.flux), one.left_out, two.left_out) == ("hits arm 0", 1000, 3, 0)
    assert hits.number_of(one.flux, one.distance) == pytest.approx((1 + E) ** 2 / (2 * MU * 9.80665), rel=0.02)
    middle, most, held = hits.errors(one, hits.MODELS[hits.BLOW])
    assert middle == pytest.approx(0.0674 * 1.0, rel=0.1)  # of exp(N(0, 0.1)): 0.6745 sigma
    assert most == pytest.approx(0.2, rel=0.15)
    assert held == pytest.approx(0.95, abs=0.02)
    spread = hits.spread(one)
    assert spread[2] == 1000
    assert middle / spread[0] == pytest.approx(1.0, abs=0.15)
    assert hits.errors(one, hits.MODELS[hits.BLOW], two)[0] == pytest.approx(middle, rel=0.15)
    assert hits.errors(one, hits.MODELS["always the same, one"])[0] > 2.0 * middle


def test_page_stands_on_its_own(tmp_path):
    sets = hits.read(written(tmp_path), **COLUMNS)
    compute, show = (lambda gather: measured.computed(sets, gather)), (lambda tables: measured.shown(sets, tables))
    experiment.run("measured", tmp_path / "page", "test", compute, show, processes=0)
    text = text_of_a_page_that_stands_on_its_own(tmp_path / "page", figures=1)
    assert all(each.name in text for each in sets)


@pytest.mark.parametrize(("change", "message"), [
    ({"flux": "speed"}, r"hits.csv has no column 'speed', there are \['arm'"),
    ({"by": ["asked", "arm", "phi"]}, "hits.csv has sets of .* hits, 20 or more are needed"),
    ({"at_least": {"way": 1e9}}, r"hits.csv has sets of \[0, 0\] hits"),
])  # fmt: skip
def test_tables_that_are_none_are_refused_in_one_line(change, message, tmp_path):
    with pytest.raises(ValueError, match=message) as refusal:
        hits.read(written(tmp_path), **COLUMNS | change)
    assert "\n" not in str(refusal.value)


def test_log_of_one_blow_belongs_to_another_command(tmp_path):
    (tmp_path / "log.csv").write_text("time,force\n0,1\n1,2\n")
    with pytest.raises(ValueError, match="is the log of one blow, not a table of hits: impact-gym identify"):
        hits.read(tmp_path / "log.csv", **COLUMNS)
    for text in ("way", "=3", "way=x", "way=inf"):
        with pytest.raises(ValueError, match="at_least must be COLUMN=NUMBER"):
            hits.least([text])
