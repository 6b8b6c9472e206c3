"""The command line of `experiments.design`: `python -m experiments.design FOLDER`, of a study of `agents.design`."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from markupsafe import Markup
from matplotlib.figure import Figure

from agents.archive import read_archive
from agents.command_line import command_line
from agents.design.__main__ import FORMAT
from agents.provenance import circumstances
from experiments.design import watch
from experiments.lab import player
from experiments.lab.charts import OBJECT, SERIES, TOOL
from experiments.lab.experiment import write
from experiments.lab.statistics import Estimate, Resamples, along, estimate, quantile_groups
from experiments.lab.tables import Row
from impact_gym.envs.setting import NUMBERS

LINES = {"designs": "best design for each approach time", "chosen": "chosen design"}
BINS = 5


@dataclass(frozen=True)
class Page:
    """Write the page of a study of designs."""

    folder: tyro.conf.Positional[Path]
    """Where `agents.design` has written it."""


@dataclass(frozen=True)
class Line:
    """A coupling with its controllers, one for each approach time; or the best coupling for each."""

    name: str
    entries: list[Mapping[str, Any]]  # as `agents.design` tells of them, sorted by approach time
    played: dict[str, np.ndarray[Any, Any]]  # (entries, scenarios)

    def told(self, place: int) -> watch.Told:
        """Return an entry and its results (scenarios,) by name."""
        return self.entries[place], {name: values[place] for name, values in self.played.items()}

    def mean(self, name: str) -> np.ndarray[Any, Any]:
        """Return the means of a result (entries,)."""
        return self.played[name].mean(axis=1)


def read(folder: Path) -> tuple[dict[str, Any], dict[str, Line]]:
    """Return what a study says of itself, and its lines by name.

    Raises:
        ValueError: the folder holds no study.
    """
    content, arrays = read_archive(folder / "designs.npz", FORMAT)
    lines = {}
    for name in dict.fromkeys(one["line"] for one in content["entries"]):
        places = [place for place, one in enumerate(content["entries"]) if one["line"] == name]
        places.sort(key=lambda place: arrays[f"approach_time_{place}"].mean())
        results = [key.removesuffix(f"_{places[0]}") for key in arrays if key.endswith(f"_{places[0]}")]
        played = {result: np.array([arrays[f"{result}_{place}"] for place in places]) for result in results}
        lines[name] = Line(name, [content["entries"][place] for place in places], played)
    return content, lines


def reduction(line: Line, paper: Line, resamples: Resamples) -> Estimate:
    """Return by which share a line's V_p at the mean approach time of the paper's rule is below that rule's."""
    front = [resamples.means(line.played[name][None]) for name in ("approach_time", "object_velocity")]
    time, velocity = (resamples.means(paper.played[name][0]) for name in ("approach_time", "object_velocity"))
    return estimate(1.0 - along(*front, time) / velocity)


def rows(lines: Mapping[str, Line]) -> list[Row]:
    """Return a row for each controller of each line."""
    rule = lines["paper's rule"].mean("object_velocity")[0]
    return [
        {
            "line": line.name,
            "allowed": entry["share"],
            "approach_time": float(line.mean("approach_time")[place]),
            "object_velocity": float(line.mean("object_velocity")[place]),
            "lower": float(1.0 - line.mean("object_velocity")[place] / rule),
            "deflection": float(line.played["deflection"][place].max()),
            "stroke": float(line.played["stroke"][place].max()),
            "peak_force": float(np.quantile(line.played["peak_force"][place], 0.95)),
            "second_blow": float((line.played["contact_count"][place] > 1).mean()),
            "missed": int(line.played["missed"][place].sum()),
            "design": ", ".join(f"{name} {in_unit(name, value)}" for name, value in entry["design"].items()),
        }
        for line in lines.values()
        for place, entry in enumerate(line.entries)
    ]


def in_unit(name: str, value: float) -> str:
    """Return a number of a design with its unit."""
    return f"{value:.4g} {NUMBERS[name].unit.replace('(no unit)', '')}".strip()


def front(lines: Mapping[str, Line]) -> Figure:
    """Return approach time against V_p, each design of the front with its largest deflection in free flight."""
    drawn = Figure(figsize=(8.4, 4.8))
    axes = drawn.subplots()
    others = [name for name in lines if name not in (*LINES, "paper's rule")]
    for name, colour in {**dict(zip(others, SERIES[2:], strict=False)), "chosen": TOOL, "designs": OBJECT}.items():
        line = lines[name]
        time, velocity = line.mean("approach_time"), line.mean("object_velocity")
        style = "s" if name == "designs" else "o-"
        axes.plot(time, velocity, style, color=colour, label=LINES.get(name, name), markersize=5)
        for x, y, moved in zip(time, velocity, line.played["deflection"].max(axis=1), strict=True):
            if name == "designs":
                axes.annotate(f"{1e3 * moved:.1f} mm", (x, y), xytext=(5, 6), textcoords="offset points", fontsize=8)
    rule = lines["paper's rule"]
    axes.plot(rule.mean("approach_time"), rule.mean("object_velocity"), "k*", markersize=12, label="paper's rule")
    axes.set(xlabel="mean approach time (s)", ylabel="mean $V_p$ (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    return drawn


def distances(lines: Mapping[str, Line], chosen: int) -> Figure:
    """Return V_p over the object's distance, of the chosen design at the paper's time and of the paper's rule."""
    drawn = Figure(figsize=(8.4, 3.6))
    axes = drawn.subplots()
    where = lines["chosen"].played["distance"][chosen]
    groups = quantile_groups(where, BINS)
    middles = [1e3 * 0.5 * (low + high) for _, low, high in groups]
    for line, place, colour in ((lines["chosen"], chosen, TOOL), (lines["paper's rule"], 0, OBJECT)):
        velocity = line.played["object_velocity"][place]
        axes.plot(middles, [velocity[mask].mean() for mask, _, _ in groups], "o-", color=colour, label=line.name)
    axes.set(xlabel="object's distance (mm)", ylabel="mean $V_p$ (m/s)", ylim=(0.0, None))
    axes.legend(fontsize=9)
    return drawn


def filmed(lines: Mapping[str, Line], tolerance: float) -> dict[str, Any]:
    """Return the films of the designs of the front, in the order of their rows."""
    designs = lines["designs"]
    told = [designs.told(place) for place in range(len(designs.entries))]
    return watch.front(lines["paper's rule"].told(0), told, tolerance)


def show(folder: Path) -> Path:
    """Write the page of the study in a folder, and return its path."""
    content, lines = read(folder)
    paper, chosen = lines["paper's rule"], lines["chosen"]
    resamples = Resamples(paper.played["object_velocity"].shape[1])
    gains = {name: reduction(line, paper, resamples) for name, line in lines.items() if name != "paper's rule"}
    at = min(range(len(chosen.entries)), key=lambda place: abs(chosen.entries[place]["share"] - 1.0))
    groups = quantile_groups(chosen.played["distance"][at], BINS)
    least = min(
        1.0 - chosen.played["object_velocity"][at][mask].mean() / paper.played["object_velocity"][0][mask].mean()
        for mask, _, _ in groups
    )
    said = {
        "setup": content["setup"],
        "gains": {LINES.get(name, name): gain for name, gain in gains.items()},
        "gain": gains["chosen"],
        "design": {name: in_unit(name, value) for name, value in chosen.entries[at]["design"].items()},
        "pad": chosen.entries[at]["pad"],
        "deflection": chosen.played["deflection"].max(),
        "least": least,
        "rows": rows(lines),
        "player": player,
        "films": Markup(player.fragment(filmed(lines, content["tolerance"]))),
        "file": next((path.name for path in folder.glob("*-designed.toml")), ""),
    }
    figures = {"front": front(lines), "distances": distances(lines, at)}
    run = {"command": content["command"], "seconds": content["seconds"], **circumstances("impact-gym", "cma", "numpy")}
    return write("design", folder, {"designs": said["rows"]}, figures, said, [run])


def main() -> None:
    """Write the page of the study that the command line names."""
    with command_line("experiments.design"):
        folder = tyro.cli(Page, prog="python -m experiments.design").folder
        print(f"page: {show(folder).resolve().as_uri()}")


if __name__ == "__main__":
    main()
