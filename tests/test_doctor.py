"""The doctor says what is so, whatever is missing, and its advice follows from what it is given."""

import importlib
import importlib.metadata
import math
import os
import platform
import re
import subprocess
import sys

import pytest

from impact_gym import doctor
from impact_gym.doctor import Rate

HEALTHY = {"cores": 4, "usable": 4, "memory": 16.0, "load": 0.1, "debug": False}
EXTRAS = ("torch", "stable-baselines3", "pygame", "mujoco")
BARRED = (
    "import runpy, sys\n"
    "sys.modules.update(dict.fromkeys(['torch', 'stable_baselines3', 'pygame', 'mujoco', 'rich']))\n"
    "sys.argv = ['doctor', '--quick']\n"
    "runpy.run_module('impact_gym.doctor', run_name='__main__')"
)
BRIEF = (  # on busy cores torch with several threads may need a tenth of a second for each step of a rollout
    "from impact_gym import doctor\ndoctor.ROLLOUT = 4\ndoctor.main(['--quick'])"
)


def run(*arguments, **variables):
    """What a run of the doctor says on stdout and stderr; it ends well."""
    command = [sys.executable, "-W", "error", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | variables)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def sections(text):
    """Lines by title."""
    blocks = [block.splitlines() for block in text.split("\n\n")]
    return {lines[0]: [line.strip() for line in lines[1:]] for lines in blocks if lines}


def cells(line):
    return re.split(r"\s{2,}", line)


def rates_in(text):
    """Steps per second by name and number of environments."""
    (lines,) = (lines for title, lines in sections(text).items() if title.startswith("environments"))
    rows = [cells(line) for line in lines]
    return {(name, int(envs.replace(",", ""))): float(steps.replace(",", "")) for name, envs, steps in rows}


def test_it_reports_versions_machine_rates_and_advice_on_stdout_and_progress_on_stderr():
    said, progress = run("-c", BRIEF)
    found = sections(said)
    versions = dict(map(cells, found["versions"]))
    assert versions["python"] == platform.python_version()
    for name in ("numpy", "gymnasium", "torch", "stable-baselines3"):
        assert versions[name] == importlib.metadata.version(name)
    machine = dict(map(cells, found["machine"]))
    assert machine["cores, usable by this process"].startswith(f"{os.cpu_count()},")
    assert machine["OMP_NUM_THREADS"] == os.environ.get("OMP_NUM_THREADS", "not set")
    assert [cells(line)[0] for line in found["a fresh process"]] == ["import", "make to first step"]
    rates = rates_in(said)
    for name in ("gym.make('ImpactApproach-v0')", "gym.make('Pendulum-v1')"):
        assert (name, 1) in rates
    assert {envs for name, envs in rates if name == "gym.make_vec('ImpactApproach-v0')"} == set(doctor.QUICK_SIZES)
    assert {name.split(",")[0] for name, _ in rates} >= {"ImpactVecEnv", "PPO on ImpactVecEnv"}
    assert ("gym.make_vec('CartPole-v1')", 1024) in rates
    assert min(rates.values()) > 0
    assert "environments are enough" in found["advice"][0]
    assert "..." in progress
    assert "..." not in said


def test_without_the_extras_it_says_what_is_missing_and_measures_the_rest():
    said, _ = run("-c", BARRED)
    found = sections(said)
    versions = dict(map(cells, found["versions"]))
    assert {versions[name] for name in EXTRAS} == {"not installed"}
    names = {name for name, _ in rates_in(said)}
    assert {"gym.make('ImpactApproach-v0')", "gym.make_vec('ImpactApproach-v0')"} <= names
    assert not any("PPO" in name or "ImpactVecEnv" in name for name in names)
    assert "torch and stable-baselines3 missing" in found["advice"][-1]
    assert "impact-gym[train]" in found["advice"][-1]


def test_an_unknown_argument_is_refused():
    with pytest.raises(SystemExit) as raised:
        doctor.main(["--slow"])
    assert raised.value.code == 2


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, None),
        ({"debug": True}, "debug build"),
        ({"memory": 1.5}, "1.5 GiB of memory"),
        ({"memory": math.nan}, None),
        ({"load": 3.0}, "load 3.0 on 4 cores"),
        ({"cores": 64, "usable": 2.5}, "threads=2 "),
        ({"cores": 64, "usable": 0.5}, "threads=1 "),
    ],
    ids=str,
)
def test_a_warning_names_what_is_wrong_and_only_that(change, said):
    found = doctor.warnings(**(HEALTHY | change))
    assert len(found) == (said is not None)
    assert said is None or said in found[0]


@pytest.mark.parametrize(
    ("text", "cores"), [("max 100000\n", math.inf), ("250000 100000\n", 2.5), ("nonsense", math.inf), (None, math.inf)]
)
def test_the_limit_of_a_control_group_is_read(tmp_path, text, cores):
    file = tmp_path / "cpu.max"
    if text is not None:
        file.write_text(text)
    assert doctor.group_limit(file) == cores


def test_the_memory_available_is_read_and_nan_where_it_is_not_said(tmp_path):
    file = tmp_path / "meminfo"
    file.write_text("MemTotal:       8388608 kB\nMemAvailable:   3145728 kB\nHugePages_Total:       0\n")
    assert doctor.free_memory(file) == 3.0
    file.write_text("MemTotal:       8388608 kB\n")
    assert math.isnan(doctor.free_memory(file))
    assert math.isnan(doctor.free_memory(tmp_path / "none"))


@pytest.mark.parametrize(
    ("steps", "smallest"),
    [([100, 100, 100], 64), ([10, 89, 100], 16384), ([10, 91, 100], 1024), ([95, 100, 20], 64), ([80, 100, 20], 1024)],
)
def test_the_smallest_batch_within_a_tenth_of_the_best_is_advised(steps, smallest):
    batches = [Rate("", envs, rate) for envs, rate in zip((64, 1024, 16384), steps, strict=True)]
    (told,) = doctor.advice(batches, None, {})
    assert told.startswith(f"{smallest:,} environments")
    assert f"{32 * smallest:,} samples" in told


def test_the_faster_number_of_torch_threads_and_the_share_of_stepping_are_advised():
    stable = Rate("", 512, 1000.0)
    for rates, best, share in (((200.0, 100.0), 1, "20%"), ((200.0, 400.0), 8, "40%")):
        learners = {threads: Rate("", 512, rate) for threads, rate in zip((1, 8), rates, strict=True)}
        _, threads, stepping = doctor.advice([stable], stable, learners)
        assert f"set_num_threads({best})" in threads
        assert f"{share} goes into stepping 512" in stepping
    _, stepping = doctor.advice([stable], stable, {1: stable})  # nothing to compare on one core
    assert "100% goes into stepping" in stepping


def test_a_rate_counts_every_step_of_the_calls_made():
    class Clock:
        now = 0.0

        def perf_counter(self):
            return self.now

    clock = Clock()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(doctor, "time", clock)
        for rounds in (1, 3):
            assert doctor.rate(lambda: setattr(clock, "now", clock.now + 0.25), 5, 3.0, rounds) == 20.0
            assert doctor.rate(lambda: setattr(clock, "now", clock.now + 8.0), 4, 3.0, rounds) == 0.5


def test_an_environment_that_cannot_be_made_ends_it_with_the_reason(monkeypatch):
    monkeypatch.setattr(doctor, "FRESH", "raise SystemExit('no disk')")
    with pytest.raises(SystemExit, match=f"cannot make {doctor.ID}:\nno disk"):
        doctor.main(["--quick"])
