"""The bench measures what it says beside Gymnasium's environments, and its arithmetic is right."""

import polars as pl
import pytest
from pages import text_of_a_page_that_stands_on_its_own
from studies import small_run

from experiments.lab.study import Cell
from experiments.studies import bench

QUICK = {"quick": True}


def test_page_has_rates_beside_gymnasiums_and_what_an_approach_costs(tmp_path):
    names, cases = (bench.SETUPS[0], bench.BATCH_SCALE), bench.cases()["coupling"]
    run = small_run(
        bench.STUDY, tmp_path, environments=[Cell({}, QUICK)], batch=[Cell({}, {})],
        rates=[Cell({"set-up": name}, {"name": name, **QUICK}) for name in names],
        cost=[Cell({"by": "coupling", "case": case}, {"environment": cases[case], **QUICK}) for case in [*cases][:2]],
    )  # fmt: skip
    run.write()
    text = text_of_a_page_that_stands_on_its_own(tmp_path, figures=0)
    assert all(word in text for word in (*names, bench.SCALE, "bytes held", "the default"))
    ours, _ = run.frames["rates"].to_dicts()
    assert 0.0 < ours["training, torch threads: 1"] < ours["environment"]  # which steps the same, and does not learn
    assert 0.0 < run.frames["batch"]["largest error in V_p, µm/s"].item() < 1.0  # what RTOL is chosen for
    rows = {(name, envs): (steps, ratio) for name, envs, steps, ratio in run.frames["environments"].rows()}
    steps, ratio = rows[bench.SCALE, 1]
    assert ratio == rows[bench.ID, 1][0] / steps
    assert {envs for name, envs in rows if name == bench.ID} == {1, *bench.SIZES[::2]}
    assert min(steps for steps, _ in rows.values()) > 0.0


def test_cost_is_beside_that_of_the_default():
    costs = pl.DataFrame({"case": ["rigid", "spring (the default)"], "microseconds": [5.0, 20.0]})
    assert bench.with_ratio(costs)["ratio"].to_list() == [0.25, 1.0]


@pytest.mark.parametrize("rounds", [1, 3])
@pytest.mark.parametrize(("takes", "steps", "expected"), [(0.25, 5, 20.0), (8.0, 4, 0.5)])
def test_rate_counts_every_step_of_the_calls_made(rounds, takes, steps, expected):
    now = [0.0]

    def wait():
        now[0] += takes

    assert bench.rate(wait, steps, 3.0, rounds, lambda: now[0]) == expected
