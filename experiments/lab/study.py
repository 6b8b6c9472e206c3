"""Studies: a study has a question, tables of measurements, and an analysis; a run of the study writes a page."""

import json
import os
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl

from agents.command_line import command_of
from agents.jobs import cached
from agents.provenance import circumstances, digest_of
from experiments.lab import page, results
from experiments.lab.parts import Section, Table
from impact_gym.files import whole_file, write_file
from impact_gym.sources import compiled_from
from impact_gym.validation import whole

Row = Mapping[str, Any]
Rows = Sequence[Row] | pl.DataFrame
Frames = Mapping[str, pl.DataFrame]
KEPT = "kept"  # subfolder of a study's folder, with the results of the study's cells
LARGE = 50_000  # largest number of rows of a table in CSV; a larger table is written as Parquet
SOLVER = tuple(  # modules on which the result of `simulate` depends, in addition to the compiled solver
    f"impact_gym.{name}" for name in ("physics", "scene", "motion", "robot", "to_kernel", "outcome", "simulation")
)


class Cell(NamedTuple):
    """One call of `Measurement.measure` with `arguments`; the returned rows get `labels` as columns."""

    labels: Row
    arguments: Mapping[str, Any]


@dataclass(frozen=True)
class Measurement:
    """A table of a study, and how its rows are measured."""

    name: str  # name of the table
    cells: Callable[[bool, Frames], Iterable[Cell]]  # arguments: whether the run is quick; the tables by name
    measure: Callable[..., Rows]  # function at the top level of a module, so that other processes can import it
    depends: tuple[str, ...] = SOLVER  # modules that rows depend on, in addition to the module of `measure`
    failed: Callable[[Row], Row] | None = None  # returns a failed cell's row from its labels; None: raise an error
    seconds: float | None = None  # s, time limit of a cell
    processes: int | None = None  # largest number of processes that measure; 0: this process measures; None: no limit

    @property
    def digest(self) -> str:
        """Digest of the sources on which kept rows depend."""
        modules = {self.measure.__module__, *self.depends}
        solver = compiled_from() if any(name.startswith("impact_gym") for name in modules) else ""
        return f"{solver} {digest_of(*modules)}"


@dataclass(frozen=True)
class Findings:
    """Result of a study."""

    answer: str  # one or two sentences
    sections: Sequence[Section]
    tables: Frames = field(default_factory=dict)  # tables that were computed from the measured tables


@dataclass(frozen=True)
class Study:
    """A question, the measurements in the order in which they run, and their analysis."""

    name: str
    question: str
    measurements: Sequence[Measurement]
    analyse: Callable[[Frames, bool], Findings]  # arguments: the measured tables; whether the run is quick
    packages: tuple[str, ...] = ()  # packages whose versions the page also lists


@dataclass(frozen=True)
class StudyOptions:
    """Run a study, and write a page with its tables.

    A cell is one combination of settings; it gives rows of a table. The command measures only cells without results.
    """

    out: Path | None = None
    """Folder for the tables, the figures and the page. The default is reports/NAME, or reports/NAME-quick with
    --quick."""
    quick: bool = False
    """Shorten the study to minutes: fewer cells, shorter searches."""
    force: bool = False
    """Measure all cells again, even if their results are up to date."""
    only: tuple[str, ...] = ()
    """Names of the tables to measure. The command also measures the tables that these tables or the page need."""
    processes: int | None = None
    """Largest number of cells that the command measures at the same time on this machine. The default is
    the number of cores. 0: this process measures all cells."""
    cluster: str | None = None
    """Address of a Ray cluster to measure on. "ray": the address in RAY_ADDRESS, else the cluster of this machine."""
    results: Path | None = None
    """Folder (docs/results) for the tables that the documentation shows, as CSV files."""

    def __post_init__(self) -> None:
        if self.results is not None and self.quick:
            raise ValueError("results need a whole run: leave out --quick")
        if self.processes is not None:
            whole("processes", self.processes, at_least=0)


class Run(dict[str, pl.DataFrame]):
    """A run of a study, as a dict of the measured tables by name. Reading a missing table measures the table."""

    def __init__(self, study: Study, options: StudyOptions, command: str = "") -> None:
        """Prepare a run; `command` is the command line that repeats the run."""
        super().__init__()
        self.study, self.options, self.command = study, options, command
        self.folder = options.out or Path("reports", f"{study.name}{'-quick' if options.quick else ''}")
        self.measurements = {measurement.name: measurement for measurement in study.measurements}

    def __missing__(self, name: str) -> pl.DataFrame:
        """Return the rows of all cells of a table; only cells without kept results are measured."""
        measurement = self.measurements[name]
        cells, row_of = list(measurement.cells(self.options.quick, self)), measurement.failed

        def failed(arguments: Mapping[str, Any], reason: str) -> Rows:
            labels = next(cell.labels for cell in cells if cell.arguments == arguments)
            return [{**(row_of(labels) if row_of else {}), "failure": reason.replace("\n", " ")}]

        limit, requested = measurement.processes, self.options.processes
        results = cached(
            measurement.measure,
            [cell.arguments for cell in cells],
            self.folder / KEPT,
            depends=measurement.digest,
            title=name,
            processes=requested if limit is None else limit if requested is None else min(limit, requested),
            cluster=self.options.cluster if limit is None else None,
            seconds=measurement.seconds,
            failed=failed if row_of else None,
        )
        self[name] = frame_of(zip((cell.labels for cell in cells), results, strict=True))
        return self[name]

    def measure(self) -> Findings:
        """Measure the tables in `only`, or all tables if `only` is empty; return their analysis."""
        if unknown := {*self.options.only} - {*self.measurements}:
            names = ", ".join(self.measurements)
            raise ValueError(f"only: no table {min(unknown)!r} in the study {self.study.name}; its tables: {names}")
        for name in self.options.only or self.measurements:
            _ = self[name]
        return self.study.analyse(self, self.options.quick)

    def write(self) -> Path:
        """Measure missing cells, write tables, figures and the page, and return the path of the page.

        The page and results.json list all runs since the last --force, each with its command, versions, machine, load
        before the run, and duration in seconds (None: the run did not finish).
        """
        kept, log = self.folder / KEPT, self.folder / "results.json"
        if self.options.force:
            shutil.rmtree(kept, ignore_errors=True)
        runs = json.loads(log.read_text())["runs"] if kept.is_dir() and log.is_file() else []
        begun = time.perf_counter()
        record: dict[str, Any] = {"command": self.command, "seconds": None, "load_before": os.getloadavg()[0]}
        runs.append(record | circumstances("impact-gym", "numpy", "scipy", *self.study.packages))
        try:
            findings = self.measure()
            runs[-1]["seconds"] = time.perf_counter() - begun
        finally:
            write_file(log, json.dumps({"runs": runs}, indent=2) + "\n")
        files = [_write_table(self.folder / name, frame) for name, frame in {**self, **findings.tables}.items()]
        for table in (part for section in findings.sections for part in section.parts if isinstance(part, Table)):
            if self.options.results is not None and table.results:
                results.write(self.options.results, table.results, table, runs[-1])
        about: dict[str, Any] = {"question": self.study.question, "findings": findings, "files": files}
        return page.write(self.folder, "lab/study.html.jinja", runs=runs, quick=self.options.quick, **about)


def csv_of(frame: pl.DataFrame) -> str:
    """Return a table as CSV; a text that a spreadsheet could read as a formula gets an apostrophe (OWASP)."""
    return frame.with_columns(pl.selectors.string().str.replace(r"^([=+\-@\t\r\n])", "'$1")).write_csv()


def _write_table(path: Path, frame: pl.DataFrame) -> str:
    large = frame.height > LARGE
    file, other = (path.with_suffix(suffix) for suffix in ((".parquet", ".csv") if large else (".csv", ".parquet")))
    with whole_file(file) as stream:
        frame.write_parquet(stream) if large else stream.write(csv_of(frame).encode())
    other.unlink(missing_ok=True)
    return file.name


def frame_of(measured: Iterable[tuple[Row, Rows]]) -> pl.DataFrame:
    """Return one frame of the rows of all cells, with labels as first columns; missing values are null."""
    frames, rows = list[pl.DataFrame](), list[Row]()
    for labels, found in measured:
        if isinstance(found, pl.DataFrame):
            frames.append(found.select(*(pl.lit(value).alias(name) for name, value in labels.items()), pl.all()))
        else:
            rows += [{**labels, **row} for row in found]
    frames += [pl.DataFrame(rows, infer_schema_length=None)] if rows else []
    return pl.concat(frames, how="diagonal_relaxed") if frames else pl.DataFrame()


def run(study: Study, options: StudyOptions) -> None:
    """Run a study and print the address of its page."""
    path = Run(study, options, command_of("study", options, None, study.name)).write()
    print(f"results: {path.resolve().as_uri()}")
