"""Range sensors that are sold: a tuned profile compared with the paper's rule at the same approach time."""

from collections.abc import Iterator
from typing import Any

import polars as pl

from agents.setups import load_setup
from agents.setups.tuned import read_tuned
from experiments.lab import grid
from experiments.lab.parts import Section, Table
from experiments.lab.statistics import Comparison, Estimate, Resamples
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS
from impact_gym.sensors import PRESETS

SETUP, PROFILE, RULE = "sensed-robust", "sensed-robust-profile", "paper's rule"
KNOWN, UNKNOWN = "sensor known", "sensor unknown"
NONE, IDEAL, ANY = "none", "ideal", "drawn"
SENSORS: dict[str, Any] = {
    NONE: None, IDEAL: load_setup("linear-sensed").environment["range_sensor"], **{name: name for name in PRESETS},
    ANY: load_setup(SETUP).environment["range_sensor"],
}  # fmt: skip


def profile_over(sensor: str) -> dict[str, dict[str, Any]]:
    """Return the tuned profiles (JSON) that play with a sensor, by whether they know its data sheet."""
    if sensor in (NONE, IDEAL):
        return {KNOWN: {"baseline": {NONE: "blind-profile", IDEAL: "filtered-profile"}[sensor]}}
    return {KNOWN: {"baseline": PROFILE}, UNKNOWN: {"tuned": read_tuned(PROFILE)}}


def played(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each sensor and controller; a profile plays at all its time weights."""
    scenarios = {"set": "test", "count": 40 if quick else 2000}
    for sensor, numbers in SENSORS.items():
        environment = {**load_setup(SETUP).environment, "range_sensor": numbers}
        for who, controller in {RULE: {"baseline": "paper-trapezoid"}, **profile_over(sensor)}.items():
            name = controller.get("baseline", PROFILE)
            weights = [1.0] if who == RULE else sorted(map(float, read_tuned(name)["weights"]))
            labels = {"sensor": sensor, "contestant": who, "seed": 0}
            yield grid.cell(labels, controller, environment, scenarios, weights)


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare V_p at the rule's mean approach time."""
    episodes = frames["episodes"]
    resamples = Resamples(episodes["episode"].n_unique())
    found = {key: rows for key, rows in grid.groups(episodes, "sensor", "contestant")}
    rows = [[sensor, *(cell for who in (KNOWN, UNKNOWN) for cell in row(found, sensor, who, resamples))]
            for sensor in SENSORS]  # fmt: skip
    head = ("sensor", *(f"{what}, {who} (%)" for who in (KNOWN, UNKNOWN) for what in ("V_p lower", "missed")))
    caption = "V_p of a tuned profile below that of the paper's rule, at the rule's mean approach time"
    text = (
        f"95 % intervals over {resamples.scenarios} scenarios. Sensor known: the filter has the ranges in the data "
        f"sheet of this sensor. Sensor unknown: it has those of {SETUP}. The profile was tuned for {SETUP} in both "
        "cases, but for no sensor and the ideal sensor by their own set-ups. Missed: at the time weight at which most "
        "objects were missed."
    )
    said = [f"{sensor} {cells[0].partition(' [')[0]} %" for sensor, *cells in rows]
    table = Table(caption, head, rows, "sensors-slower")
    return Findings(
        f"V_p is lower than with the paper's rule by: {', '.join(said)}.", [Section("Sensors", [text, table])]
    )


def row(found: dict[Any, pl.DataFrame], sensor: str, who: str, resamples: Resamples) -> list[str]:
    """Return the table's two cells for a sensor and a controller; "-": it did not play."""
    if (sensor, who) not in found:
        return ["-", "-"]
    ours, rule = (grid.front_of(found[sensor, name], resamples) for name in (who, RULE))
    less: Estimate = Comparison.of_fronts(ours, rule).reduction
    lower = Estimate(*(100.0 * each for each in (less.value, less.low, less.high)))
    missed = found[sensor, who].group_by("weight").agg(pl.col("missed").mean())["missed"].max()
    return [f"{lower:.1f}", f"{100.0 * float(missed):.1f}"]


PLAYED = (*grid.PLAYED, "agents.setups")
STUDY = Study("sensors", QUESTIONS["sensors"], (Measurement("episodes", played, grid.play, PLAYED),), analyse)
