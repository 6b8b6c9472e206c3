"""Range sensors that are sold: a tuned profile compared with the paper's rule at the same approach time."""

from collections.abc import Iterator
from typing import Any

from agents.setups import load_setup
from agents.setups.tuned import read_tuned
from experiments.lab import grid
from experiments.lab.parts import Section, Table
from experiments.lab.statistics import Estimate, Resamples, estimate, reduction, velocity_at_time_of
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from experiments.studies import QUESTIONS
from experiments.studies.sensors.learning import INPUTS, RIVALS, learn, rival
from impact_gym.sensors import PRESETS

STEPS, SLOW = 3_000_000, {"recurrent": 1_500_000}  # of a training; RecurrentPPO takes six times as long for a step
SEEDS, MORE = 3, {"filter": 10, "profile": 10}  # trainings; more with the two best inputs
WEIGHT = 2.0  # m/s per s, of the comparison with networks
AHEAD = "looking ahead"  # at each control step, as `ahead` says
OURS, TOLD = "filter and profile, as shipped", "filter and profile, told bias and scale"
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


def rivals(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each rival."""
    tuning, generations = (20, 1) if quick else (200, 30)
    for name in RIVALS:
        effort = {"tuning": tuning, "generations": 0 if name == AHEAD else generations}  # its tuning would take hours
        scenarios = {"set": "test", "count": 40 if quick else 2000}
        yield Cell({"rival": name, "seed": 0}, {"rival": name, "weight": WEIGHT, "scenarios": scenarios, **effort})


def networks(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each training; the networks play at the time weights of the set-up."""
    numbers = {"scenarios": {"set": "test", "count": 40 if quick else 2000}, "weights": [0.7, 1.0, WEIGHT, 4.0]}
    for name in INPUTS:
        steps = 0 if quick else SLOW.get(name, STEPS)
        for labels in ({"inputs": name, "seed": seed, "steps": steps} for seed in range(MORE.get(name, SEEDS))):
            yield Cell(labels, {**labels, **numbers})


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
    learned, answer = compared(frames, resamples)
    said = ", ".join(f"{sensor} {lower.partition(' [')[0]} %" for sensor, lower, _ in rows)
    said_of_inputs = "What the actors of PPO observe, beside the environment's observation: " + "; ".join(
        f"with {name}, {what}" for name, what in INPUTS.items()
    )
    sections = [Section("Sensors", [text, table]), Section("If nobody knows the sensor", [said_of_inputs, learned])]
    return Findings(f"V_p is lower than with the paper's rule by: {said}. {answer}", sections)


def compared(frames: Frames, resamples: Resamples) -> tuple[Table, str]:
    """Return the costs with the drawn sensor at the time weight WEIGHT, and what they say about learning."""
    at_weight = {name: frame.filter(weight=WEIGHT) for name, frame in frames.items()}
    profiles = at_weight["episodes"].filter(contestant=PROFILE)
    found = {"tuned profile without sensor": profiles.filter(sensor="none")}
    found |= {f"filter and profile, {name}": each for (name,), each in grid.groups(at_weight["rivals"], "rival")}
    found[OURS] = profiles.filter(sensor="drawn")
    found |= {f"PPO, {name}": each for (name,), each in grid.groups(at_weight["networks"], "inputs")}
    costs = {name: resamples.means(grid.sample(each, "cost")) for name, each in found.items()}
    less = {name: estimate(100.0 * (1.0 - cost / costs[OURS])) for name, cost in costs.items()}
    rows = [
        [name, f"{estimate(costs[name]):.3f}", "" if name == OURS else f"{less[name]:.1f}",
         f"{100.0 * each['missed'].to_numpy().mean():.1f}",
         f"{each['seed'].n_unique()} of {each['steps'][0]:,} steps" if "PPO" in name else ""]
        for name, each in found.items()
    ]  # fmt: skip
    best = max((name for name in less if "PPO" in name), key=lambda name: less[name].value)
    ahead, told = less[f"filter and profile, {AHEAD}"], less[TOLD]
    gains = "gains" if less[best].low > 0.0 else "does not gain"
    answer = (
        f"When nobody knows the sensor, a network {gains} over filter and profile: the best one ({best}) lowers the "
        f"cost by {less[best]:.1f} %; looking ahead at each control step, by {ahead:.1f} %; "
        f"telling the filter bias and scale, by {told:.1f} %."
    )
    caption = f"Cost V_p + {WEIGHT:g} T with the drawn sensor, and how much less than with {OURS}; 95 % intervals"
    heads = ("controller", "cost (m/s)", "less (%)", "missed (%)", "trainings")
    return Table(caption, heads, rows, "sensors-learning"), answer


PLAYED = (*grid.PLAYED, "agents.setups")
MEASURED = (
    Measurement("episodes", played, grid.play, PLAYED),
    Measurement("rivals", rivals, rival, (*PLAYED, "experiments.studies.sensors.ahead")),
    Measurement("networks", networks, learn, (*PLAYED, "agents.train")),
)
STUDY = Study("sensors", QUESTIONS["sensors"], MEASURED, analyse, ("torch", "stable-baselines3", "sb3-contrib"))
