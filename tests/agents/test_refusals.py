"""What is refused, with one line that names field, value and unit: set-up files, arguments, policy files."""

import io
import zipfile
from functools import partial, reduce
from operator import getitem

import numpy as np
import pytest
from policies import made_up_policy
from training import tiny

import impact_gym as ig
from agents import archive, load_policy, load_setup
from agents.baselines import ConstantSpeed, Ranged, load_baseline
from agents.evaluate import ScenarioBatch
from agents.policies import Ensemble, Policy
from agents.policies.policy import FORMAT
from agents.setups import feasible
from agents.setups.training import SLOTS
from agents.train.__main__ import TrainOptions, read_options
from agents.tune import Tune
from impact_gym.task import Task


def rule(text, *said):
    """A row of a baseline `a` with such a table."""
    return f"[baselines.tuned]\na = {text}", "baselines.tuned.a", *said


SETTINGS = {  # of a training
    "steps": "many", "seeds": 0, "envs": SLOTS + 1, "batch": 1, "rollout": 1, "epochs": 0, "width": 1.5,
    "weight_power": 2.0, "gae_lambda": 1.5, "entropy": -1.0, "clip": 0.0, "log_std": 3.0, "learning_rate": 0.0,
    "final_rate": -0.1, "rtol": 0.5, "nominal": 1.5, "activation": "sine", "teacher": 3,
}  # fmt: skip
TIGHT = "{ type = 'Bistable', free_length = 0.07, height = 0.06995, front_stop = 1e-3, rear_stop = -1e-3 }"
HALF = "[[training.mixed]]\nshare = 0.5\n"
SET_UPS = [
    *((f"[training]\n{name} = {value!r}", f"training: {name} must", f"got {value!r}")
      for name, value in SETTINGS.items()),
    ("nonsense", "is not read as TOML", "Expected"), ("titel = 'x'", "unknown key titel; did you mean 'title'"),
    ("title = 3", "title must be a text", "got 3"), ("version = 2", "version must be 1", "got 2"),
    ("environment = 3", "environment must be a table", "got 3"),
    ("[environment]\ntool_mas = 1.0", "unknown key environment.tool_mas; did you mean 'tool_mass'"),
    ("[environment]\ntime_weight = 1.0", "unknown key environment.time_weight"),
    ("[environment]\ntool_mass = [0.2, 0.1]", "environment: tool_mass", "low 0.2 is above high 0.1", "kg"),
    ("[environment.scenario]\nobject_mas = [1.0, 2.0]", "scenario has no field 'object_mas'", "object_mass"),
    ("[environment]\nuplink = { trace = 'none.csv' }", "environment.uplink: Channel.trace", "none.csv not", "in s"),
    ("[training]\nbacth = 3", "training.bacth; did you mean 'batch'"),
    ("[training]\nmixed = [3]", "training.mixed[0] must", "got 3"),
    ("[training]\ntime_weight = [2.0, 1.0]", "training: time_weight", "low 2 is above high 1", "m/s per s"),
    ("[training]\nnominal = 0.5", "nominal must be 0 without a table [evaluation.nominal]", "got 0.5"),
    (f"{HALF}tool_mas = 1.0", "training.mixed[0].tool_mas; did you mean 'tool_mass'"),
    (f"{HALF}past_readings = 2", "training.mixed[0]:", "same observations"),
    ("[[training.mixed]]\ntool_mass = 1.0", "training.mixed[0]: share", "got None", "(no unit)"),
    (f"{HALF}{HALF}{HALF}", "training: nominal and the shares", "at most 1 (no unit), got 1.5"),
    ("[baselines]\nagainst = 'x'", "baselines.against must be a list", "'x'"),
    ("[baselines]\nagainst = ['x', 'x']", "baselines.against must", "twice", "['x', 'x']"),
    ("[baselines]\nagainst = ['bad-profil']", "baselines.against.bad-profil; did you mean 'bad-profile'"),
    ("[baselines]\nbudget = 0", "baselines.budget", "got 0"), ("[baselines]\nbound = 'x'", "baselines.bound.x"),
    rule("'Rule'", "a must be a rule, one of BlindProfile", "got 'Rule'"),
    rule("{ rule = 'Ranged', rtoll = 1.0 }", "a.rtoll; did you mean 'rtol'"),
    rule("{ rule = 'Ranged', rtol = 1.0 }", "a.rtol must", "at most 0.01 (no unit), got 1.0"),
    rule("{ rule = 'BlindProfile', jitter = 2 }", "a.jitter must", "at most 1 (no unit), got 2.0"),
    rule("{ rule = 'BlindProfile', clean_alarm = 1 }", "a.clean_alarm must", "got 1"),
    rule("{ rule = 'BlindProfile', scenarios = 0 }", "a.scenarios must", "got 0"),
    rule("'DetectorProfile'", "environment.deflection_sensor"), rule("'Ranged'", "environment.range_noise"),
    ("[evaluation]\nweigths = [1.0]", "evaluation.weigths; did you mean 'weights'"),
    ("[evaluation]\nweights = []", "evaluation.weights must", "[]"),
    ("[evaluation]\nweights = [1.0, 1.0]", "evaluation.weights must", "none twice", "[1.0, 1.0]"),
    ("[evaluation]\nweights = 'all'", "evaluation.weights must", "'all'", "m/s per s"),
    ("[evaluation]\nweights = [1.0, 20.0]", "evaluation: weights", "at most 8 m/s per s, got 20"),
    ("[evaluation]\ntypical = 0", "evaluation.typical", "above 0 m/s per s, got 0.0"),
    ("[evaluation]\nset = 'tset'", "no evaluation set 'tset': test?"),
    ("[evaluation]\nset = 3", "evaluation.set must", "got 3"),
    ("[evaluation]\nscenarios = 1", "evaluation.scenarios", "got 1"),
    ("[evaluation]\nscenarios = 5000", "evaluation.scenarios", "at most the 2000", "got 5000"),
    ("[evaluation]\nnominal = 3", "evaluation.nominal must", "got 3"),
    ("[evaluation.nominal]\ntool_mas = 1.0", "evaluation.nominal.tool_mas; did you mean 'tool_mass'"),
    ("[evaluation.varied]\ntool_mas = [1.0]", "evaluation.varied.tool_mas; did you mean 'tool_mass'"),
    ("[evaluation.varied]\ntool_mass = 1.0", "evaluation.varied.tool_mass must be a list", "got 1.0"),
    ("[evaluation.varied]\ntool_mass = [-1.0]", "evaluation.varied.tool_mass: tool_mass", "got -1.0", "kg"),
    ("[evaluation.varied]\ntool_mass = { time = [1.0] }", "varied.tool_mass.time; did you mean 'times'"),
    ("[evaluation.varied]\ntool_mass = { times = [0.0] }", "tool_mass: times", "above 0 (no unit), got 0.0"),
    ("[evaluation.varied]\nrobot = [{ type = 'Robot', mass = 1.0 }]", "varied.robot: robot, a Robot, needs", "stiff"),
    (f"[environment]\ncoupling = {TIGHT}\n[evaluation.varied]\n'coupling.front_stop' = {{ times = [4.0] }}",
     "evaluation.varied.coupling.front_stop: ", "0.004"),
]  # fmt: skip
LOOSE = {"coupling": ig.Bistable(5.0), "acceleration_range": (2.0, 20.0)}
CALLS = [
    (lambda: Task(robot={"type": "RobotTable", "position": [0.1, 0.2, 0.3]}), "robot must be a Robot", "RobotTable"),
    (lambda: feasible.warnings(Task(**LOOSE)), "coupling must hold the tool at 2 m/s^2", "0.838", "m/s^2"),
    (lambda: tiny(seed=-1), "seed", "got -1"), (lambda: tiny(teacher="nobody").made_for(), "no baseline 'nobody'"),
    (lambda: tiny(teacher="ranged").made_for(), "Ranged looks at", "distance_estimate"),
    (lambda: read_options(["--resume", "there", "--steps", "5"]), "give nothing else"),
    (lambda: read_options(["cubic"]), "no set-up 'cubic': there are bistable-blind,", "linear-ranged"),
    (lambda: TrainOptions(processes=-1), "processes", "got -1"), (lambda: TrainOptions(seeds=0), "seeds", "got 0"),
    (lambda: TrainOptions(seeds=2, seed=1), "seed must be 0 with seeds", "got 1"),
    (lambda: Tune(weights=(0.0,)), "weights", "above 0 m/s per s, got 0.0"),
    (lambda: Tune(names=("paper-trapezoid",)), "no baseline to tune 'paper-trapezoid': there are ", "ranged-profile"),
    (lambda: Tune(scenarios=0), "scenarios", "at least 1, got 0"),
    (lambda: Tune(population=3), "population", "at least 4, got 3"),
    (lambda: Tune(budget=0), "budget", "at least 1, got 0"),
    (lambda: ConstantSpeed(0.0), "speed", "above 0 m/s, got 0.0"),
    (lambda: ConstantSpeed([1.0, 1.6]), "speed", "at most 1.5 m/s, got 1.6"),
    (lambda: Ranged([1.0, 0.3, 10.0]), "Ranged has the parameters", "'top speed', 'contact speed'", "(3,)"),
    (lambda: load_baseline("ranged").for_environment({}), "Ranged looks at", "distance_estimate, which", "range_noise"),
    (lambda: load_baseline("blind"), "no baseline 'blind': there are", "blind-profile,", "paper-trapezoid"),
    (lambda: load_baseline("blnd-profile"), "no baseline 'blnd-profile': blind-profile?"),
    (lambda: load_baseline("ranged", 0.0), "time_weight", "above 0 m/s per s, got 0.0"),
    (lambda: ScenarioBatch.of("validation", 1001), "the set has 1000 scenarios", "not 1001"),
    (lambda: made_up_policy().predict(np.zeros(7, np.float32)), "takes 8 numbers", "(7,)"),
    (lambda: made_up_policy().predict(np.full(8, np.nan)), "observation must be finite"),
    (lambda: Policy(made_up_policy().network, {"range_noise": 0.01}, {}), "takes 8 numbers", "shows 9"),
    (lambda: Ensemble([made_up_policy(1)], 2), "different seeds, 2 among them"),
    (lambda: Ensemble([made_up_policy(1), made_up_policy(2, sizes=())], 1), "one kind of network"),
    (lambda: load_policy("linear-blnd"), "no policy 'linear-blnd': linear-blind?", "no such file either"),
    (lambda: load_policy("linear-ranged", 99), "seed must be one of [0, ", "got 99"),
]  # fmt: skip
ARCHIVES = [
    (("content", "network", "layers"), ["mean", "log_std", "hidden_0"], "hidden_0"),
    (("content", "network", "layers"), 3, "iterable"),
    (("content", "network", "activation"), "gelu", "activation must be one of"),
    (("content", "chosen"), 3, "different seeds, 3 among them"),
    (("content", "environment"), {"range_noise": -1.0}, "range_noise"),
    (("content", "observation", 1, "high"), 2.0, "made for other scales of observation or action"),
    (("content", "action", 1, "low"), 2.0, "made for other scales of observation or action"),
    (("arrays", "0/mean.weight"), np.zeros((3, 8), np.float32), "fit"),
    (("arrays", "0/mean.weight"), np.zeros((2, 9), np.float32), "shape of mean"),
    (("arrays", "0/mean.bias"), np.array([0.0, np.nan], np.float32), "finite"),
]  # fmt: skip


def archived(keys, value):
    """The archive of a policy with one part of it replaced."""
    content, arrays = Ensemble([made_up_policy(sizes=())], 0).packed()
    *outer, last = keys
    reduce(getitem, outer, {"content": content, "arrays": arrays})[last] = value
    file = io.BytesIO()
    archive.save(file, FORMAT, content, arrays)
    return file.getvalue()


def other(save):
    """What is saved to a file and is no archive of policies."""
    save(file := io.BytesIO())
    return file.getvalue()


OTHERS = [
    *(partial(bytes, data) for data in (b"", b"PK", b"text", b"\x80\x04", bytes(range(256)) * 20)),
    partial(other, lambda file: np.save(file, np.zeros(3))),
    partial(other, lambda file: zipfile.ZipFile(file, "w").writestr("header.npy", "not an array")),
    partial(other, lambda file: archive.save(file, "impact_gym policies 9", {}, {})),
]


def in_a_file(name, content, load):
    """Return what writes a file into a folder and loads it."""

    def call(folder):
        (folder / name).write_bytes(content())
        load(folder / name)

    return call


CASES = [
    *((in_a_file("bad.toml", text.encode, load_setup), said) for text, *said in SET_UPS),
    *((lambda _, call=call: call(), said) for call, *said in CALLS),
    *((in_a_file("policy.npz", partial(archived, *parts), load_policy), (said, "is no policy of this version"))
      for *parts, said in ARCHIVES),
    *((in_a_file("policy.npz", content, load_policy), ("is no impact_gym policies 3 file, or is damaged",))
      for content in OTHERS),
]  # fmt: skip


@pytest.mark.parametrize(("call", "said"), CASES)
def test_mistake_is_named_in_one_line(call, said, tmp_path):
    """By field, value and unit; and by the file that it is in."""
    with pytest.raises(ValueError, match=r"\A[^\n]+\Z") as raised:
        call(tmp_path)
    files = [str(path) for path in tmp_path.iterdir()]
    assert [part for part in (*said, *files) if part not in str(raised.value)] == []
