"""The page about speed and error, made from the tables on disk: one file, its figures inside."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from experiments.charts import save
from experiments.speed_vs_error import figures, records, summary
from experiments.speed_vs_error.by_hand import METHODS as BY_HAND
from experiments.speed_vs_error.heat_map import OUR_RTOL
from experiments.speed_vs_error.quantities import ERRORS, TOO_WRONG
from experiments.speed_vs_error.truth import RTOL
from impact_gym.files import whole_file

HERE = Path(__file__).parent
NAMED, POPULATION, HEAT_MAP = "named.csv", "population.csv", "heat_map.csv"
NAMED_TRUTH, POPULATION_TRUTH, FITS = "named_truth.csv", "population_truth.csv", "mujoco_fits.csv"


def draw(folder: Path) -> None:
    """Draw every figure from the tables in `folder`."""
    rows, truths = records.read(folder / NAMED), records.read(folder / NAMED_TRUTH)
    for column in ERRORS:
        save(figures.named_scenes(rows, truths, column), folder / f"{column}.svg")
    save(figures.population(records.read(folder / POPULATION)), folder / "population.svg")
    save(figures.heat_map(records.read(folder / HEAT_MAP), OUR_RTOL), folder / "heat_map.svg")


def factor(value: float) -> str:
    """Return a ratio in words: two digits, or one decimal below ten."""
    return f"{value:.1f}" if value < 10 else f"{float(f'{value:.2g}'):,.0f}"


def short(value: float) -> Markup:
    """Return a power of ten without the zeros that fill its exponent, 1e-6 or 2.2e-4, not to be broken over lines."""
    mantissa, _, exponent = f"{value:.1e}".partition("e")  # inf and nan have no exponent
    text = f"{mantissa.removesuffix('.0')}e{int(exponent)}" if exponent else mantissa
    return Markup('<span class="number">{}</span>').format(text)


def write(folder: Path, results: Mapping[str, Any]) -> Path:
    """Write the page about the tables and figures in `folder`; return its path."""
    named, truths = records.read(folder / NAMED), records.read(folder / NAMED_TRUTH)
    heat = records.read(folder / HEAT_MAP)
    doubts = records.read(folder / POPULATION_TRUTH) + truths
    pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    pages.filters |= {"factor": factor, "short": short}

    def image(name: str) -> str:
        return "data:image/svg+xml;base64," + base64.b64encode((folder / f"{name}.svg").read_bytes()).decode()

    text = pages.get_template("page.html.jinja").render(
        lines=summary.lines(named, truths),
        fine=summary.FINE,
        coarse=summary.COARSE,
        errors=ERRORS,
        image=image,
        table=summary.over_population(records.read(folder / POPULATION)),
        population_truths=records.read(folder / POPULATION_TRUTH),
        doubt=max(row["velocity_error_doubt"] for row in doubts),
        disagreements=sum(
            (row["second_contacts"], row["second_passes"]) != (row["contacts"], row["passes"]) for row in doubts
        ),
        truth_rtol=RTOL,
        too_wrong=TOO_WRONG,
        by_hand=list(BY_HAND),
        fits=records.read(folder / FITS),
        heat=heat,
        heat_worst=max((row["velocity_error"] for row in heat if not row["failure"]), default=float("nan")),
        heat_failed=sum(bool(row["failure"]) for row in heat),
        heat_steps=[min(row["steps"] for row in heat), max(row["steps"] for row in heat)],
        results=results,
        loads=[min(row["load"] for row in named), max(row["load"] for row in named)],
    )
    with whole_file(folder / "index.html") as file:
        file.write(text.encode())
    return folder / "index.html"
