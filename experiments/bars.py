"""The bars: `python -m experiments.bars` plays every shipped seed and every baseline on the frozen test set.

Writes reports/bars/bars.md, the table of what was to be reached and what was, and bars.csv, all means behind it. A
policy is one trade-off curve, so its approach is made no later than the paper's rule by its time weight, found by
bisection.
"""

import csv
import math
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from tqdm import tqdm

from agents.baselines.bound import SCENARIOS, clairvoyant_bound
from agents.baselines.rule import Floats
from agents.baselines.tuned import load_baseline
from agents.evaluate.stage import Controller, Episodes, Stage
from agents.policies.policy import SHIPPED, Policy, load_policy
from agents.provenance import circumstances
from agents.setups import README, load_setup
from agents.setups.evaluation import WEIGHTS
from experiments.bars_table import BOUND, Bar, Row, markdown
from experiments.lab.results import REPORTS, whole_folder
from experiments.lab.statistics import Estimate, Resamples, estimate
from impact_gym.envs import evaluation_sets
from impact_gym.validation import whole

PAPER = "paper-trapezoid"
REACHED = {"linear-blind": 0.40, "linear-ranged": 0.12}
"""V_p over that of the paper's rule at an approach no later, at most; bistable-blind is measured against linear-blind.
"""
HALVINGS = 8  # of that range's logarithm, so a weight is found to 1 %


@dataclass(frozen=True)
class Settings:
    """Measure the bars."""

    frozen: str = "test"
    """Which frozen set."""
    scenarios: int = 2000
    """How many of it."""
    clairvoyant: int = SCENARIOS
    """Scenarios of the bound; 0 leaves it out."""
    policies: Path = SHIPPED
    """Folder of the policies: SETUP/seed-K.npz, or SETUP.npz where there are no seeds."""
    out: Path = REPORTS / "bars"
    """Folder for the tables; one that an earlier run wrote is replaced."""

    def __post_init__(self) -> None:
        whole("scenarios", self.scenarios, at_least=2)
        whole("clairvoyant", self.clairvoyant, at_least=0)
        if self.scenarios > evaluation_sets.load(self.frozen).count or self.clairvoyant > self.scenarios:
            raise ValueError("scenarios must be at most those of the set, clairvoyant at most scenarios")


class Study:
    """What was played so far, and the means of it."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.rows: list[Row] = []
        self.bars: list[Bar] = []
        self._bounds: dict[tuple[str, float], Episodes] = {}

    def play(self, setup: str, name: str, controller: Controller, weight: float) -> Episodes:
        """Play one controller at one weight and keep the means."""
        stage = Stage.of(
            self.settings.frozen, self.settings.scenarios, time_weight=[weight], **load_setup(setup).environment
        )
        played = stage.play(controller)
        self.keep(setup, name, weight, played)
        return played

    def keep(self, setup: str, name: str, weight: float, played: Episodes) -> None:
        """Keep the means of what was played."""
        self.rows.append(
            Row(
                setup,
                name,
                weight,
                scenarios=len(played.missed),
                loss=float(played.loss(weight).mean()),
                object_velocity=float(played.object_velocity.mean()),
                approach_time=float(played.approach_time.mean()),
                missed=int(played.missed.sum()),
            )
        )

    def no_later(self, setup: str, name: str, policy: Policy, limit: float) -> Episodes | None:
        """Play a policy at the lowest weight at which its mean approach takes no longer than `limit` (s).

        None where it takes longer at every weight. Bisection: the time falls as the weight rises.
        """
        low, high = policy.environment["time_weight"]
        if (played := self.play(setup, name, policy, low)).approach_time.mean() <= limit:
            return played
        found = self.play(setup, name, policy, high)
        if found.approach_time.mean() > limit:
            return None
        for _ in range(HALVINGS):
            middle = math.sqrt(low * high)
            played = self.play(setup, name, policy, middle)
            if played.approach_time.mean() <= limit:
                high, found = middle, played
            else:
                low = middle
        return found

    def measure(self, setup: str, seeds: dict[str, Policy], reference: Episodes | None) -> Episodes | None:
        """Measure the bars of one setup; return its median seed at an approach no later than the paper's rule.

        `reference` is what V_p is measured against instead of the paper's rule.
        """
        middle, others = median(seeds), load_setup(setup).against
        papers = [self.play(setup, PAPER, load_baseline(PAPER), weight) for weight in WEIGHTS]  # all the same
        rivals = {
            (name, weight): self.play(setup, name, load_baseline(name, weight), weight)
            for name in others
            for weight in WEIGHTS
        }
        against, whom = (papers[0], "the paper's rule") if reference is None else (reference, "linear-blind")
        limit = float(against.approach_time.mean())
        early: dict[str, Episodes | None] = {}
        at: dict[tuple[str, float], Episodes] = {}
        for name, policy in tqdm(seeds.items(), desc=setup, unit="seed", disable=None):
            early[name] = self.no_later(setup, name, policy, limit)
            at |= {(name, weight): self.play(setup, name, policy, weight) for weight in WEIGHTS}

        def bar(what: str, limit: float, pairs: dict[str, tuple[Floats, Floats] | None]) -> None:
            interval = ratio(pairs[middle])
            self.bars.append(Bar(setup, what, limit, middle, interval, {name: _ratio(p) for name, p in pairs.items()}))

        bar(
            f"V_p over that of {whom}, at an approach of at most {limit:.4f} s",
            REACHED.get(setup, 1.0),
            {name: (one.object_velocity, against.object_velocity) if one else None for name, one in early.items()},
        )
        for weight in WEIGHTS:
            name = min(others, key=lambda name: rivals[name, weight].loss(weight).mean())
            best = rivals[name, weight].loss(weight)
            bar(f"V_p + w T over that of {name}, w = {weight:g}", 1.0,
                {seed: (at[seed, weight].loss(weight), best) for seed in seeds})  # fmt: skip
        missed = {
            name: float(sum(one.missed.sum() for one in (early[name], *(at[name, w] for w in WEIGHTS)) if one))
            for name in seeds
        }
        self.bars.append(Bar(setup, "objects missed in all of these", 0.0, middle, None, missed))
        for weight in WEIGHTS if self.settings.clairvoyant else ():
            self.bound(
                setup, weight, {middle: at[middle, weight], **{n: rivals[n, weight] for n in load_setup(setup).against}}
            )
        return early[middle]

    def bound(self, setup: str, weight: float, others: dict[str, Episodes]) -> None:
        """Keep what one that knows each scenario reaches, and beside it `others` on these scenarios."""
        count, frozen = self.settings.clairvoyant, self.settings.frozen
        bound = load_setup(setup).bound
        if (bound, weight) not in self._bounds:
            print(f"{setup}: the bound at {weight:g}", flush=True)
            self._bounds[bound, weight] = clairvoyant_bound(bound, weight, frozen, count)
        self.keep(setup, BOUND, weight, self._bounds[bound, weight])
        for name, played in others.items():
            self.keep(setup, name, weight, played.first(count))


def policies(setup: str, folder: Path) -> dict[str, Policy]:
    """Return the seeds of a setup by name, or the one policy that is there, or none.

    Raises:
        ValueError: one was trained in another environment than the setup's.
    """
    paths = sorted((folder / setup).glob("seed-*.npz"), key=lambda path: int(path.stem.removeprefix("seed-")))
    shipped = folder / f"{setup}.npz"
    found = {path.stem: load_policy(path) for path in paths or [shipped] if path.is_file()}
    for name, policy in found.items():
        trained_in = {field: value for field, value in policy.environment.items() if field != "time_weight"}
        if not load_setup(setup).is_of(trained_in):
            there = dict(load_setup(setup).environment)
            raise ValueError(f"{setup}, {name}: trained in {trained_in}, the set-up is {there}")
    return found


def median(seeds: dict[str, Policy]) -> str:
    """Return the name of the middle one by validation score, as `agents.train_seeds` does; of two, the worse."""
    if len(seeds) == 1:
        return next(iter(seeds))
    scored = [(policy.provenance["validation"]["score"], place) for place, policy in enumerate(seeds.values())]
    return list(seeds)[sorted(scored)[len(scored) // 2][1]]


def ratio(pair: tuple[Floats, Floats] | None) -> Estimate | None:
    """Return mean over mean with its interval, scenarios resampled as pairs."""
    if pair is None:
        return None
    resamples = Resamples(pair[0].size)
    ours, theirs = (resamples.means(one[None]) for one in pair)
    return estimate(ours / theirs)


def _ratio(pair: tuple[Floats, Floats] | None) -> float:
    return math.inf if pair is None else float(pair[0].mean() / pair[1].mean())


def write(settings: Settings) -> tuple[Path, str]:
    """Measure, write the folder, and return its path and the table."""
    study = Study(settings)
    blind = None
    there = {setup: policies(setup, settings.policies) for setup in README}
    for setup, seeds in there.items():
        if not seeds:
            print(f"{setup} is left out: {settings.policies} holds no policy of it")
            continue
        found = study.measure(setup, seeds, blind if setup == "bistable-blind" else None)
        blind = found if setup == "linear-blind" else blind
    about = {
        "command": shlex.join(["python", "-m", "experiments.bars", *sys.argv[1:]]),
        "set": f"{settings.frozen}, its first {settings.scenarios} scenarios",
        "left out": [setup for setup, seeds in there.items() if not seeds],
        **circumstances("impact-gym", "numpy", "scipy"),
    }
    page = markdown(study.bars, [row for row in study.rows if row.time_weight in WEIGHTS], about)
    with whole_folder(settings.out) as folder:
        (folder / "bars.md").write_text(page)
        with (folder / "bars.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(Row._fields)
            writer.writerows(study.rows)
    return settings.out, page


def main() -> None:
    """Read the settings from the command line and measure."""
    try:
        folder, page = write(tyro.cli(Settings, prog="python -m experiments.bars"))
    except ValueError as error:
        sys.exit(f"experiments.bars: {error}")
    except KeyboardInterrupt:
        print("experiments.bars: interrupted; what was there before is unchanged", file=sys.stderr)
        sys.exit(130)
    print(page)
    print(folder / "bars.md")


if __name__ == "__main__":
    main()
