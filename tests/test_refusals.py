"""Bad input is refused in one line that names field, value, unit and what is allowed: see refusals.toml.

tests/task/test_quantities.py has the refusals that follow from the table of quantities: limits, types, reversed pairs.
"""

import os
import tomllib
from dataclasses import MISSING, fields
from functools import partial
from itertools import product
from pathlib import Path
from pkgutil import resolve_name

import pytest
from refusal import Allowed, changed, check_number, refused
from refused_calls import CALLS, value_of

import impact_gym as ig
from agents.baselines import RULES
from impact_gym.support.validation import shown
from impact_gym.task import Task
from impact_gym.task.task import PARTS

TABLE = tomllib.loads(Path(__file__).with_name("refusals.toml").read_text())
EXAMPLES = TABLE.pop("examples")
OF_RECORDS = ("identify", "robot", "simulation")
TABLES = {(package, name): table for package, tables in TABLE.items() for name, table in tables.items()}
ROWS = [(*place, row) for place, table in TABLES.items() for row in table.get("refused", ())]
ACCEPTING = [place for place, table in TABLES.items() if {"good", "numbers"} & table.keys()]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, request):
    """The working directory, to which tests write, also modules; tests of an arm's own equations need MuJoCo."""
    if "[robot " in request.node.name:
        pytest.importorskip("mujoco", reason="the extra robot is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)


def filled(value, records=False):
    """An example for "@name", what `value_of` makes of "=text"; with `records`, a record for {type = "Name", ...}."""
    if isinstance(value, dict):
        given = {name: filled(inner, records) for name, inner in value.items()}
        return getattr(ig, given.pop("type"))(**given) if records and "type" in given else given
    if isinstance(value, list):
        return [filled(inner, records) for inner in value]
    if isinstance(value, str) and value[:1] == "@":
        return filled(EXAMPLES[value[1:]], records)
    return value_of(value[1:]) if isinstance(value, str) and value[:1] == "=" else value


def calls(package, name, changes):
    """The calls of the functions of a table with its good arguments and some changes."""
    arguments = changed(filled(TABLES[package, name].get("good", {})), filled(changes))
    functions = CALLS.get(name) or resolve_name(name if ":" in name else f"impact_gym:{name}")
    for function in functions if isinstance(functions, list) else [functions]:
        yield lambda function=function: function(**filled(arguments, package in OF_RECORDS))


def cases(first, *rest):
    """The changes of a row, each with the words of its message."""
    if isinstance(first, dict):
        yield first, rest
        return
    values, *words = rest
    for path, value in product(first.split(), values):
        name = path.rpartition(".")[2]
        said = (word.replace("{path}", path).replace("{name}", name).replace("{value}", repr(value)) for word in words)
        yield {path: value}, [*said]


@pytest.mark.parametrize(("package", "name", "row"), ROWS, ids=[f"{a} {b} {row[:2]}"[:100] for a, b, row in ROWS])
def test_refusal_names_field_value_and_unit_in_one_line(package, name, row):
    for changes, words in cases(*row):
        for call in calls(package, name, changes):
            error = refused(call, " ", *(word for word in words if word != "TypeError"))
            assert isinstance(error, TypeError) or "TypeError" not in words
            message = str(error).removeprefix(f"{Path.cwd()}{os.sep}")
            assert message.startswith(tuple(os.listdir())) == ("file" in TABLES[package, name])


@pytest.mark.parametrize(("package", "name"), ACCEPTING, ids=map(" ".join, ACCEPTING))
def test_number_is_taken_up_to_its_limits_and_not_beyond(package, name):
    table = TABLES[package, name]
    for call in calls(package, name, {}) if "good" in table else ():
        call()
    for paths, text in table.get("numbers", {}).items():
        for path in paths.split():
            field = [part for part in path.split(".") if not part.isdigit()][-1]

            def take(value, path=path):
                for call in calls(package, name, {path: value}):
                    call()

            check_number(take, field, Allowed.of(text), "file" in table)


@pytest.mark.parametrize(("argument", "kinds"), PARTS.items(), ids=PARTS)
def test_description_of_a_record_names_its_kind_and_fields(argument, kinds):
    wrong = [3, "Rigid", ig.Tool, *[{}, {"stiffness": 50.0}, {"type": 3}, {"type": "Pilot"}] * (len(kinds) > 1)]
    for value in wrong:
        refused(partial(Task, **{argument: value}), f"{argument} must be", *(k.__name__ for k in kinds), shown(value))
    for kind in kinds:
        needs = {field.name: field.default is MISSING for field in fields(kind)}
        given = {"type": kind.__name__, "misspelt": 1.0}
        refused(partial(Task, **{argument: given}), argument, "'misspelt'", *map(repr, needs))
        for name in (name for name, needed in needs.items() if needed):
            refused(partial(Task, **{argument: {"type": kind.__name__}}), argument, "needs", repr(name))


@pytest.mark.parametrize("kind", RULES.values(), ids=RULES)
def test_rule_takes_each_parameter_up_to_its_limits(kind):
    start = [parameter.start for parameter in kind.PARAMETERS]
    for place, parameter in enumerate(kind.PARAMETERS):
        allowed = Allowed(parameter.unit, at_least=parameter.low, at_most=parameter.high)
        take = lambda value, place=place: kind.of([*start[:place], value, *start[place + 1 :]])  # noqa: E731
        check_number(take, parameter.name, allowed, wrong=())
