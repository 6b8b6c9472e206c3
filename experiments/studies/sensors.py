"""Range sensors that are sold: a tuned profile compared with the paper's rule at the same approach time."""

from collections.abc import Iterator
from typing import Any

from agents.setups import load_setup
from agents.setups.tuned import read_tuned
from experiments.lab import grid
from experiments.lab.parts import Section, Table
from experiments.lab.statistics import Estimate, Resamples, reduction, velocity_at_time_of
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS
from impact_gym.sensors import PRESETS

RULE, PROFILE = "paper's rule", "tuned profile"
SENSORS: dict[str, tuple[Any, str]] = {  # the argument `range_sensor`, and the baseline that plays
    "none": (None, "blind-profile"),
    "ideal": (load_setup("linear-sensed").environment["range_sensor"], "filtered-profile"),
    **{name: (name, "sensed-robust-profile") for name in PRESETS},
    "drawn": (load_setup("sensed-robust").environment["range_sensor"], "sensed-robust-profile"),
}


def played(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each sensor and controller; a profile plays at all its time weights."""
    scenarios = {"set": "test", "count": 40 if quick else 2000}
    for sensor, (numbers, baseline) in SENSORS.items():
        environment = {**load_setup("sensed-robust").environment, "range_sensor": numbers}
        tuned = read_tuned(baseline)  # as "tuned", the filter is told no other sensor than in its tuning
        weights = {RULE: [1.0], PROFILE: sorted(map(float, tuned["weights"]))}
        for who, controller in ((RULE, {"baseline": "paper-trapezoid"}), (PROFILE, {"tuned": tuned})):
            labels = {"sensor": sensor, "contestant": who, "seed": 0}
            yield grid.cell(labels, controller, environment, scenarios, weights[who])


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare V_p at the rule's mean approach time."""
    episodes = frames["episodes"]
    resamples, rows = Resamples(episodes["episode"].n_unique()), []
    for (sensor,), plays in grid.groups(episodes, "sensor"):
        each = {who: found for (who,), found in grid.groups(plays, "contestant")}
        profile, rule = (grid.front_of(each[who], resamples) for who in (PROFILE, RULE))
        less = reduction(velocity_at_time_of(rule, profile), rule[1][:, 0])
        lower = Estimate(*(100.0 * number for number in (less.value, less.low, less.high)))
        missed = max(grid.sample(found, "missed").mean() for _, found in grid.groups(each[PROFILE], "weight"))
        rows.append([sensor, f"{lower:.1f}", f"{100.0 * missed:.1f}"])
    text = (
        f"95 % intervals over {resamples.scenarios} scenarios. The profiles without a sensor and with the ideal one "
        "were tuned for that. With all others, sensed-robust-profile plays. It was tuned for sensors that differ from "
        "episode to episode, and is not told which one it has. Missed: at the time weight at which most objects were "
        "missed."
    )
    caption = "V_p of a tuned profile below that of the paper's rule, at the rule's mean approach time"
    table = Table(caption, ("sensor", "V_p lower (%)", "missed (%)"), rows, "sensors-slower")
    said = ", ".join(f"{sensor} {lower.partition(' [')[0]} %" for sensor, lower, _ in rows)
    return Findings(f"V_p is lower than with the paper's rule by: {said}.", [Section("Sensors", [text, table])])


PLAYED = (*grid.PLAYED, "agents.setups")
STUDY = Study("sensors", QUESTIONS["sensors"], (Measurement("episodes", played, grid.play, PLAYED),), analyse)
