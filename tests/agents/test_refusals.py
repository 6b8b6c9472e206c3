"""What is refused, with one line that names the mistake: set-up files, arguments, policy files."""

import io
import zipfile

import numpy as np
import pytest
from policies import made_up_policy
from training import tiny

import impact_gym as ig
from agents import archive, load_policy, load_setup
from agents.baselines import ConstantSpeed, Ranged, load_baseline
from agents.baselines.permitted import permitted
from agents.evaluate import ScenarioBatch
from agents.policies import Ensemble, Policy
from agents.policies.policy import FORMAT
from agents.setups import feasible
from agents.setups.training import SLOTS
from agents.train.__main__ import read_options
from agents.train_seeds import Seeds
from agents.tune import Tune
from impact_gym.task import Task

WRONG_SETTINGS = {  # of a training
    "steps": '"many"', "seeds": 0, "envs": SLOTS + 1, "batch": 1, "rollout": 1, "epochs": 0, "width": 1.5,
    "time_weight": [2.0, 1.0], "weight_power": 2.0, "gae_lambda": 1.5, "entropy": -1.0, "clip": 0.0, "log_std": 3.0,
    "learning_rate": 0.0, "final_rate": -0.1, "rtol": 0.5, "nominal": 1.5, "activation": '"sine"', "teacher": 3,
}  # fmt: skip
TIGHT = "{ type = 'Bistable', free_length = 0.07, height = 0.06995, front_stop = 1e-3, rear_stop = -1e-3 }"
SET_UPS = [
    *((f"[training]\n{name} = {value}", f"training: {name} must ") for name, value in WRONG_SETTINGS.items()),
    ("nonsense", "is not read as TOML: Expected"),
    ('titel = "x"', "unknown key titel; did you mean 'title'"),
    ("title = 3", "title must be a text in one line, got 3"),
    ("version = 2", "version must be 1, got 2.*another version"),
    ("environment = 3", "environment must be a table"),
    ("[environment]\ntool_mas = 1.0", "unknown key environment.tool_mas; did you mean 'tool_mass'"),
    ("[environment]\ntime_weight = 1.0", "unknown key environment.time_weight"),
    ("[environment]\ntool_mass = [0.2, 0.1]", "environment: tool_mass.*inverted.*0.2.*0.1 kg"),
    ("[environment.scenario]\nobject_mas = [1.0, 2.0]", "scenario has no field 'object_mas'.*object_mass"),
    ("[training]\nbacth = 3", "training.bacth; did you mean 'batch'"),
    ("[training]\nnominal = 0.5", r"nominal must be 0 without a table \[evaluation.nominal\], got 0.5"),
    ("[[training.mixed]]\nshare = 0.5\ntool_mas = 1.0", r"training.mixed\[0\].tool_mas; did you mean 'tool_mass'"),
    ("[[training.mixed]]\ntool_mass = 1.0", r"training.mixed\[0\]: share must be a number"),
    ("[[training.mixed]]\nshare = 0.5\npast_readings = 2", r"training.mixed\[0\]: .* same observations"),
    ("[[training.mixed]]\nshare = 0.7\n[[training.mixed]]\nshare = 0.4", "training: .* in all, must be .* at most 1"),
    ("[training]\nmixed = [3]", r"training.mixed\[0\] must be a dict"),
    ("[environment]\nuplink = { trace = 'none.csv' }", "environment.uplink: Channel.trace must be rows .*none.csv not"),
    ("[baselines]\nagainst = 'x'", "baselines.against must be a list of names"),
    ("[baselines]\nagainst = ['x', 'x']", "must not name one twice"),
    ("[baselines]\nbudget = 0", "baselines.budget.*at least 1"),
    ("[baselines.tuned]\na = 'Rule'", "baselines.tuned.a must be a rule, one of BlindProfile.*'Rule'"),
    ("[baselines.tuned]\na = {rule = 'Ranged', rtoll = 1.0}", "baselines.tuned.a.rtoll; did you mean 'rtol'"),
    ("[baselines.tuned]\na = {rule = 'Ranged', rtol = 1.0}", "baselines.tuned.a.rtol.*at most"),
    ("[baselines.tuned]\na = {rule = 'BlindProfile', jitter = 2}", "baselines.tuned.a.jitter.*at most 1"),
    ("[baselines.tuned]\na = {rule = 'BlindProfile', clean_alarm = 1}", "a.clean_alarm must be True or False"),
    ("[baselines.tuned]\na = {rule = 'BlindProfile', scenarios = 0}", "baselines.tuned.a.scenarios must be"),
    ("[baselines.tuned]\na = 'DetectorProfile'", "looks at what environment.deflection_sensor adds"),
    ("[baselines.tuned]\na = 'Ranged'", "baselines.tuned.a: Ranged looks at what environment.range_noise"),
    ("[evaluation]\nweigths = [1.0]", r"unknown key evaluation.weigths; did you mean 'weights'\?"),
    ("[evaluation]\nweights = []", "evaluation.weights must hold weights"),
    ("[evaluation]\nweights = [1.0, 1.0]", "none twice"),
    ("[evaluation]\nweights = 'all'", "evaluation.weights must be a sequence of numbers"),
    ("[evaluation]\ntypical = 0", "evaluation.typical must be .*above 0"),
    ("[evaluation]\nset = 'tset'", "no evaluation set 'tset'"),
    ("[evaluation]\nset = 3", "evaluation.set must be a name"),
    ("[evaluation]\nscenarios = 1", "evaluation.scenarios must be a whole number of at least 2"),
    ("[evaluation]\nscenarios = 5000", "evaluation.scenarios must be at most the 2000 of the set"),
    ("[evaluation.nominal]\ntool_mas = 1.0", "unknown key evaluation.nominal.tool_mas; did you mean 'tool_mass'"),
    ("[evaluation]\nnominal = 3", r"evaluation.nominal must be a table, \[evaluation.nominal\]"),
    ("[evaluation.varied]\ntool_mas = [1.0]", "unknown key evaluation.varied.tool_mas; did you mean 'tool_mass'"),
    ("[evaluation.varied]\ntool_mass = 1.0", "evaluation.varied.tool_mass must be a list of values, or a table"),
    ("[evaluation.varied]\ntool_mass = [-1.0]", "evaluation.varied.tool_mass: tool_mass must be .*at least 1e-12"),
    ("[evaluation.varied]\ntool_mass = { time = [1.0] }", "varied.tool_mass.time; did you mean 'times'"),
    ("[evaluation.varied]\ntool_mass = { times = [0.0] }", "evaluation.varied.tool_mass: times must be .*above 0"),
    ("[evaluation.varied]\nrobot = [{ type = 'Robot', mass = 1.0 }]", "varied.robot: robot, a Robot, needs"),
    (f"[environment]\ncoupling = {TIGHT}\n[evaluation.varied]\n'coupling.front_stop' = {{ times = [4.0] }}",
     "evaluation.varied.coupling.front_stop: "),
    ('[baselines]\nagainst = ["bad-profil"]', "baselines.against.bad-profil; did you mean 'bad-profile'"),
    ('[baselines]\nbound = "nonsense"', "unknown key baselines.bound.nonsense"),
    ("[evaluation]\nweights = [1.0, 20.0]", "evaluation: weights .* at most 8 m/s per s, got 20"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), SET_UPS)
def test_load_setup_names_the_mistake_in_a_file_in_one_line(text, message, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as raised:
        load_setup(path)
    assert "\n" not in str(raised.value)
    assert f"{path}" in str(raised.value)


RIGID, LINEAR, BISTABLE = (load_setup(name).environment for name in ("rigid-blind", "linear-blind", "bistable-blind"))
SWINGING_STOP = ig.Bistable(1400.0, front_stop=0.001, stop_damping_ratio=0.3)
LOOSE = {"coupling": ig.Bistable(5.0), "acceleration_range": (2.0, 20.0)}
SLOW = {"acceleration_range": (1.0, 2.0), "velocity_range": (-0.1, 0.1)}
POLICY = made_up_policy(1)
CALLS = [
    (
        lambda: Task(scenario={"distance": (1.8, 2.0)}),
        r"distance must begin below 1\.74 m, got 1\.8 m: in 1\.2 s \(horizon",
    ),
    (lambda: Task(**SLOW), r"distance must begin below 0\.117 m, got 0\.15 m"),
    (lambda: feasible.warnings(Task(**LOOSE)), r"hold the tool at 2 m/s\^2.*0\.838"),
    (lambda: tiny(seed=-1), "seed.*at least 0"),
    (lambda: tiny(teacher="nobody").made_for(), "no baseline 'nobody'"),
    (lambda: tiny(teacher="ranged").made_for(), "Ranged looks at distance_estimate"),
    (lambda: read_options(["--resume", "there", "--steps", "5"]), "give nothing else"),
    (lambda: read_options(["cubic"]), r"no set-up 'cubic'.*bistable-blind.*linear-ranged"),
    (lambda: Seeds(processes=-1), "processes.*at least 0"),
    (lambda: Tune(names=("paper-trapezoid",)), "no baseline 'paper-trapezoid' to tune"),
    (lambda: Tune(weights=(0.0,)), "weights must be .*above 0"),
    (lambda: Tune(scenarios=0), "scenarios must be .*at least 1"),
    (lambda: Tune(population=3), "population must be .*at least 4, got 3"),
    (lambda: Tune(budget=0), "budget must be .*at least 1, got 0"),
    (lambda: ConstantSpeed(0.0), "speed.*above 0.*m/s"),
    (lambda: ConstantSpeed([1.0, 1.6]), "speed.*at most 1.5"),
    (lambda: Ranged([1.0, 0.3, 10.0]), "Ranged has the parameters .*'top speed', 'contact speed'"),
    (lambda: load_baseline("ranged").for_environment({}), "Ranged looks at distance_estimate, which"),
    (lambda: load_baseline("blind"), r"no baseline 'blind'.*blind-profile.*paper-trapezoid"),
    (lambda: load_baseline("ranged", 0.0), "time_weight must be .*above 0"),
    (lambda: ScenarioBatch.of("validation", 1001), "1000 scenarios"),
    (lambda: permitted(Task(**RIGID), 0.0), "limit must be finite and above 0 N"),
    (lambda: permitted(Task(**BISTABLE), 4.0), r"limit must be finite and above 5\.\d+ N"),
    (lambda: permitted(Task(**BISTABLE), 5.11), "limit must permit more than the .* m/s .* got 5.11 N"),
    (lambda: permitted(Task(coupling=ig.SpringDamper(50.0, 0.5)), 50.0), "damping_ratio must be at least 1 .* got 0.5"),
    (lambda: permitted(Task(**LINEAR | {"reaction_delay": 0.06}), 50.0), "reaction_delay must be below 0.0500. s"),
    (lambda: permitted(Task(tool_mass=(0.1, 0.2)), 50.0), "a known tool .* got tool_mass drawn"),
    (lambda: permitted(Task(robot=ig.Robot(5.0, 1e5, 50.0)), 50.0), "a rigid robot .* got Robot"),
    (lambda: permitted(Task(**BISTABLE | {"tool_mass": 0.8}), 50.0), "coupling must hold a tool of 0.8 kg against"),
    (lambda: permitted(Task(coupling=SWINGING_STOP), 50.0), "stop_damping_ratio must be at least 1"),
    (lambda: POLICY.predict(np.zeros(7, np.float32)), "8 numbers.*7"),
    (lambda: POLICY.predict(np.full(8, np.nan)), "finite"),
    (lambda: Policy(POLICY.network, {"range_noise": 0.01}, {}), "network takes 8 numbers, the environment shows 9"),
    (lambda: Ensemble([POLICY], 2), "different seeds, 2 among them"),
    (lambda: Ensemble([POLICY, made_up_policy(2, sizes=())], 1), "one kind of network"),
    (lambda: load_policy("linear-blnd"), r"'linear-blnd'.*linear-blind"),
    (lambda: load_policy("linear-ranged", 99), r"seed must be one of \[0, .*got 99"),
]


@pytest.mark.parametrize(("call", "message"), CALLS, ids=[message for _, message in CALLS])
def test_functions_name_the_mistake_in_an_argument_in_one_line(call, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message) as raised:
        call()
    assert "\n" not in str(raised.value)


def other_kinds():
    """Files that are no archives of policies."""
    stream, zipped, other = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.save(stream, np.zeros(3))
    with zipfile.ZipFile(zipped, "w") as file:
        file.writestr("header.npy", "not an array")
    archive.save(other, "impact_gym policies 9", {}, {})
    files = [b"", b"PK", b"text", b"\x80\x04", bytes(range(256)) * 20]
    return [*files, *(file.getvalue() for file in (stream, zipped, other))]


@pytest.mark.parametrize("content", other_kinds(), ids=range(8))
def test_load_policy_refuses_files_of_other_kinds(content, tmp_path):
    (tmp_path / "policy.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"policy\.npz is no impact_gym policies 3 file, or is damaged"):
        load_policy(tmp_path / "policy.npz")


@pytest.mark.parametrize(("keys", "value", "message"), [
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
])  # fmt: skip
def test_load_policy_refuses_an_archive_that_holds_no_policy(keys, value, message, tmp_path):
    content, arrays = Ensemble([made_up_policy(sizes=())], 0).packed()
    part = {"content": content, "arrays": arrays}
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    archive.write_archive(tmp_path / "policy.npz", FORMAT, content, arrays)
    with pytest.raises(ValueError, match=rf"policy\.npz is no policy of this version: .*{message}"):
        load_policy(tmp_path / "policy.npz")
