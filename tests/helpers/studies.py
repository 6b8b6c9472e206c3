"""Studies that are small enough for a test."""

from dataclasses import replace

from experiments.lab.study import Run, StudyOptions


def small_run(study, folder, **cells):
    """A run of a study with these cells of each table, in this process; tables that are not named are left out."""
    measurements = []
    for measurement in study.measurements:
        if (given := cells.get(measurement.name)) is not None:
            of_frames = (
                (lambda _, frames, given=given: given(frames)) if callable(given) else lambda *_, given=given: given
            )
            measurements.append(replace(measurement, cells=of_frames, processes=0))
    return Run(replace(study, measurements=measurements), StudyOptions(folder, processes=0), "the command")
