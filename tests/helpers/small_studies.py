"""Studies that are small enough for a test."""

from dataclasses import replace

from experiments.lab.study import Run, StudyOptions


def small_run(study, folder, **cells):
    """A run, in this process, of the tables that have a function for their cells here."""
    few = [replace(each, cells=cells[each.name], processes=0) for each in study.measurements if each.name in cells]
    return Run(replace(study, measurements=few), StudyOptions(folder, processes=0), "the command")
