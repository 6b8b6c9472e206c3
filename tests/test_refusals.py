"""Bad input is refused in one line that names field, value, unit and what is allowed: see refusals.toml.

tests/task/test_quantities.py has the refusals that follow from the table of quantities: limits, types, reversed pairs.
"""

import os
import tomllib
from dataclasses import MISSING
from dataclasses import fields as dataclass_fields
from functools import partial
from itertools import product
from pathlib import Path
from pkgutil import resolve_name

import pytest
from refusal import Allowed, changed, check_number, filled, records, refused
from refused_calls import CALLS, set_up_file, value_of

import impact_gym as ig
from agents import setups
from agents.setups.evaluation import SET_UP_ARGUMENTS, Evaluation
from agents.setups.setup import Tuned
from impact_gym.task import Task
from impact_gym.task.task import PARTS
from impact_gym.validation import shown

TABLE = tomllib.loads(Path(__file__).with_name("refusals.toml").read_text())
EXAMPLES = TABLE.pop("examples")
OF_RECORDS = ("identify", "robot", "simulation")


def cases(first, *rest):
    """The changes of a row, each with the words of its message."""
    if isinstance(first, dict):
        return [(first, rest)]
    values, *words = rest
    return [
        ({path: value}, [word.replace("{name}", path.split(".")[-1]).replace("{value}", repr(value)) for word in words])
        for path, value in product(first.split(), values)
    ]


def calls(package, name, changes):
    """The calls of the functions of a table with its good arguments and some changes."""
    table = TABLE[package][name]
    arguments = changed(*(filled(tree, EXAMPLES, value_of) for tree in (table.get("good", {}), changes)))
    functions = CALLS.get(name) or resolve_name(name if ":" in name else f"impact_gym:{name}")
    for function in functions if isinstance(functions, list) else [functions]:
        yield lambda function=function: function(**(records(arguments) if package in OF_RECORDS else arguments))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, request):
    """The working directory, to which tests write, also modules; tests of an arm's own equations need MuJoCo."""
    if "[robot " in request.node.name:
        pytest.importorskip("mujoco", reason="the extra robot is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def each(key):
    """The tables that have this key."""
    found = [(package, name) for package, tables in TABLE.items() for name, table in tables.items() if key in table]
    return pytest.mark.parametrize(("package", "name"), found, ids=map(" ".join, found))


ROWS = [
    pytest.param(package, name, row, id=f"{package} {name} {row[:2]}"[:100])
    for package, tables in TABLE.items() for name, table in tables.items() for row in table.get("refused", ())
]  # fmt: skip


@pytest.mark.parametrize(("package", "name", "row"), ROWS)
def test_refusal_names_field_value_and_unit_in_one_line(package, name, row, folder):
    for changes, words in cases(*row):
        for call in calls(package, name, changes):
            with pytest.raises((ValueError, SystemExit)) as refusal:
                call()
            message = str(refusal.value).removeprefix(f"{folder}{os.sep}")
            message = message.partition(" was raised from the environment creator")[0]  # the rest is Gymnasium's
            kinds = [kind.__name__ for kind in type(refusal.value).__mro__]
            assert "\n" not in message
            assert [word for word in words if word not in f"{kinds}: {message}\n"] == [], (changes, message)
            assert "ValueError" in kinds or message.startswith(f"{name}: ")
            assert message.startswith(tuple(os.listdir())) == ("file" in TABLE[package][name])


@each("numbers")
def test_number_is_taken_up_to_its_limits_and_not_beyond(package, name):
    of_file = "file" in TABLE[package][name]
    for paths, text in TABLE[package][name]["numbers"].items():
        for path in paths.split():
            places = [part for part in path.split(".") if not part.isdigit()]

            def take(value, path=path):
                for call in calls(package, name, {path: value}):
                    call()

            check_number(take, places[-1], Allowed.of(text), of_file)


@each("good")
def test_arguments_without_changes_are_accepted(package, name):
    for call in calls(package, name, {}):
        call()


def test_misspelt_key_of_a_set_up_names_the_right_one():
    tables = {
        "": ("title", "about", "fails", "extends", "environment", "training", "baselines", "evaluation"),
        "environment.": SET_UP_ARGUMENTS, "training.": [field.name for field in dataclass_fields(setups.Training)],
        "baselines.": ("against", "tuned", "bound", "budget"), "baselines.tuned.a.": Tuned._fields,
        "evaluation.": [field.name for field in dataclass_fields(Evaluation)],
        "evaluation.nominal.": SET_UP_ARGUMENTS, "evaluation.varied.tool_mass.": ("times",),
    }  # fmt: skip
    rule = {"baselines": {"tuned": {"a": {"rule": "BlindProfile"}}}}
    for place, names in tables.items():
        for name in names:
            wrong = changed(rule, {f"{place}{name[:-1]}": 1})
            refused(lambda wrong=wrong: set_up_file(**wrong), f"unknown key {place}{name[:-1]}; did you mean {name!r}?")


@pytest.mark.parametrize(("argument", "kinds"), PARTS.items(), ids=PARTS)
def test_description_of_a_record_names_its_kind_and_fields(argument, kinds):
    names = [kind.__name__ for kind in kinds]
    wrong = [3, "Rigid", ig.Tool, *[{}, {"stiffness": 50.0}, {"type": 3}, {"type": "Pilot"}] * (len(kinds) > 1)]
    for value in wrong:
        refused(partial(Task, **{argument: value}), f"{argument} must be", *names, shown(value))
    for kind in kinds:
        fields = {field.name: field.default is MISSING for field in dataclass_fields(kind)}
        given = {"type": kind.__name__, "misspelt": 1.0}
        refused(partial(Task, **{argument: given}), argument, "'misspelt'", *map(repr, fields))
        for name in (name for name, needed in fields.items() if needed):
            refused(partial(Task, **{argument: {"type": kind.__name__}}), argument, "needs", repr(name))


@pytest.mark.parametrize("rule", setups.RULES)
def test_rule_takes_each_parameter_up_to_its_limits(rule):
    kind = resolve_name(f"agents.baselines:{rule}")
    start = [parameter.start for parameter in kind.PARAMETERS]
    for place, parameter in enumerate(kind.PARAMETERS):
        allowed = Allowed(parameter.unit, at_least=parameter.low, at_most=parameter.high)

        def take(value, place=place):
            return kind.of([*start[:place], value, *start[place + 1 :]])

        check_number(take, parameter.name, allowed, wrong=())
