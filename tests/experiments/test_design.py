"""The page of a study of designs, and the checks of the search and of one tuning for all sizes."""

import numpy as np
import pytest
from browsers import chromium, opened

from agents.archive import write_archive
from agents.design.__main__ import FORMAT
from experiments.design.__main__ import read, reduction, show
from experiments.design_check import agreement, sizes
from experiments.lab.statistics import Resamples
from experiments.lab.tables import rows_of

SCENARIOS = 40


@pytest.fixture
def study(tmp_path):
    """A study as `agents.design` writes it: V_p falls by 0.5 m/s per s from one approach time to the next."""
    shares = [("paper's rule", 1.0, 0.6), ("designs", 1.0, 0.2), ("chosen", 1.1, 0.17), ("chosen", 0.9, 0.23)]
    shares += [("designs", 1.2, 0.1)]
    entries = [{"line": line, "share": share, "design": {"tool_mass": 0.1}, "pad": ""} for line, share, _ in shares]
    arrays = {}
    for place, (_, share, velocity) in enumerate(shares):
        same = {"approach_time": 0.3 * share, "object_velocity": velocity, "deflection": 0.01, "stroke": 0.02}
        same |= {"peak_force": 9.0, "contact_count": 1.0, "missed": 0.0, "energy": 0.1}
        arrays |= {f"{name}_{place}": np.full(SCENARIOS, value) for name, value in same.items()}
        arrays[f"distance_{place}"] = np.linspace(0.15, 0.35, SCENARIOS)
    content = {"command": "python -m agents.design", "seconds": 1.0, "setup": "linear-blind", "entries": entries}
    write_archive(tmp_path / "designs.npz", FORMAT, content, arrays)
    return tmp_path


def test_a_line_is_read_at_the_mean_approach_time_of_the_papers_rule(study):
    _, lines = read(study)
    assert lines["chosen"].mean("approach_time") == pytest.approx([0.27, 0.33])
    found = reduction(lines["chosen"], lines["paper's rule"], Resamples(SCENARIOS))
    assert (found.value, found.low, found.high) == pytest.approx((1.0 - 0.2 / 0.6,) * 3)


def test_the_page_says_what_the_chosen_design_gains_and_lists_every_design(study):
    text = show(study).read_text()
    assert "66.7 % [66.7, 66.7] slower" in text
    assert text.count('<td class="words">tool_mass 0.1</td>') == 5
    assert "10.0 mm against the flange" in text


def test_the_slider_of_the_page_goes_through_the_designs_of_the_front(study):
    path = show(study)
    with chromium() as browser:
        page, problems = opened(browser, path)
        assert "V_p 0.200 m/s" in page.inner_text("#design")
        page.fill("#which", "1")
        assert "V_p 0.100 m/s, 10.0 mm" in page.inner_text("#design")
        assert page.inner_text("#time") == "0.360 s"
        assert problems == []


def test_a_folder_without_a_study_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"designs\.npz"):
        read(tmp_path)


def test_the_papers_point_of_the_map_is_that_of_its_figure_23():
    """V_p 0.45074 m/s with the mechanism and 0.692859 m/s with the spring, by an independent solver."""
    rows = rows_of(sizes.row_of_masses("object", 1.0, [0.25]))
    assert rows[0]["mechanism"] == pytest.approx(0.45074, rel=1e-4)
    assert rows[0]["spring"] == pytest.approx(0.692859, rel=1e-4)
    assert rows[0]["modified"] <= rows[0]["mechanism"]
    assert rows_of(sizes.row_of_masses("both", 1.0, [0.25])) == [rows[0] | {"kind": "both"}]


def test_a_spring_of_the_grid_stays_as_it_is_and_a_free_one_is_found_within_its_range(monkeypatch):
    monkeypatch.setitem(agreement.SEARCH, "scenarios", 10)
    monkeypatch.setattr(agreement, "TEST", ["test", 50])
    (kept,) = rows_of(agreement.found(0.31, 16, [60.0, 0.4], 1))
    assert (kept["stiffness"], kept["damping_ratio"]) == (60.0, 0.4)
    (free,) = rows_of(agreement.found(0.31, 16, [], 1))
    assert agreement.STIFFNESS.low <= free["stiffness"] <= agreement.STIFFNESS.high
    assert free["low"] <= free["velocity"] <= free["high"]
