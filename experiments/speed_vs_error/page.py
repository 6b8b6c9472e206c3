"""The page about speed and error, made from the tables on disk: one file, its figures inside."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from experiments.lab.charts import save
from experiments.lab.tables import table
from experiments.speed_vs_error import figures, heat_map, quantities, summary, truth
from experiments.speed_vs_error.by_hand import METHODS
from experiments.speed_vs_error.quantities import ERRORS
from impact_gym.files import whole_file

NAMED, POPULATION, HEAT_MAP = "named.csv", "population.csv", "heat_map.csv"
NAMED_TRUTH, POPULATION_TRUTH, FITS = "named_truth.csv", "population_truth.csv", "mujoco_fits.csv"


def draw(folder: Path) -> None:
    """Draw every figure from the tables in `folder`."""
    rows, truths = table(folder / NAMED), table(folder / NAMED_TRUTH)
    for column in ERRORS:
        save(figures.named_scenes(rows, truths, column), folder / f"{column}.svg")
    save(figures.population(table(folder / POPULATION)), folder / "population.svg")
    save(figures.heat_map(table(folder / HEAT_MAP), heat_map.OUR_RTOL), folder / "heat_map.svg")


def factor(value: float) -> str:
    """Return a ratio in words: two digits, or one decimal below ten."""
    return f"{value:.1f}" if value < 10 else f"{float(f'{value:.2g}'):,.0f}"


def short(value: float) -> Markup:
    """Return a power of ten without the zeros that fill its exponent, 1e-6 or 2.2e-4, not to be broken over lines."""
    mantissa, _, exponent = f"{value:.1e}".partition("e")  # inf and nan have no exponent
    text = f"{mantissa.removesuffix('.0')}e{int(exponent)}" if exponent else mantissa
    return Markup('<span class="number">{}</span>').format(text)


def write(folder: Path, runs: list[Mapping[str, Any]]) -> Path:
    """Write the page about the tables and figures in `folder`; return its path."""
    tables = {name.removesuffix(".csv"): table(folder / name) for name in (NAMED, NAMED_TRUTH, POPULATION_TRUTH, FITS)}
    doubts = pl.concat([tables["named_truth"], tables["population_truth"]], how="vertical_relaxed")
    differ = (pl.col("second_contacts") != pl.col("contacts")) | (pl.col("second_passes") != pl.col("passes"))
    pages = Environment(loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined)
    pages.filters |= {"factor": factor, "short": short}

    def image(name: str) -> str:
        return "data:image/svg+xml;base64," + base64.b64encode((folder / f"{name}.svg").read_bytes()).decode()

    text = pages.get_template("page.html.jinja").render(
        lines=summary.lines(tables["named"], tables["named_truth"]),
        summary=summary,
        errors=ERRORS,
        image=image,
        table=summary.over_population(table(folder / POPULATION)).to_dicts(),
        population_size=tables["population_truth"].height,
        doubt=doubts["velocity_error_doubt"].max(),
        disagreements=doubts.filter(differ).height,
        truth_rtol=truth.RTOL,
        too_wrong=quantities.TOO_WRONG,
        by_hand=list(METHODS),
        fits=not tables["mujoco_fits"].is_empty(),
        heat=table(folder / HEAT_MAP),
        runs=runs,
        load=tables["named"]["load"],
    )
    with whole_file(folder / "index.html") as file:
        file.write(text.encode())
    return folder / "index.html"
