"""The table of the bars says what was played."""

import csv
import math
import re

import numpy as np
import pytest
from policies import made_up_policy

from agents.baselines import ConstantSpeed, PaperTrapezoid, load_baseline
from agents.evaluate.stage import VALIDATION_SEED, evaluate
from agents.setups import README, load_setup
from agents.setups.evaluation import WEIGHTS
from experiments import bars
from experiments.bars import Settings, Study, median, policies, ratio
from experiments.bars_table import Bar, Row, markdown
from experiments.lab.statistics import Estimate

SCENARIOS = 30


def seeded(setup, seed, score=0.0):
    policy = made_up_policy(seed, {**load_setup(setup).environment, "time_weight": [0.5, 8.0]})
    policy.provenance["validation"] = {"score": score}
    return policy


def quick_bound(setup, weight, frozen, count):
    """No bound, but played on the same scenarios in a moment."""
    return evaluate(PaperTrapezoid(), VALIDATION_SEED, count, time_weight=weight, **load_setup(setup).environment)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Made-up policies: what is tested is the table, not they."""
    folder = tmp_path_factory.mktemp("bars")
    for setup in README:
        for seed, score in enumerate((0.5, 0.9, 0.7)):
            path = folder / "policies" / setup / f"seed-{seed}.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            seeded(setup, seed, score).save(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bars, "clairvoyant_bound", quick_bound)
        out, page = bars.write(
            Settings("validation", SCENARIOS, clairvoyant=4, policies=folder / "policies", out=folder / "bars")
        )
    with (out / "bars.csv").open(newline="") as file:
        return folder, page, list(csv.DictReader(file))


def means(rows, setup, controller, weight, scenarios=SCENARIOS):
    """Return the row of a controller; where it was played twice, at the same weight, the two are the same."""
    wanted = (setup, controller, weight, scenarios)
    fields = ("setup", "controller", "time_weight", "scenarios")
    found = [row for row in rows if (row[fields[0]], row[fields[1]], *(float(row[f]) for f in fields[2:])) == wanted]
    assert all(row == found[0] for row in found)
    return found[0]


def test_the_means_are_those_of_evaluation(written):
    folder, _, rows = written
    for setup in README:
        for weight in WEIGHTS:
            options = {"time_weight": weight, **load_setup(setup).environment}
            name = load_setup(setup).against[0]
            for controller, player in (
                ("paper-trapezoid", PaperTrapezoid()),
                (name, load_baseline(name, weight)),
                ("seed-1", policies(setup, folder / "policies")["seed-1"]),
            ):
                played = evaluate(player, VALIDATION_SEED, SCENARIOS, **options)
                row = means(rows, setup, controller, weight)
                assert float(row["loss"]) == pytest.approx(played.loss(weight).mean(), rel=1e-12)
                assert float(row["object_velocity"]) == pytest.approx(played.object_velocity.mean(), rel=1e-12)
                assert int(row["missed"]) == played.missed.sum()


def test_the_page_compares_the_median_seed_with_the_best_baseline(written):
    folder, page, rows = written
    assert (folder / "bars" / "bars.md").read_text() == page
    for setup in README:
        for weight in WEIGHTS:
            best = min(load_setup(setup).against, key=lambda name: float(means(rows, setup, name, weight)["loss"]))
            limit = float(means(rows, setup, best, weight)["loss"])
            ratios = [float(means(rows, setup, f"seed-{k}", weight)["loss"]) / limit for k in range(3)]
            (line,) = re.findall(rf"\| {setup} \| V_p \+ w T over that of {best}, w = {weight:g} \|.*", page)
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            assert cells[3] == f"{ratios[2]:.4f} (seed-2)"  # the middle score of 0.5, 0.9, 0.7
            assert cells[5:8] == [f"{value:.4f}" for value in sorted(ratios)]
            assert cells[8] == f"{sum(value <= 1 for value in ratios)} of 3"
            assert cells[9].startswith("met" if ratios[2] <= 1 else "missed")


def test_the_bound_and_those_beside_it_met_the_same_scenarios(written):
    folder, page, rows = written
    for setup in README:
        options = {"time_weight": 2.0, **load_setup(setup).environment}
        player = policies(setup, folder / "policies")["seed-2"]
        played = evaluate(player, VALIDATION_SEED, 4, **options).loss(2.0).mean()
        bound = quick_bound(setup, 2.0, "validation", 4).loss(2.0).mean()
        assert float(means(rows, setup, "seed-2", 2.0, 4)["loss"]) == pytest.approx(played, rel=1e-12)
        assert float(means(rows, setup, "clairvoyant", 2.0, 4)["loss"]) == pytest.approx(bound, rel=1e-12)
        assert re.search(rf"\| {setup} \| seed-2 \| 2 \| 4 \| {played:.4f} .*\| {played - bound:.4f} \|", page)


class Hurried:
    """Faster the higher the weight that it sees."""

    def __init__(self):
        self.environment = {"time_weight": [0.5, 8.0]}

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        weight = 2.0 * 16.0 ** observation[:, 7].astype(float)
        return ConstantSpeed(0.3 + 0.1 * weight).predict(observation, state)


def test_an_approach_no_later_is_the_latest_that_is_still_early_enough():
    study = Study(Settings("validation", 20, clairvoyant=0))
    limit = evaluate(ConstantSpeed(0.55), VALIDATION_SEED, 20).approach_time.mean()
    found = study.no_later("linear-blind", "hurried", Hurried(), limit)
    assert found.approach_time.mean() <= limit
    weight = next(row.time_weight for row in study.rows if row.approach_time == found.approach_time.mean())
    assert weight == pytest.approx(2.5, rel=0.02)
    assert study.no_later("linear-blind", "hurried", Hurried(), 0.01) is None
    slow = study.no_later("linear-blind", "hurried", Hurried(), 1.0)
    assert slow.approach_time.mean() == pytest.approx(
        evaluate(ConstantSpeed(0.35), VALIDATION_SEED, 20).approach_time.mean(), rel=1e-4
    )


def test_the_median_is_the_middle_score_and_of_two_the_worse():
    seeds = {f"seed-{k}": seeded("linear-blind", k, score) for k, score in enumerate((0.3, 0.1, 0.4, 0.2))}
    assert median(seeds) == "seed-0"
    del seeds["seed-2"]
    assert median(seeds) == "seed-3"
    assert median({"linear-blind": seeded("linear-blind", 0)}) == "linear-blind"


def test_a_policy_of_another_environment_is_not_measured(tmp_path):
    seeded("linear-ranged", 0).save(tmp_path / "linear-blind.npz")
    with pytest.raises(ValueError, match="linear-blind, linear-blind: trained in"):
        policies("linear-blind", tmp_path)
    assert policies("linear-ranged", tmp_path) == {}


def test_a_ratio_holds_its_interval_and_pairs_matter():
    rng = np.random.default_rng(0)
    base = rng.uniform(0.5, 5.0, 400)
    found = ratio((0.9 * base, base))
    assert (found.value, found.low, found.high) == pytest.approx((0.9, 0.9, 0.9))
    noisy = ratio((0.9 * rng.permutation(base), base))
    assert noisy.low < 0.9 < noisy.high
    assert ratio(None) is None


@pytest.mark.parametrize(("value", "interval", "verdict"), [
    (0.9, Estimate(0.9, 0.8, 0.95), "met"),
    (0.99, Estimate(0.99, 0.98, 1.01), "met, within the interval"),
    (1.01, Estimate(1.01, 0.99, 1.02), "missed, within the interval"),
    (1.1, Estimate(1.1, 1.05, 1.2), "missed"),
    (math.inf, None, "missed: no such approach"),
])  # fmt: skip
def test_a_verdict_says_what_the_interval_leaves_open(value, interval, verdict):
    bar = Bar("linear-blind", "a ratio", 1.0, "seed-0", interval, {"seed-0": value, "seed-1": 0.5})
    assert bar.verdict == verdict
    row = Row("linear-blind", "seed-0", 1.0, 10, 0.5, 0.2, 0.3, 0)
    bound = row._replace(controller="clairvoyant", loss=0.375)
    elsewhere = bound._replace(time_weight=2.0, loss=0.1)
    page = markdown(
        [bar], [row, row, elsewhere, bound], {"command": "c", "set": "s", "left out": [], "date": "d", "machine": "m"}
    )
    assert f"| {verdict} |" in page
    assert page.count("| seed-0 | 1 | 10 | 0.5000 | 0.2000 | 0.3000 | 0.1250 | 0 |") == 1
