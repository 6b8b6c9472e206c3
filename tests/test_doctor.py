"""The doctor says what is so, whatever is missing, and what to do about what is wrong."""

import importlib.metadata
import math
import os
import platform
import re
import subprocess
import sys

import pytest

from impact_gym import doctor

HEALTHY = {"cores": 4, "usable": 4, "memory": 16.0, "load": 0.1, "debug": False}
EXTRAS = ("torch", "stable-baselines3", "pygame", "mujoco")
BARRED = (
    "import os, sys\n"
    "sys.modules.update(dict.fromkeys(['torch', 'stable_baselines3', 'pygame', 'mujoco', 'rich']))\n"
    "from impact_gym import doctor\n"
    "os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})\n"
    "doctor.main(['--quick'])"
)
ALL = "import sys\nfrom impact_gym import doctor\ndoctor.main([])\nassert 'torch' not in sys.modules"


def sections(program):
    """The lines of each section that a program prints, by its title; it ends well and warns of nothing."""
    command = [sys.executable, "-W", "error", "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    blocks = [block.splitlines() for block in ended.stdout.split("\n\n")]
    return {lines[0]: [re.split(r"\s{2,}", line.strip()) for line in lines[1:]] for lines in blocks if lines}


def test_doctor_prints_versions_machine_first_start_and_warnings_without_torch():
    printed = sections(ALL)
    versions = dict(printed["versions"])
    assert versions["python"] == platform.python_version()
    for name in ("numpy", "gymnasium", "torch", "stable-baselines3"):
        assert versions[name] == importlib.metadata.version(name)
    machine = dict(printed["machine"])
    assert machine["cores, usable by this process"].startswith(f"{os.cpu_count()},")
    assert machine["OMP_NUM_THREADS"] == os.environ.get("OMP_NUM_THREADS", "not set")
    assert [cells[0] for cells in printed["a fresh process"]] == ["import", "make to first step"]
    assert printed["warnings"]
    assert any("impact-gym bench" in title for title in printed)


def test_doctor_without_the_extras_and_on_one_core_says_what_is_missing():
    printed = sections(BARRED)
    usable = f"{os.cpu_count()}, {min(1, doctor.group_limit()):g}"
    assert dict(printed["machine"])["cores, usable by this process"] == usable
    assert {dict(printed["versions"])[name] for name in EXTRAS} == {"not installed"}
    said = str(printed["warnings"])
    assert "torch and stable-baselines3 missing, for training: pip install 'impact-gym[train]'" in said
    assert "a fresh process" not in printed


def test_main_refuses_an_unknown_argument():
    with pytest.raises(SystemExit) as ended:
        doctor.main(["--slow"])
    assert ended.value.code == 2


@pytest.mark.parametrize(("change", "message"), [
    ({}, None),
    ({"debug": True}, "debug build"),
    ({"memory": 1.5}, "1.5 GiB of memory"),
    ({"memory": math.nan}, None),
    ({"load": 3.0}, "load 3.0 on 4 cores"),
    ({"cores": 64, "usable": 2.5}, "threads=2 "),
    ({"cores": 64, "usable": 0.5}, "threads=1 "),
    ({"missing": ["torch"]}, "torch missing"),
], ids=str)  # fmt: skip
def test_warnings_name_what_is_wrong_and_only_that(change, message):
    sentences = doctor.warnings(**(HEALTHY | change))
    assert len(sentences) == (message is not None)
    assert message is None or message in sentences[0]


@pytest.mark.parametrize(
    ("text", "cores"), [("max 100000\n", math.inf), ("250000 100000\n", 2.5), ("nonsense", math.inf), (None, math.inf)]
)
def test_group_limit_is_read(tmp_path, text, cores):
    file = tmp_path / "cpu.max"
    if text is not None:
        file.write_text(text)
    assert doctor.group_limit(file) == cores


def test_free_memory_is_read_and_nan_where_the_system_does_not_say(tmp_path):
    file = tmp_path / "meminfo"
    file.write_text("MemTotal:       8388608 kB\nMemAvailable:   3145728 kB\nHugePages_Total:       0\n")
    assert doctor.free_memory(file) == 3.0
    file.write_text("MemTotal:       8388608 kB\n")
    assert math.isnan(doctor.free_memory(file))
    assert math.isnan(doctor.free_memory(tmp_path / "none"))


def test_first_start_ends_with_the_reason_where_an_environment_cannot_be_made():
    with pytest.raises(RuntimeError, match="cannot make an environment:\nno disk"):
        doctor.first_start("raise SystemExit('no disk')")
