"""Bad input is refused in one line that names field, value, unit and what is allowed: see refusals.toml.

tests/task/test_quantities.py has the refusals that follow from the table of quantities: limits, types, reversed pairs.
"""

import gzip
import io
import json
import os
import re
import tomllib
import zipfile
from dataclasses import MISSING, replace
from dataclasses import fields as dataclass_fields
from functools import cache, partial
from itertools import count, product
from pathlib import Path
from pkgutil import resolve_name

import gymnasium as gym
import made_up_arms
import numpy as np
import pytest
import tomli_w
from episode_runs import ID, assert_identical, begin, encode
from made_up_policies import made_up_policy
from recorded_hits import FLAT, FORCE, MOTION, NOISE, SCENE, SCENE_FILE, TIME, put, write_log
from refusal import Allowed, changed, check_number, filled, records, refused
from tiny_training import tiny

import impact_gym as ig
from agents import archive, check, load_policy, load_setup, setups
from agents.baselines import PaperTrapezoid, load_baseline
from agents.policies import Ensemble, Policy
from agents.policies.policy import FORMAT
from agents.setups import feasible
from agents.setups.evaluation import SET_UP_ARGUMENTS, Evaluation
from agents.setups.setup import Tuned
from experiments.design.options import DesignOptions
from experiments.play import __main__ as playing
from experiments.play.assistance import playable
from experiments.report import __main__ as reports
from impact_gym.envs.batch import Batch
from impact_gym.identify.__main__ import main as identify_command
from impact_gym.robot import all_joints, default_approach, from_urdf
from impact_gym.robot.viper import angles_at, viper
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task, evaluation_sets
from impact_gym.task.task import PARTS
from impact_gym.validation import shown

TABLE = tomllib.loads(Path(__file__).with_name("refusals.toml").read_text())
EXAMPLES = TABLE.pop("examples")
OF_RECORDS = ("identify", "robot", "simulation")
VELOCITY = 50.0 * FORCE / FORCE.max()
MOMENTS = count(1)
six = cache(viper)


def file_of(name, read):
    """A function that writes a file with some content and reads it."""

    def reading(text):
        Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
        read(name)

    return reading


def altered_set(line, pattern, instead):
    lines = (evaluation_sets.SHIPPED / "hard.csv").read_text().splitlines(keepends=True)
    lines[line] = re.sub(pattern, instead, lines[line], count=1)
    Path("mine.csv").write_text("".join(lines))
    evaluation_sets.load("mine.csv")


def set_up_file(text="", **tree):
    Path("bad.toml").write_text(text or tomli_w.dumps(tree))
    os.utime("bad.toml", ns=(moment := next(MOMENTS), moment))  # read anew, however soon after the last one
    return load_setup("bad.toml")


def report(own=None, out="out", **options):
    """A refused report writes nothing; `own` is the content of a file of scenarios."""
    Path("crooked.py").write_text("class Rule:\n    def predict(self, seen, **more):\n        return seen[0], None\n")
    if own is not None:
        Path("own.json").write_text(own if isinstance(own, str) else json.dumps(own))
        options["scenarios"] = "own.json"
    try:
        reports.write(reports.ReportOptions(**{"policy": ("linear-blind",), "out": Path(out), **options}))
    finally:
        assert not Path("out").exists()


def policy_file(content, arrays):
    packed, weights = Ensemble([made_up_policy(sizes=())], 0).packed()
    weights |= {name: np.array(values, np.float32) for name, values in arrays.items()}
    Path("policy.npz").write_bytes(archive.archive_of(FORMAT, changed(packed, content), weights))
    load_policy("policy.npz")


def saved(save):
    save(file := io.BytesIO())
    return file.getvalue()


MAKERS = (gym.make, gym.make_vec, lambda _, num_envs=2, **options: ImpactVecEnv(num_envs, **options))


def stepped(make, action):
    """In a batch the action of the last slot is bad; no slot moves."""
    env, twin = make(ID), make(ID)
    assert_identical(env.reset(seed=3), twin.reset(seed=3))
    bad = action if action is None else np.array(action)
    if bad is not None and env.action_space.shape[:-1]:
        bad = np.stack([np.zeros_like(bad), bad])
    with pytest.raises(ValueError, match="action") as refusal:
        env.step(bad)
    assert "finite" not in str(refusal.value) or bad.ndim == 1 or "action[1]" in str(refusal.value)
    assert "shape" not in str(refusal.value) or str(env.action_space.shape) in str(refusal.value)
    good = np.broadcast_to(encode(1.0, 8.0), env.action_space.shape)
    assert_identical(env.step(good), twin.step(good))
    raise refusal.value


def reset_with(make, **options):
    """A refused reset draws nothing: the next episode, whose draws a critic observes, is the same as without it."""
    env, twin = (make(ID, tool_mass=(0.1, 0.2), privileged=True) for _ in range(2))
    assert_identical(begin(env, seed=7), begin(twin, seed=7))
    with pytest.raises(ValueError, match="option") as refusal:
        begin(env, options=options)
    assert_identical(begin(env, options={}), begin(twin, options={}))
    raise refusal.value


def bare(make, **options):
    return getattr(env := make(ID, **options), "unwrapped", env)


def identify_main(changes, text="", words=()):
    Path("my.toml").write_text(text or tomli_w.dumps(changed(tomllib.loads(SCENE_FILE), changes)))
    write_log("log.csv", {"time": TIME, "force": FORCE})
    identify_command(["log.csv", "--scene", "my.toml", *words])


def arm(make=made_up_arms.rods, base="base", tip="tip", **options):
    return from_urdf(make(Path()), base, tip, **made_up_arms.ELASTIC | options)


def urdf(old="", new="", joint=(), more="", **options):
    more = made_up_arms.joint(*joint) if joint else more
    old, new = ("</robot>", f"{more}</robot>") if more else (old, new)
    arm(partial(made_up_arms.edited, old=old, new=new), **options)


ATTRIBUTES = {
    "mass": 'mass value="', "ixx": 'ixx="', "upper": 'name="shoulder".*?upper="', "xyz": 'name="elbow".*?xyz="',
    "rpy": 'name="elbow".*?rpy="',
}  # fmt: skip


def number_in_urdf(**text):
    ((name, value),) = text.items()
    urdf(f'({ATTRIBUTES[name]})[^"]*', rf"\g<1>{value}")


@cache
def usual_arm():
    return arm()


@cache
def usual_line():
    return usual_arm().along((0.1, 1.6), (1.0, 0.5, 0.0), 0.2)


def blow(approach=None, **given):
    mine, line = usual_arm(), usual_line()
    all_joints.simulate(**{"arm": mine, "approach": approach(line) if callable(approach) else approach or line} | given)


CALLS = {
    "impact-gym report": report, "report of own scenarios": report,
    "impact-gym check": lambda **tree: [*check.lines(set_up_file(**tree))],
    "set-up file": set_up_file, "set-up": set_up_file, "number in a URDF": number_in_urdf, "policy file": policy_file,
    "no policy file": file_of("policy.npz", load_policy),
    "Ensemble": lambda sizes, chosen: Ensemble(
        [made_up_policy(seed + 1, sizes=each) for seed, each in enumerate(sizes)], chosen),
    "feasible.warnings": lambda **options: feasible.warnings(Task(**options)),
    "training": lambda **options: tiny(**options).made_for(), "Policy.predict": made_up_policy().predict,
    "load_baseline for an environment": lambda name, environment: load_baseline(name).for_task(Task(**environment)),
    "Policy": lambda environment: Policy(made_up_policy().network, Task(**environment), {}),
    "make": [partial(make, ID) for make in MAKERS], "make_vec": partial(gym.make_vec, ID),
    "make with an operator": [partial(make, ID) for make in MAKERS],
    "make a batch of one or stable-baselines3's": [partial(make, ID) for make in MAKERS[1:]],
    "step": [partial(stepped, make) for make in (gym.make, partial(gym.make_vec, num_envs=2))],
    "set_scenario": [lambda scenario, make=make: bare(make).set_scenario(scenario) for make in MAKERS],
    "reset options": [partial(reset_with, make) for make in MAKERS],
    "reset": [bare(make).reset for make in (gym.make, gym.make_vec)],
    "reset of a batch of 2": gym.make_vec(ID, num_envs=2).reset,
    "Batch of 3 rows": lambda tasks: Batch(3, [Task(**task) for task in tasks]),
    "set_state": [
        lambda rows, make=make: bare(make, num_envs=8).set_state(bare(make, num_envs=rows).get_state())
        for make in MAKERS[1:]],
    "file of delays": file_of("delays.csv", lambda name: ig.Channel(trace=Path(name))),
    "log file": file_of("log.csv", lambda name: ig.identify(name, SCENE, MOTION, ("contact.stiffness",))),
    "impact-gym identify": identify_main, "URDF": urdf, "altered evaluation set": altered_set,
    "file that is no URDF": file_of("arm.urdf", lambda name: from_urdf(name, "base", "tip", **made_up_arms.ELASTIC)),
    "impact-gym play": lambda setup="teleop-rigid", **options: playing.work(playing.Play(setup, open=False, **options)),
    "played set-up": lambda **tree: [set_up_file(**tree), playable("bad.toml")],
    "DesignOptions": lambda **options: DesignOptions(out=Path(), **options).checked(), "from_urdf": arm,
    "along": lambda start, direction, length, **options: (arm(**options) if options else usual_arm()).along(
        start, direction, length),
    "all_joints.simulate": blow,
    "angles_at": lambda **place: angles_at(six(), **place), "jacobian": lambda angles: six().jacobian(angles),
    "Approach": partial(replace, default_approach()), "Approach.robot_table": default_approach().robot_table,
}  # fmt: skip
"""The function that each table calls, by the table's name. If there are several, all refuse the same input."""


def samples(index):
    return {"time": TIME[index], "force": FORCE[index]}


APPROACH = default_approach()
THINGS = {
    "folder": Path(),
    "None": None, "10^30": 10**30, "class of tools": ig.Tool, "hu-guo in bytes": b"hu-guo",
    "a function": len, "no numbers": np.array([]), "1 x 2 numbers": np.array([[0.01, 0.02]]),
    "5 zeros": np.zeros(5), "7 zeros": np.zeros(7, np.float32), "8 nan": np.full(8, np.nan),
    "3 x 8 zeros": np.zeros((3, 8)), "2 x 9 zeros": np.zeros((2, 9)), "2 False": np.zeros(2, bool),
    "3 True": np.ones(3, bool), "2 ones": np.ones(2, int), "numbers as objects": np.array([0.0, 0.5], object),
    "a complex number": np.array([0.0, 0.5j]),
    "gzip": gzip.compress(b"<robot/>", mtime=0), "Latin-1": '<robot name="ä"/>'.encode("latin-1"),
    "a pickle": b"\x80\x04", "an array's file": saved(lambda file: np.save(file, np.zeros(3))),
    "a zip of no arrays": saved(lambda file: zipfile.ZipFile(file, "w").writestr("header.npy", "not an array")),
    "an array of too many rows": saved(lambda file: zipfile.ZipFile(file, "w").writestr(
        "header.npy", b"\x93NUMPY\x01\0\x58\0" + b"%-88s" % repr(
            {"descr": "<f8", "fortran_order": False, "shape": (2**70, 0)}).encode())),
    "an archive of version 9": archive.archive_of("impact_gym policies 9", {}, {}),
    "time since 1970 with a step back": put(1.7e9 + 0.25 * np.arange(len(TIME)), 2, 1.7e9 + 0.125),
    "time": TIME, "force": FORCE, "noise": NOISE, "log with a gap": samples(np.r_[0:50, 71:161]),
    "time with a step back": put(TIME, 30, TIME[20]), "time in ms": 1e3 * TIME, "time with nan": put(TIME, 7, np.nan),
    "force in mN": 1e6 * FORCE / FORCE.max(), "force in kN": FORCE / 1e3, "force with nan": put(FORCE, 7, np.nan),
    "velocity in mm/s": VELOCITY, "velocity in m/s": VELOCITY / 100.0, "no motion": 0.0 * FORCE,
    "force cut off above": np.minimum(FORCE, 0.6 * FORCE.max()), "force of the other sign": -FORCE,
    "force cut off below": -np.minimum(FORCE, 0.6 * FORCE.max()), "force without its end": FORCE[:-1],
    "log that stays at the bottom": {"time": TIME[: len(FLAT)], "force": FLAT}, "log of 5 samples": samples(np.s_[:5]),
    "log of two blows": {"time": TIME[0] + np.arange(2 * len(TIME)) / 4000.0, "force": np.tile(FORCE, 2)},
    "log of 8 samples": samples(np.s_[30:62:4]), "complex force": FORCE + 0j,
    "force in a column": FORCE[:, None], "other force": FORCE + 0.1 * NOISE, "backward": -VELOCITY / 100.0,
    "two links of which one can hardly turn": partial(made_up_arms.edited, old=made_up_arms.SHOULDER,
                                                      new=r'\1"0.2" upper="0.4"'),
    "angles without the last place": APPROACH.joint_angles[:-1], "an approach": APPROACH,
    "angles without the last joint": APPROACH.joint_angles[:, :-1], "one approach": (APPROACH,),
    "two approaches": (APPROACH, APPROACH), "a servo": all_joints.Servo(), "the paper's rule": PaperTrapezoid(),
    "a set-up": load_setup("rigid-blind"),
    "that of another arm":
    lambda _: arm(made_up_arms.slides, joint_stiffness=1e5).along((0.0, 0.0), (1.0, 0.5, 0.0), 0.2),
    "the same from elsewhere": lambda line: replace(line, start=line.start + 0.01),
}  # fmt: skip
"""Values that TOML has no notation for."""


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
    good, changes = (filled(tree, EXAMPLES) for tree in (table.get("good", {}), changes))
    arguments = filled(changed(good, changes), THINGS)
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
