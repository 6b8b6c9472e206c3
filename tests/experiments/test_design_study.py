"""A study of designs: a killed one continues, validation chooses, the chosen design is a set-up, and the page."""

from dataclasses import replace

import numpy as np
import pytest

from agents.baselines.tuned import read_tuned
from agents.provenance import circumstances
from agents.setups import load_setup
from experiments.design import __main__ as command
from experiments.design import search
from experiments.design.pads import on_pad, pad_of
from experiments.design.page import lines_of, reduction, write_page
from experiments.design.run import PAPERS_RULE, Entry, best, played, run
from experiments.design.search import Effort, Rig
from experiments.design.study import CHOSEN, FRONT, GRID, PAPER, SEEDS, Study, write_setup

STIFFNESS = "coupling.stiffness=20:200"
SPRING = (STIFFNESS, "coupling.damping_ratio=0.2:2")
RUNS = [{"command": "impact-gym design", "seconds": 1.0, **circumstances()}]


@pytest.fixture
def small(tmp_path):
    """A search that takes seconds and finds little."""
    effort = Effort(scenarios=12, budget=24, population=8)
    few = {"effort": effort, "seeds": 1, "processes": 0, "against": ()}
    return Study("linear-blind", SPRING, tmp_path / "out", times=(1.0, 1.3), **few)


class Stopped(BaseException):
    """As if the process ended here."""


def test_run_continues_a_stopped_study_and_ends_with_a_set_up(small, monkeypatch):
    searches, stop_at, original = [], [2], search.minimise

    def counted(*arguments):
        if len(searches) == stop_at[0]:
            raise Stopped
        searches.append(original(*arguments))
        return searches[-1]

    monkeypatch.setattr(search, "minimise", counted)
    with pytest.raises(Stopped):
        run(small)
    stop_at[0] = -1
    entries = run(small)
    assert len(searches) == 5  # of two designs, of one chosen at the other time, of two springs
    assert [(entry.line, entry.allowed) for entry in entries] == [
        ("paper's rule", 1.0), (FRONT, 1.0), (FRONT, 1.3), (CHOSEN, 1.0), (CHOSEN, 1.3),
        ("paper's spring", 1.0), ("paper's spring", 1.3),
    ]  # fmt: skip
    assert [entry.rig for entry in run(small)] == [entry.rig for entry in entries]
    assert len(searches) == 5
    path = write_setup(small.out / "it-designed.toml", small.arm, entries[1].rig, "the command")
    parameters = path.read_text().splitlines()[1].removeprefix("# Its controller: the BlindProfile with ")
    assert [float(each) for each in parameters.split(", ")] == pytest.approx(entries[1].rig.parameters, rel=1e-5)
    setup = load_setup(path)
    assert setup.environment["coupling"]["stiffness"] == entries[1].rig.design["coupling.stiffness"]
    assert setup.environment["tool_mass"] == small.arm.environment["tool_mass"]
    assert setup.training == load_setup("linear-blind").training


def test_design_with_a_pad_and_a_grid_writes_set_up_and_page(small, capsys, monkeypatch):
    studied, original = [], command.run
    monkeypatch.setattr(command, "run", lambda study: studied.append(original(study)) or studied[0])
    effort = replace(small.effort, budget=8)
    command.design(replace(small, pad="memory-foam", effort=effort, times=(1.0,), seeds=2, grid=(2, 2)))
    assert "index.html" in capsys.readouterr().out
    assert "Is it the optimum?" in (small.out / "index.html").read_text()
    assert len((small.out / "grid.csv").read_text().splitlines()) == 1 + 2 + 4  # two seeds, and the grid
    setup = load_setup(small.out / "linear-blind-designed.toml")
    scenario = setup.environment["scenario"]
    assert scenario["contact_stiffness"][1] < pad_of("memory-foam").stiffness
    assert scenario["contact_stiffness"][0] == pytest.approx(on_pad("memory-foam", 1e3, 0.5)[0])
    assert scenario["distance"] == [0.15, 0.35]
    assert "draws stiffness and restitution of the contact independently" in setup.about
    lines = lines_of(studied[0])
    assert {entry.seed for entry in lines[SEEDS]} == {1, 2}
    designs = sorted(tuple(entry.rig.design.values()) for entry in lines[GRID])
    assert designs == [(20.0, 0.2), (20.0, 2.0), (200.0, 0.2), (200.0, 2.0)]
    for entry in lines[GRID]:
        for name, value in entry.rig.design.items():  # a search meets it a fifth further off than it may be built
            built = entry.rig.environment["coupling"][name.removeprefix("coupling.")]
            assert built == pytest.approx([0.94 * value, 1.06 * value])


@pytest.mark.parametrize(("results", "seed"), [
    ([(0.20, 0.30, 0.0), (0.19, 0.30, 0.0)], 2),
    ([(0.20, 0.30, 0.0), (0.19, 0.306, 0.0)], 1),  # 2 % later
    ([(0.20, 0.30, 0.0), (0.19, 0.28, 0.0)], 2),
    ([(0.20, 0.30, 0.0), (0.10, 0.28, 0.1)], 1),  # a tenth beyond a limit
    ([(0.20, 0.30, 0.2), (0.19, 0.30, 0.1)], 2),
])  # fmt: skip
def test_best_counts_a_later_approach_and_exceeded_limits(results, seed):
    def entry(values, number):
        names = ("object_velocity", "approach_time", "excess")
        arrays = dict(zip(names, np.array(values)[:, None], strict=True))
        return Entry(FRONT, 1.0, Rig({}, "BlindProfile"), number, results=arrays)

    entries = [entry(values, number) for number, values in enumerate(results, 1)]
    assert best(entries, entry((0.6, 0.30, 0.0), 0)).seed == seed


def test_page_says_what_the_chosen_design_gains(tmp_path):
    """Two springs with a shipped controller, one on a pad, played on the test set."""
    study = Study("linear-blind", SPRING, tmp_path, times=(1.0,), processes=0, against=())
    slow, *_, hurried = (list(each["parameters"].values()) for each in read_tuned("blind-profile")["weights"].values())
    spring = {"coupling.stiffness": 70.0, "coupling.damping_ratio": 0.4}
    front = Entry(FRONT, 1.0, Rig({"tool_mass": 0.125}, "BlindProfile", hurried, spring))
    on_foam = replace(front, rig=replace(front.rig, parameters=slow, pad="memory-foam"))
    papers = Entry(PAPER, 1.0, Rig({}, *PAPERS_RULE))
    entries = paper, *_, chosen = played(study, [papers, front, on_foam, replace(front, line=CHOSEN)], "test")
    text = write_page(study, entries, "it.toml", RUNS).read_text()
    gain = 1.0 - chosen.results["object_velocity"].mean() / paper.results["object_velocity"].mean()
    assert f"<strong>{100 * gain:.1f} % [" in text
    assert text.count('<td class="words">coupling.stiffness 70 N/m, coupling.damping_ratio 0.4</td>') == 3
    assert f"{1e3 * chosen.results['deflection'].max():.1f} mm against the flange" in text


def test_reduction_reads_a_line_at_the_mean_approach_time_of_the_papers_rule():
    def entry(share, velocity):
        results = {"approach_time": np.full(40, 0.3 * share), "object_velocity": np.full(40, velocity)}
        return Entry(CHOSEN, share, Rig({}, "BlindProfile"), results=results)

    line, paper = [entry(0.9, 0.23), entry(1.1, 0.17)], entry(1.0, 0.6)
    gain = reduction(line, paper)
    assert (gain.value, gain.low, gain.high) == pytest.approx((1.0 - 0.2 / 0.6,) * 3)
