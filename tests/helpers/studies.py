"""Studies that are small enough for a test."""

from dataclasses import replace

from experiments.lab.study import Run, StudyOptions


def small_run(study, folder, **cells):
    """A run of a study with these cells of each table, in this process; tables that are not named are left out."""
    measurements = [
        replace(measurement, cells=lambda quick, frames, name=measurement.name: cells[name](frames)
                if callable(cells[name]) else cells[name], processes=0)
        for measurement in study.measurements if measurement.name in cells
    ]  # fmt: skip
    return Run(replace(study, measurements=measurements), StudyOptions(folder, processes=0), "the command")
