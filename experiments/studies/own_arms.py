"""Random set-ups of plausible arms, to find sentences of `impact-gym controller` that do not hold elsewhere."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import polars as pl

from agents import check
from agents.evaluate.play import play
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.policies import load_policy
from agents.setups import Setup, load_baseline, load_setup
from experiments import controller
from experiments.lab.parts import Section, Table
from experiments.lab.statistics import Estimate, Resamples, reduction
from experiments.lab.study import Cell, Findings, Frames, Measurement, Study
from experiments.report import ablation, choice, robustness, summary
from experiments.report.__main__ import comparisons_of
from experiments.report.comparisons import PAPER
from experiments.report.episodes import MISSED_TOO_OFTEN, ComparisonResults, selection_scenarios
from experiments.studies import QUESTIONS

ARMS, FEW = 30, 3
LIMITED_EVERY = 3  # of so many arms, one also gets a limit
DEPENDS = ("impact_gym", "agents", "experiments.controller", "experiments.limits", "experiments.report")
FRESH_SEED, FRESH = 80_000_000, 1000  # first seed and number of scenarios in which nothing was tuned, chosen or judged
FARTHER = 1.1  # objects just outside the range stand up to this factor farther away
SHORT = {"training.steps": 20_000, "training.envs": 64, "training.seeds": 2, "training.validation_scenarios": 50,
         "baselines.budget": 96, "evaluation.scenarios": 200}  # fmt: skip
"""Numbers of a short search."""


def arm(seed: int) -> dict[str, Any]:
    """Return the arguments of the environment for a random plausible arm."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.3g}")

    def span(low: float, high: float, ratio: float) -> list[float]:
        first = log(low, high)
        return [first, float(f"{first * rng.uniform(1.2, ratio):.3g}")]

    mass, top, near = log(0.05, 1.0), log(0.25, 1.8), log(0.04, 0.25)
    far = float(f"{near + log(0.05, 0.5):.3g}")
    spring = {"type": "SpringDamper", "stiffness": log(100.0, 2000.0) * mass / 0.3, "damping_ratio": log(0.2, 1.0)}
    sensors: list[dict[str, Any]] = [
        {}, {"range_noise": log(0.002, 0.03)}, {"range_sensor": {"share": log(0.02, 0.2)}},
        {"alarm": "reading", "force_noise": log(0.05, 0.5)}, {"deflection_sensor": True},
    ]  # fmt: skip
    environment: dict[str, Any] = {
        "tool_mass": mass, "coupling": [spring, spring, {"type": "Rigid"}, {"type": "Bistable"}][rng.integers(4)],
        "reaction_delay": [log(0.004, 0.03), span(0.004, 0.02, 3.0)][rng.integers(2)], "alarm_threshold": log(0.5, 5.0),
        "velocity_range": [-log(0.05, 0.5), top], "acceleration_range": [log(0.3, 1.5), log(3.0, 15.0)],
        "horizon": float(np.ceil(50.0 * far / top) / 10.0),
        "scenario": {"object_mass": span(0.02, 0.5, 10.0), "distance": [near, far],
                     "contact_stiffness": span(1e3, 1e6, 30.0), "restitution": [0.1, float(rng.uniform(0.3, 0.9))]},
    }  # fmt: skip
    more = sensors[rng.integers(len(sensors))]
    if environment["coupling"] == {"type": "Bistable"}:  # its stop holds light tools
        environment |= {"tool_mass": 0.125, "acceleration_range": [0.5, 8.0]}
    if "deflection_sensor" in more and environment["coupling"] == {"type": "Rigid"}:
        more = {}
    if rng.random() < 0.3:
        environment["robot"] = {"type": "Robot", "mass": log(2.0, 10.0), "stiffness": log(2e4, 5e5), "damping": 50.0}
    if rng.random() < 0.3:
        environment["friction"] = log(0.05, 0.6)
    return environment | more


def toml(content: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """Yield the lines of a TOML file; each number has its dotted path."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from toml(value, f"{path}{name}.")
        else:
            yield f"{path}{name} = {json.dumps(value)}"


class Run:
    """What `impact-gym controller --quick` says of a set-up, beside scenarios that had no part in it."""

    def __init__(self, setup: Setup, out: Path) -> None:
        """Make a controller of the set-up in the folder `out`."""
        self.setup, self.out = setup, out
        self.options = controller.ControllerOptions(str(setup.path), out, quick=True, processes=0)
        controller.run(self.options)
        self.page = controller.stages(out / setup.path.name, self.options)["report"][1]
        (self.comparison,) = comparisons_of(self.page)
        file = next((out / "report").glob("episodes.*"))
        rows = pl.read_csv(file, infer_schema_length=None) if file.suffix == ".csv" else pl.read_parquet(file)
        self.results = ComparisonResults.of_rows(self.comparison, rows)
        self.choice, self.summary = choice.choice(self.results), summary.summary(self.results)
        self.specs = {each.name: each.controller for each in choice.simplest_first(self.comparison)}

    def fresh(self, name: str, weight: float, **ranges: Any) -> dict[str, Any]:
        """Return the results (scenarios,) of a contestant in fresh scenarios; `ranges` replace those of the set-up."""
        own = selection_scenarios(self.comparison.scenarios)["ranges"]
        scenarios = {"ranges": own | ranges, "seed": FRESH_SEED, "count": FRESH}
        played = play(self.specs[name], scenarios, [weight], self.comparison.environment, lenient=True)
        return {key: values[0] if np.ndim(values) == 2 else values for key, values in played.items()}

    def faults(self) -> Iterator[tuple[str, str]]:
        """Yield (invariant, what breaks it)."""
        found, weight, task = self.choice, self.choice.time_weight, self.setup.task
        played, means = {name: self.fresh(name, weight) for name in self.specs}, Resamples(FRESH).means
        costs = {name: each["object_velocity"] + weight * each["approach_time"] + task.missed_cost * each["missed"]
                 for name, each in played.items()}  # fmt: skip
        ours = costs[found.controller]
        for name, claimed in found.above.items():
            more, again = ours - costs[name], -reduction(means(costs[name]), means(ours))
            # the choice, on 2,000 scenarios, allows 1.96 / sqrt(2) standard errors; chance here adds 2.6
            if more.mean() > 4.0 * more.std() / FRESH**0.5:
                yield "recommended is best", f"{name} costs {more.mean():.3f} m/s less than {found.controller}"
            if apart(claimed, again):
                yield "claims are true", f"{name}: {claimed:.3f} above, but {again:.3f} in fresh scenarios"
        for step in ablation.steps_of(self.results):
            for share in (step.velocity.share, step.loss.share):
                if share is not None and share.value > 1.0:
                    yield "no share above 100 %", f"{step.contestant}: {share:.2f}"
        at = self.results.paper.means(weight)
        for name, claims in ((self.comparison.chosen, self.summary.reached),
                             (self.comparison.rival.name, self.summary.rival_reduction is not None)):  # fmt: skip
            times = [time for time, _ in self.results.runs[name].front]
            if claims and not min(times) <= at["T"] <= max(times):
                yield "numbers at equal times", f"{name} at {at['T']:.3f} s, but it takes {min(times):.3f} s or more"
        near, far = task.scenario.distance
        said = " ".join(robustness.where_it_fails(self.results, found.controller))
        for words, place in (("farther", [far, FARTHER * far]), ("nearer", [near / FARTHER, near])):
            missed = self.fresh(found.controller, weight, distance=place)["missed"].mean()
            if missed > 3.0 * MISSED_TOO_OFTEN + played[found.controller]["missed"].mean() and "distance" not in said:
                yield "failures outside are named", f"misses {100 * missed:.0f} % at {place} m ({words}): {said}"
        text = " ".join(check.lines(self.setup))
        rule = re.search(r"object ([\d.]+) m/s \(mean\), .* after ([\d.]+) s and misses (\d+)", text)
        velocity, time, missed = map(float, rule.groups()) if rule else (np.nan,) * 3
        fresh = self.fresh(PAPER, weight)
        touched = fresh["object_velocity"][~fresh["missed"].astype(bool)]
        for what, value, values in (("V_p", velocity, touched), ("T", time, fresh["approach_time"]),
                                    ("missed", missed / check.SAMPLE, fresh["missed"])):  # fmt: skip
            error = (values.std() + 1e-3) * (1 / len(values) + 1 / check.SAMPLE) ** 0.5 + 1e-3
            if not abs(value - values.mean()) < 4.0 * error:
                yield "check agrees with the report", f"{what} of the rule: {value:g}, but {values.mean():g}"
        recommended = json.loads((self.out / controller.RECOMMENDED).read_text())
        if recommended["measured"]["mean_time"] != self.results.runs[found.controller][weight].approach_time.mean():
            yield "recommended.json is the report's", str(recommended)

    def limit_faults(self) -> Iterator[tuple[str, str]]:
        """Yield what breaks a limit on V_p, 10 % below what the recommended controller reaches without a limit."""
        found = self.choice
        played = self.fresh(found.controller, found.time_weight)
        limit = 0.9 * float(np.quantile(played["object_velocity"], 0.95))
        options = replace(self.options, max_velocity=limit)
        try:
            controller.run(options)
        except ValueError as error:
            if "no controller of this arm keeps" not in str(error):
                raise
            return
        recommended = json.loads((self.out / controller.RECOMMENDED).read_text())
        name, weight, task = recommended["controller"], recommended["time_weight"], self.setup.task
        player = load_policy(name) if recommended["kind"] == "policy" else load_baseline(name, weight).for_task(task)
        batch = ScenarioBatch(FRESH_SEED, FRESH, task, time_weight=[weight], threads=1, lenient=True)
        (reached,) = options.reached(batch.play(player)).values()
        if reached.low > limit:
            yield "limits are kept", f"95 % of V_p at or below {reached:.3f} m/s, but the limit is {limit:.3f} m/s"


def apart(one: Estimate, other: Estimate) -> bool:
    """Return whether two intervals of 95 % lie apart, even if each is half as wide again."""
    wide = [(each.value - 1.5 * (each.value - each.low), each.value + 1.5 * (each.high - each.value))
            for each in (one, other)]  # fmt: skip
    return max(low for low, _ in wide) > min(high for _, high in wide)


def judged(seed: int) -> list[dict[str, str]]:
    """Return a row for each fault of a random arm; of one without faults, a row with an empty fault."""
    with TemporaryDirectory() as folder:
        path = Path(folder, f"arm-{seed}.toml")
        path.write_text("\n".join([*toml(SHORT), *toml(arm(seed), "environment.")]))
        try:
            run = Run(load_setup(path), Path(folder, "out"))
            found = [*run.faults(), *(run.limit_faults() if seed % LIMITED_EVERY == 0 else ())]
        except (ValueError, RuntimeError) as error:
            found = [("runs", str(error).replace("\n", " "))]
    return [{"invariant": invariant, "fault": fault} for invariant, fault in found or [("all", "")]]


def analyse(frames: Frames, _: bool) -> Findings:
    """List the faults."""
    rows = frames["arms"]
    faults = rows.filter(pl.col("fault") != "")
    answer = f"{rows['arm'].n_unique() - faults['arm'].n_unique()} of {rows['arm'].n_unique()} arms have no fault."
    table = Table.of("Sentences and numbers that do not hold", faults.to_dicts(),
                     {"arm": "{arm}", "invariant": "{invariant}", "fault": "{fault}"})  # fmt: skip
    return Findings(answer, [Section("Faults", [table] if faults.height else ["None."])])


def arms(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each arm."""
    return (Cell({"arm": seed}, {"seed": seed}) for seed in range(FEW if quick else ARMS))


STUDY = Study("own-arms", QUESTIONS["own-arms"], [
    Measurement("arms", arms, judged, DEPENDS),
], analyse)  # fmt: skip
