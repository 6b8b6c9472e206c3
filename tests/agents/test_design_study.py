"""A search for a design that is killed goes on, validation chooses, and what is chosen is a set-up."""

from dataclasses import replace

import numpy as np
import pytest

from agents.baselines.cmaes import minimise
from agents.baselines.rule import Parameter
from agents.baselines.tuned import read_tuned
from agents.design import search
from agents.design import study as study_of_designs
from agents.design.__main__ import DesignOptions, write
from agents.design.journal import journaled
from agents.design.pads import on_pad, pad_of
from agents.design.study import run
from agents.setup import check
from agents.setups import load_setup
from agents.train.settings import default_settings

STIFFNESS, SPRING = "coupling.stiffness=20:200", ("coupling.stiffness=20:200", "coupling.damping_ratio=0.2:2")


@pytest.fixture
def small(tmp_path):
    """A search that takes seconds and finds little."""
    few = {"scenarios": 12, "budget": 24, "population": 8, "seeds": 1, "processes": 0, "against": ()}
    return DesignOptions("linear-blind", SPRING, tmp_path / "out", times=(1.0, 1.3), **few)


BOWL = tuple(Parameter(name, "-", -1.0, 1.0, 0.5) for name in "xy")


def test_a_search_that_is_killed_goes_on_from_its_journal_and_finds_the_same(tmp_path):
    played = []

    def losses(candidates):
        played.append(len(candidates))
        return np.sum(candidates**2, axis=-1)

    def found(path):
        result = minimise(journaled(losses, path), BOWL, population=8, generations=12, seed=3)
        return result.parameters.tolist(), result.loss.tolist()

    whole = found(tmp_path / "whole.jsonl")
    lines = (tmp_path / "whole.jsonl").read_bytes().splitlines(keepends=True)
    for torn in (b"".join(lines[:5]), b"".join(lines[:5]) + lines[5][:20], b"no journal\n" + lines[1]):
        kept = 0 if torn.startswith(b"no") else 5
        played.clear()
        (tmp_path / "torn.jsonl").write_bytes(torn)
        assert found(tmp_path / "torn.jsonl") == whole
        assert len(played) == 12 - kept
        assert (tmp_path / "torn.jsonl").read_bytes() == b"".join(lines)


def test_a_journal_of_another_search_is_not_taken_for_this_one(tmp_path):
    def found(seed, path):
        return minimise(journaled(lambda x: np.sum(x**2, axis=-1), path), BOWL, population=8, generations=6, seed=seed)

    alone = found(2, tmp_path / "alone.jsonl")
    found(1, tmp_path / "one.jsonl")
    assert np.array_equal(found(2, tmp_path / "one.jsonl").parameters, alone.parameters)


class Stopped(BaseException):
    """As if the process ended here."""


def test_a_study_that_was_stopped_plays_only_what_is_missing_and_ends_with_a_set_up(small, monkeypatch):
    study, count, stop_at = small.study(), [0], [4]
    losses = search.minimise

    def counted(function, *arguments):
        def one_more(candidates):
            if count[0] == stop_at[0]:
                raise Stopped
            count[0] += 1
            return function(candidates)

        return losses(one_more, *arguments)

    monkeypatch.setattr(search, "minimise", counted)
    with pytest.raises(Stopped):
        run(study)
    journals = sum(len(path.read_bytes().splitlines()) for path in (small.out / "journal").glob("*.jsonl"))
    assert journals == 4
    stop_at[0] = -1
    entries = run(study)
    unbroken = run(replace(small, out=small.out / "unbroken").study())
    assert [(one.design, one.parameters) for one in entries] == [(one.design, one.parameters) for one in unbroken]
    assert [(one.line, one.share) for one in entries] == [
        ("paper's rule", 1.0), ("designs", 1.0), ("designs", 1.3), ("chosen", 1.0), ("chosen", 1.3),
        ("paper's spring", 1.0), ("paper's spring", 1.3),
    ]  # fmt: skip
    count[0] = 0
    again = run(study)
    assert count[0] == 0
    assert [one.parameters for one in again] == [one.parameters for one in entries]
    path = write(entries, study.setup, small, 1.0)
    of_controller = path.read_text().splitlines()[1].removeprefix("# Its controller: the BlindProfile with ")
    assert [float(each) for each in of_controller.split(", ")] == pytest.approx(entries[1].parameters, rel=1e-5)
    made = load_setup(path)
    check(made, str(path))
    assert made.environment["coupling"]["stiffness"] == entries[1].design["coupling.stiffness"]
    assert made.environment["tool_mass"] == study.setup.environment["tool_mass"]
    settings, before = default_settings(str(path)), default_settings("linear-blind")
    assert settings.learning_rate == before.learning_rate
    assert (settings.rollout, settings.gae_lambda) == (before.rollout, before.gae_lambda)


def test_a_pad_of_the_chosen_design_is_in_the_ranges_of_its_set_up(small):
    options = replace(small, pad="memory-foam", budget=8, times=(1.0,), free=(STIFFNESS,))
    entries = run(options.study())
    setup = load_setup(write(entries, options.study().setup, options, 1.0))
    scenario = setup.environment["scenario"]
    pad = pad_of("memory-foam")
    assert scenario["contact_stiffness"][1] < pad.stiffness
    assert scenario["contact_stiffness"][0] == pytest.approx(on_pad("memory-foam", 1e3, 0.5)[0])
    assert scenario["distance"] == [0.15, 0.35]
    assert "draws stiffness and restitution of the contact independently" in setup.about


@pytest.mark.parametrize(("found", "best"), [
    ([(0.20, 0.30, 0.0), (0.19, 0.30, 0.0)], 2),
    ([(0.20, 0.30, 0.0), (0.19, 0.306, 0.0)], 1),  # 2 % later
    ([(0.20, 0.30, 0.0), (0.19, 0.28, 0.0)], 2),
    ([(0.20, 0.30, 0.0), (0.10, 0.28, 0.1)], 1),  # a tenth beyond a limit
    ([(0.20, 0.30, 0.2), (0.19, 0.30, 0.1)], 2),
])  # fmt: skip
def test_of_two_searches_validation_chooses_and_a_later_approach_or_a_limit_that_is_not_kept_counts_against_one(
    found, best, small, monkeypatch
):
    asked = []

    def played(_, entries, scenarios):
        asked.append(scenarios)
        results = [(0.6, 0.30, 0.0), *found]  # the paper's rule first
        names = ("object_velocity", "approach_time", "excess")
        means = [dict(zip(names, np.array(each)[:, None], strict=True)) for each in results]
        return [replace(one, played=each) for one, each in zip(entries, means, strict=True)]

    monkeypatch.setattr(study_of_designs, "played", played)
    designs = [study_of_designs.Entry("designs", 1.0, {}, "BlindProfile", [], {}, seed=seed) for seed in (1, 2)]
    assert study_of_designs._best(small.study(), designs).seed == best
    assert asked == [["validation", None]]


SPRINGS = [
    {"coupling.stiffness": 60.0, "coupling.damping_ratio": 0.3},
    {"coupling.stiffness": 200.0, "coupling.damping_ratio": 2.0},
]
DOES = {
    "deflection": lambda played: played["deflection"].max(),
    "stroke": lambda played: played["stroke"].max(),
    "peak_force": lambda played: np.quantile(played["peak_force"], 0.95),
    "energy": lambda played: np.quantile(played["energy"], 0.95),
    "touched_once": lambda played: (played["contact_count"] == 1).mean(),
}  # fmt: skip


@pytest.mark.parametrize("limit", DOES)
def test_a_design_that_breaks_a_limit_is_not_chosen_though_it_leaves_the_object_slower(limit, small):
    profile = list(read_tuned("blind-profile")["weights"]["2"]["parameters"].values())
    designs = [study_of_designs.Entry("designs", 1.0, spring, "BlindProfile", profile, {}) for spring in SPRINGS]
    free = replace(small, deflection=1.0).study()
    one, other = (DOES[limit](each.played) for each in study_of_designs.played(free, designs, ["validation", None]))
    assert study_of_designs._best(free, designs).design == SPRINGS[0]
    limited = replace(small, **{"deflection": 1.0, limit: float(one + other) / 2}).study()
    assert study_of_designs._best(limited, designs).design == SPRINGS[1]
