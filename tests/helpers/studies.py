"""Studies that are small enough for a test."""

import math
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import Cell, Findings, Measurement, Run, Study, StudyOptions


def small_run(study, folder, **cells):
    """A run of a study with these cells of each table, in this process; tables that are not named are left out."""
    measurements = [
        replace(measurement, cells=lambda quick, frames, name=measurement.name: cells[name](frames)
                if callable(cells[name]) else cells[name], processes=0)
        for measurement in study.measurements if measurement.name in cells
    ]  # fmt: skip
    return Run(replace(study, measurements=measurements), StudyOptions(folder, processes=0), "the command")


def fall(height, fallen_log):
    """How long an object falls from a height (m), s; each call is a line of a log."""
    with Path(fallen_log).open("a") as log:
        log.write(f"{height}\n")
    return [{"time": math.sqrt(2.0 * height / 9.81)}]


def falling(log, heights=(1.0, 4.0)):
    """A study of two tables: falls from heights, and from a tenth of the mean time of those in m; below ground none."""
    picture = Figure()
    picture.subplots().plot([0.0, 1.0], [0.0, 1.0], label="V_p")

    def cells(quick, frames):
        chosen = heights[:1] if quick else heights
        return [Cell({"height": height}, {"height": height, "fallen_log": str(log)}) for height in chosen]

    def deeper(quick, frames):
        height = -0.1 * frames["falls"]["time"].mean()
        return [Cell({"height": height}, {"height": height, "fallen_log": str(log)})]

    def analyse(frames, quick):
        table = Table.of("Falls", frames["falls"], {"height (m)": "{height:g}", "time (s)": "{time:.3f}"})
        parts = ["Time is sqrt(2 h / g).", table, Picture("line", picture, "A line that rises")]
        return Findings("It takes longer from V_p higher up.", [Section("All falls", parts, key="falls")])

    def failed(labels):
        return {"time": math.nan, "height again": labels["height"]}

    measurements = [Measurement("falls", cells, fall, ()), Measurement("deeper", deeper, fall, (), failed)]
    return Study("falling", "How long does it fall?", measurements, analyse)
