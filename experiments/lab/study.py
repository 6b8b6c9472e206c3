"""Studies: a study has a question, tables of measurements, and an analysis; a run of the study writes a page."""

import json
import os
import pickle
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import polars as pl

from agents.jobs import cached
from impact_gym.parameters import SI, Options
from impact_gym.support.archive import checksum
from impact_gym.support.files import locked, whole_file, write_file
from impact_gym.support.provenance import digest_of, machine_and_versions, revision
from impact_gym.support.sources import compiled_from

if TYPE_CHECKING:
    from experiments.lab.parts import Section, Tab

Row = Mapping[str, Any]
Rows = Sequence[Row] | pl.DataFrame
Frames = Mapping[str, pl.DataFrame]
CACHE = "kept"  # subfolder of a study's folder, with the results of the study's cells
RESULTS = "results.json"
LOCK_FILE = ".impact_gym"  # a run writes only to a new or empty folder, or to a folder with this file or CACHE
LARGE = 50_000  # largest number of rows of a table in CSV; a larger table is written as Parquet
SOLVER = tuple(  # modules on which the result of `simulate` depends, in addition to the compiled solver
    f"impact_gym.{name}"
    for name in ("physics", "scene", "couplings", "motion", "robot", "pack", "outcome", "simulation")
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

    answer: str  # one or two sentences; with tabs, a line for each
    sections: Sequence["Section"]
    tables: Frames = field(default_factory=dict)  # tables that were computed from the measured tables
    tabs: Sequence["Tab"] = ()  # shown before the sections
    numbers: Mapping[str, Any] = field(default_factory=dict)  # JSON, for programs that read results.json


@dataclass(frozen=True)
class Study:
    """A question, the measurements in the order in which they run, and their analysis."""

    name: str
    question: str
    measurements: Sequence[Measurement]
    analyse: Callable[[Frames, bool], Findings]  # arguments: the measured tables; whether the run is quick
    packages: tuple[str, ...] = ()  # packages whose versions the page also lists
    depends: str = ""  # everything else on which the page depends, in addition to the rows and to `experiments.lab`


@dataclass(frozen=True)
class RunOptions(Options):
    """Where a command measures, and what it writes."""

    out: Path | None = None
    """Folder for the tables, the figures and the page. The default is reports/NAME, or reports/NAME-quick with
    --quick."""
    force: bool = False
    """Measure all cells again and write the page again, even if they are up to date."""
    processes: Annotated[int | None, SI("-", at_least=0)] = None
    """Largest number of cells that the command measures at the same time on this machine. The default is
    the number of cores. 0: this process measures all cells."""
    cluster: str | None = None
    """Address of a Ray cluster to measure on. "ray": the address in RAY_ADDRESS, else the cluster of this machine. The
    module of each module:object must be installed on all nodes."""
    results: Path | None = None
    """Folder (docs/results) for the tables that the documentation shows, as CSV files."""


@dataclass(frozen=True)
class StudyOptions(RunOptions):
    """Options of a study, which may also be quick or measure some tables only."""

    quick: bool = False
    """Shorten the study to minutes: fewer cells, shorter searches."""
    only: tuple[str, ...] = ()
    """Names of the tables to measure. The command also measures the tables that these tables or the page need."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.results is not None and self.quick:
            raise ValueError("results need a whole run: leave out --quick")


class StudyRun(dict[str, pl.DataFrame]):
    """A run of a study, as a dict of the measured tables by name. Reading a missing table measures the table."""

    def __init__(self, study: Study, options: RunOptions, command: str = "") -> None:
        """Prepare a run; `command` is the command line that repeats the run."""
        super().__init__()
        self.study, self.options, self.command = study, options, command
        self.quick, self.only = (options.quick, options.only) if isinstance(options, StudyOptions) else (False, ())
        self.folder = options.out or Path("reports", f"{study.name}{'-quick' if self.quick else ''}")
        self.measurements = {measurement.name: measurement for measurement in study.measurements}

    def __missing__(self, name: str) -> pl.DataFrame:
        """Return the rows of all cells of a table; only cells without cached results are measured."""
        measurement, options = self.measurements[name], self.options
        cells, row_of = list(measurement.cells(self.quick, self)), measurement.failed

        def failed(arguments: Mapping[str, Any], reason: str) -> Rows:
            labels = next(cell.labels for cell in cells if cell.arguments == arguments)
            return [{**(row_of(labels) if row_of else {}), "failure": reason.replace("\n", " ")}]

        digest, limit = measurement.digest, measurement.processes
        folder = self.folder / CACHE / f"{name}-{checksum(digest)[:16]}"
        for other in {*folder.parent.glob(f"{name}-*")} - {folder}:  # of other versions of the sources
            shutil.rmtree(other, ignore_errors=True)
        limits = [most for most in (limit, options.processes) if most is not None]
        results = cached(
            measurement.measure, [cell.arguments for cell in cells], folder, depends=digest, title=name,
            processes=min(limits, default=None), cluster=options.cluster if limit is None else None,
            seconds=measurement.seconds, failed=failed if row_of else None,
        )  # fmt: skip
        self[name] = frame_of(zip((cell.labels for cell in cells), results, strict=True))
        return self[name]

    def measure(self) -> Findings:
        """Measure the tables in `only`, or all tables if `only` is empty; return their analysis."""
        if unknown := {*self.only} - {*self.measurements}:
            names = ", ".join(self.measurements)
            raise ValueError(f"only: no table {min(unknown)!r} in the study {self.study.name}; its tables: {names}")
        for name in self.only or self.measurements:
            _ = self[name]
        return self.study.analyse(self, self.quick)

    def write(self) -> Path:
        """Measure missing cells, write tables, figures and the page, and return the path of the page.

        Nothing is written if the page is up to date. The page and results.json list all runs since the last --force,
        each with its command, versions, machine, load before the run, answer, numbers, and duration in seconds (None:
        the run did not finish). ValueError: the folder has other content, or is a file.
        """
        page, folders = self.folder / "index.html", (self.folder, *self.folder.absolute().parents)
        there = next(folder for folder in folders if folder.exists())
        if not there.is_dir():
            raise ValueError(f"out must be a folder, but {there} is a file")
        content = {path.name for path in there.iterdir()} if there == self.folder else set()
        if content and not {LOCK_FILE, CACHE} & content:
            raise ValueError(f"out must be a new or empty folder, or the folder of an earlier run, got {there}")
        made_from = self._made_from()
        if self.options.force or not page.is_file() or last_run(self.folder).get("made from") != made_from:
            with locked(self.folder / LOCK_FILE):
                self._write(made_from)
        return page

    def _made_from(self) -> str:
        """Return a digest of all that determines the page."""
        cells = list[Sequence[Cell]]()
        for each in self.study.measurements:
            with suppress(KeyError):  # cells that depend on another table follow from that table's cells
                cells.append([*each.cells(self.quick, {})])
        analyse = getattr(self.study.analyse, "func", self.study.analyse)  # it may be a functools.partial
        sources = digest_of("experiments.lab", analyse.__module__), [each.digest for each in self.study.measurements]
        inputs = cells, sources, self.study.depends, self.only, self.options.results
        return checksum(pickle.dumps(inputs))  # not `repr`: cells share long texts

    def _write(self, made_from: str) -> None:
        from experiments.lab import page, results
        from experiments.lab.parts import tables_of

        study, cache, log = self.study, self.folder / CACHE, self.folder / RESULTS
        if self.options.force:
            shutil.rmtree(cache, ignore_errors=True)
        runs, begun = runs_of(self.folder) if cache.is_dir() else [], time.perf_counter()
        record: dict[str, Any] = {"command": self.command, "seconds": None, "load_before": os.getloadavg()[0]}
        runs.append(record | revision() | machine_and_versions("impact-gym", "numpy", "scipy", *study.packages))
        try:
            findings = self.measure()
        finally:
            write_file(log, json.dumps({"runs": runs}, indent=2) + "\n")
        shutil.rmtree(self.folder / "figures", ignore_errors=True)
        files = [_write_table(self.folder / name, frame) for name, frame in {**self, **findings.tables}.items()]
        for table in tables_of(findings.sections):
            if self.options.results is not None and table.results:
                results.write(self.options.results, table.results, table, runs[-1])
        runs[-1] |= {"seconds": time.perf_counter() - begun, "made from": made_from}
        runs[-1] |= {"answer": findings.answer, "numbers": findings.numbers}
        page.write(self.folder, runs=runs, quick=self.quick, question=study.question, findings=findings, files=files)
        write_file(log, json.dumps({"runs": runs}, indent=2) + "\n")  # last: its digest says that the page is complete


def runs_of(folder: Path) -> list[dict[str, Any]]:
    """Return the runs in a folder's results.json; empty if the file is missing, damaged or of another version."""
    with suppress(OSError, TypeError, ValueError, LookupError):
        return list(json.loads((folder / RESULTS).read_text())["runs"])
    return []


def last_run(folder: Path) -> dict[str, Any]:
    """Return the last run in a folder's results.json; empty if there is none."""
    return dict(next(reversed(runs_of(folder)), {}))


def csv_of(frame: pl.DataFrame) -> str:
    """Return a table as CSV; a text that a spreadsheet could read as a formula gets an apostrophe (OWASP)."""
    return frame.with_columns(pl.selectors.string().str.replace(r"^([=+\-@\t\r\n])", "'$1")).write_csv()


def _write_table(path: Path, frame: pl.DataFrame) -> str:
    large = frame.height > LARGE
    file, other = (path.with_suffix(suffix) for suffix in ((".parquet", ".csv") if large else (".csv", ".parquet")))
    with whole_file(file) as stream:
        frame.write_parquet(stream, compression="zstd") if large else stream.write(csv_of(frame).encode())
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


def run(study: Study, options: RunOptions, command: str) -> Path:
    """Run a study; print its answer and the address of its page, and return the path of the page."""
    page = StudyRun(study, options, command).write()
    print(last_run(page.parent)["answer"], f"results: {page.resolve().as_uri()}", sep="\n")
    return page
