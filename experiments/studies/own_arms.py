"""Random set-ups of plausible arms, to find sentences of `impact-gym controller` that do not hold elsewhere."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import polars as pl
import tomli_w

from agents import check
from agents.evaluate.scenario_batch import Episodes, ScenarioBatch
from agents.evaluate.specs import controller_of, scenario_batch_of
from agents.policies import load_policy
from agents.setups import load_baseline, load_setup
from experiments import controller
from experiments.lab.parts import Section, Table
from experiments.lab.statistics import Resamples, reduction
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from experiments.report import ablation, choice, robustness, summary
from experiments.report.__main__ import comparisons_of
from experiments.report.comparisons import PAPER
from experiments.report.episodes import MISSED_TOO_OFTEN, ComparisonResults, selection_scenarios
from experiments.studies import QUESTIONS

ARMS, FEW = 30, 3
LIMITED_EVERY = 3  # one of so many arms also gets a limit
DEPENDS = ("impact_gym", "agents", "experiments.controller", "experiments.limits", "experiments.report")
FRESH_SEED, FRESH = 80_000_000, 1000  # first seed and number of scenarios that tuning, choice and report did not use
OUTSIDE = 1.1  # objects outside the set-up's range stand up to this factor nearer or farther
SHORT = {
    "training": {"steps": 20_000, "envs": 64, "seeds": 2, "validation_scenarios": 50}, "baselines": {"budget": 48},
    "evaluation": {"scenarios": 200, "weights": [1.0, 2.0], "curve": [1.0, 2.0, 4.0],
                   "varied": {"tool_mass": {"times": [1.3]}}},
}  # fmt: skip
"""Tables of the set-ups that make the searches short."""


def arm(seed: int) -> dict[str, Any]:
    """Return the arguments of the environment for a random plausible arm."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.3g}")

    def span(low: float, high: float, ratio: float) -> list[float]:
        return [first := log(low, high), first * float(f"{log(1.2, ratio):.3g}")]

    def one_of(*options: Any) -> Any:
        return options[rng.integers(len(options))]

    mass, top, near = log(0.05, 1.0), log(0.25, 1.8), log(0.04, 0.25)
    far = near + log(0.05, 0.5)
    spring = {"type": "SpringDamper", "stiffness": mass * log(300.0, 6000.0), "damping_ratio": log(0.2, 1.0)}
    deflects = {"tool_mass": mass, "coupling": spring, "acceleration_range": [log(0.3, 1.5), log(3.0, 15.0)]}
    mounts = one_of(
        deflects, {**deflects, "deflection_sensor": True}, {**deflects, "coupling": {"type": "Rigid"}},
        {"coupling": {"type": "Bistable"}, "acceleration_range": [0.5, log(3.0, 8.0)]},  # its stop holds a light tool
    )  # fmt: skip
    senses = one_of({}, {"range_noise": log(0.002, 0.03)}, {"range_sensor": {"share": log(0.02, 0.2)}},
                    {"alarm": "reading", "force_noise": log(0.05, 0.5)})  # fmt: skip
    robot = {"robot": {"type": "Robot", "mass": log(2.0, 10.0), "stiffness": log(2e4, 5e5), "damping": 50.0}}
    return {
        "reaction_delay": one_of(log(0.004, 0.03), span(0.004, 0.02, 3.0)), "alarm_threshold": log(0.5, 5.0),
        "velocity_range": [-log(0.05, 0.5), top],
        "scenario": {"object_mass": span(0.02, 0.5, 10.0), "contact_stiffness": span(1e3, 1e6, 30.0),
                     "restitution": [0.1, log(0.3, 0.9)], "distance": [near, far]},
        **mounts, **senses, **one_of({}, {}, robot), **one_of({}, {}, {"friction": log(0.05, 0.6)}),
    }  # fmt: skip


def faults(path: Path, limited: bool) -> Iterator[tuple[str, str]]:
    """Make a controller of the set-up in a file; yield (invariant, what breaks it). `limited`: also with a limit."""
    setup, out = load_setup(path), path.parent / "out"
    options, task = controller.ControllerOptions(str(path), out, quick=True, processes=0), setup.task
    controller.run(options)
    (comparison,) = comparisons_of(controller.stages(out / path.name, options)["report"][1])
    (file,) = (out / "report").glob("episodes.*")
    rows = pl.read_csv(file, infer_schema_length=None) if file.suffix == ".csv" else pl.read_parquet(file)
    results = ComparisonResults.of_rows(comparison, rows)
    found, weight, means = choice.choice(results), comparison.typical, Resamples(FRESH).means
    specs = {each.name: each.controller for each in choice.simplest_first(comparison)}

    def fresh(name: str, **ranges: Any) -> Episodes:
        own = selection_scenarios(comparison.scenarios)["ranges"]
        scenarios = {"ranges": own | ranges, "seed": FRESH_SEED, "count": FRESH}
        return scenario_batch_of(scenarios, weight, task, lenient=True).play(controller_of(specs[name], weight, task))

    played = {name: fresh(name) for name in specs}
    costs, ours = {name: each.loss(weight) for name, each in played.items()}, played[found.controller]
    for name, claimed in found.above.items():
        more = costs[found.controller] - costs[name]
        # the choice, on 2,000 scenarios, allows 1.96 / sqrt(2) standard errors of these 1,000; chance adds 2.6
        if more.mean() > 4.0 * more.std() / FRESH**0.5:
            yield "recommended is best", f"{name} costs {more.mean():.3f} m/s less than {found.controller}"
        again = -reduction(means(costs[name]), means(costs[found.controller]))
        if abs(again.value - claimed.value) > again.high - again.low + claimed.high - claimed.low:
            yield "claims are true", f"{name} costs {claimed:.3f} more, but {again:.3f} in fresh scenarios"
    for step in ablation.steps_of(results):
        yield from (("no share above 100 %", f"{step.contestant}: {share:.2f}")
                    for share in (step.velocity.share, step.loss.share) if share and share.value > 1.0)  # fmt: skip
    said, at = summary.summary(results), results.paper.means(weight)["T"]
    for name, claims in ((comparison.chosen, said.reached), (comparison.rival.name, said.rival_reduction is not None)):
        times = [time for time, _ in results.runs[name].front]
        if claims and not min(times) <= at <= max(times):
            yield "numbers at equal times", f"{name} takes {min(times):.3f} to {max(times):.3f} s, the rule {at:.3f} s"
    (near, far), (called, worst, details) = task.scenario.distance, robustness.where_it_fails(results, found.controller)
    named = f"{called} {worst} {details.partition('Tried')[0]}"
    for place, word in (([far, OUTSIDE * far], "farther"), ([near / OUTSIDE, near], "nearer")):
        missed = fresh(found.controller, distance=place).missed.mean() - ours.missed.mean()
        if missed > 3.0 * MISSED_TOO_OFTEN and word not in named:
            yield "failures outside are named", f"{100 * missed:.0f} % more are missed at {place} m, but: {named}"
    printed = re.search(
        r"objects at ([\d.]+) m/s \(mean\).* after ([\d.]+) s and misses (\d+)", " ".join(check.lines(setup))
    )
    velocity, time, missed = map(float, printed.groups()) if printed else (np.nan,) * 3
    of_rule = played[PAPER]
    for what, value, values in (
        ("V_p", velocity, of_rule.object_velocity[~of_rule.missed]), ("T", time, of_rule.approach_time),
        ("missed", missed / check.SAMPLE, of_rule.missed),
    ):  # fmt: skip
        error = (values.std() + 1e-3) * (1.0 / values.size + 1.0 / check.SAMPLE) ** 0.5 if values.size else 0.0
        if values.size and not abs(value - values.mean()) < 4.0 * error + 1e-3:
            yield "check agrees with the report", f"{what} of the rule: {value:g}, but {values.mean():g}"
    if limited:  # 10 % below what the recommended controller reaches without a limit
        options = replace(options, max_velocity=0.9 * float(np.quantile(ours.object_velocity, 0.95)))
        controller.run(options)
        chosen = json.loads((out / controller.RECOMMENDED).read_text())
        name, weight = chosen["controller"], chosen["time_weight"]
        loaded: Any = load_policy(name) if chosen["kind"] == "policy" else load_baseline(name, weight)
        player = loaded if chosen["kind"] == "policy" else loaded.for_task(task)
        batch = ScenarioBatch(FRESH_SEED, FRESH, task, time_weight=[weight], threads=1, lenient=True)
        (reached,) = options.reached(batch.play(player)).values()
        if reached.low > options.given["max_velocity"]:
            yield "limits are kept", f"95 % reach {reached:.3f} m/s; the limit is {options.max_velocity:.3f} m/s"


def judged(seed: int) -> list[dict[str, str]]:
    """Return a row for each fault of a random arm; of one without faults, a row with an empty fault."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"arm-{seed}.toml")
        path.write_text(tomli_w.dumps(SHORT | {"environment": arm(seed)}))
        found = list[tuple[str, str]]()
        try:
            found += faults(path, seed % LIMITED_EVERY == 0)
        except (ValueError, RuntimeError) as error:  # of the header too: its commands are compared with Python's
            reason = str(error).replace("\n", " ")
            found += [] if "no controller of this arm keeps" in reason else [("it runs", reason)]
    return [{"invariant": invariant, "fault": fault} for invariant, fault in found or [("all", "")]]


def analyse(frames: Frames, _: bool) -> Findings:
    """Count the arms without faults, and list the faults."""
    rows, columns = frames["arms"], {"arm": "{arm}", "invariant": "{invariant}", "fault": "{fault}"}
    broken, count = rows.filter(pl.col("fault") != ""), rows["arm"].n_unique()
    answer = f"{count - broken['arm'].n_unique()} of {count} random arms have no fault."
    return Findings(answer, [Section("Faults", [Table.of("What does not hold, and where", broken, columns)])])


def arms(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each arm."""
    return (Cell({"arm": seed}, {"seed": seed}) for seed in range(FEW if quick else ARMS))


STUDY = Study("own-arms", QUESTIONS["own-arms"], [Measurement("arms", arms, judged, DEPENDS)], analyse)
