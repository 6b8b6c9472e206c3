"""Studies that are small enough for a test: a run of a few cells, and the files that each table's cells used."""

import builtins
import io
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest

from agents import jobs
from experiments import studies
from experiments.lab.study import Cell, Run, StudyOptions
from experiments.studies import bench, gain, speed, stock, teleop
from experiments.studies.solvers import contenders

ROOT = Path(__file__).parents[2]


def cells_of(name, setup=bench.SETUPS[0]):
    """The few cells of each table, or a function that returns them."""
    if name == "paper":
        return {figure: [Cell({}, {})] for figure in ("figure_02", "figure_23")}
    if name == "speed":
        return {"truth": [Cell({"scene": "soft"}, {"approach": "soft"})], "times": beside_scipy}
    if name == "stability":  # 27: every coupling with every robot, three times
        patience = {2: 1e-3, 5: 60.0}  # s; too little for the independent solver, and enough
        truth = [Cell({"scene": number}, {"number": number, "patience": each}) for number, each in patience.items()]
        return {"storm": [Cell({"scene": number}, {"number": number}) for number in range(27)], "truth": truth}
    if name == "gain":
        few = {"scenarios": 10, "generations": 3, "tested": 20}
        found = [cell for cell in gain.searches(True, {}) if cell.labels["near"] == 0.15]
        return {"priors": [cell._replace(arguments=cell.arguments | few) for cell in found]}
    if name == "teleop":
        return {"episodes": [*few_operators()]}
    if name == "bench":
        rates = [Cell({"set-up": setup}, {"name": setup, "quick": True})]
        return {"environments": [Cell({}, {"quick": True})], "rates": rates}
    others = [Cell({"setup": stock.FIRST}, {"setup": stock.FIRST})]
    return {"others": others} | {name: [tiny_training(name)] for name in stock.ALGORITHMS}


def beside_scipy(quick, frames):
    return [cell for cell in speed.cells_of_times(quick, frames) if cell.labels["rival"] == contenders.CAREFUL]


def few_operators():
    for cell in teleop.assisted(True, {}):
        place = tuple(cell.labels[name] for name in ("coupling", "operator", "delay"))
        if place in [("spring", "reach", 0.2), ("rigid", "steady", 0.2)] and cell.labels["seed"] in (0, 1):
            scenarios = {**cell.arguments["scenarios"], "count": 25}
            yield cell._replace(arguments=cell.arguments | {"scenarios": scenarios})


def tiny_training(algorithm):
    small = {"n_timesteps": 64, "n_envs": 8, "n_steps": 4, "batch_size": 32, "learning_starts": 16}
    cell = next(iter(stock.trainings(algorithm, True, {})))
    cell.arguments["settings"].update({key: small[key] for key in small.keys() & cell.arguments["settings"].keys()})
    return cell


def small_run(name, folder):
    """A run of a study, in this process, of the few cells alone."""
    study, cells = studies.load(name), cells_of(name)
    few = [
        replace(each, cells=made if callable(made := cells[each.name]) else lambda *_, made=made: made, processes=0)
        for each in study.measurements if each.name in cells
    ]  # fmt: skip
    return Run(replace(study, measurements=few), StudyOptions(folder, quick=True, processes=0), "the command")


def watched_run(name, folder):
    """Write a small run; return it, and by function the files of the project whose code ran or that were read."""
    used, perform, read = defaultdict(set), jobs.perform, builtins.open

    def watched(call, versions):
        def opened(file, *options, **named):
            used[call.function].add(file)
            return read(file, *options, **named)

        with pytest.MonkeyPatch.context() as patch:
            for module in (io, builtins):
                patch.setattr(module, "open", opened)
            sys.setprofile(
                lambda frame, event, _: event == "call" and used[call.function].add(frame.f_code.co_filename)
            )
            try:
                return perform(call, versions)
            finally:
                sys.setprofile(None)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jobs, "perform", watched)
        (run := small_run(name, folder)).write()
    ours = tuple(f"{ROOT}/{package}/" for package in ("impact_gym", "agents", "experiments"))
    return run, {
        function: {Path(file) for file in files if str(file).startswith(ours)} for function, files in used.items()
    }
