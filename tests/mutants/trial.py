"""One trial: tests run in a copy of the project with one edit. In the trial, pytest loads this module as a plugin."""

import json
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
from contextlib import suppress
from pathlib import Path
from time import monotonic

from tests.helpers.opened import compiled

ROOT = Path(__file__).parents[2]
LEFT_OUT = (".*", "runs", "reports", "site", "build", "*.egg-info", "mutants")
SURVIVED = "survived"
LIMIT = 1200.0  # s; an edit may make a loop endless
SECONDS = "MUTANTS_SECONDS"  # environment variable: path of a JSON file with the times of tests, in s


class SurvivedError(Exception):
    """No test failed. As an error, so that the next run tries the edit again."""


def trial(file, line, before, after, tests):
    """The first test that failed, and the durations in s. Without `file` there is no edit and no test may fail.

    Raises:
        SurvivedError: no test failed.
        ValueError: the edit does not compile, or a test fails without an edit.
    """
    start = monotonic()
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        copy = Path(folder, "project")
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*LEFT_OUT))
        if file:
            lines = (copy / file).read_text("utf-8").split("\n")
            if "\n".join(lines[line - 1 : line - 1 + before.count("\n") + 1]) != before:
                raise ValueError(f"{file}:{line} is no longer {before!r}")
            lines[line - 1 : line - 1 + before.count("\n") + 1] = after.split("\n")
            (copy / file).write_text("\n".join(lines), "utf-8")
            if not file.endswith(".py"):
                sources = runpy.run_path(str(copy / "impact_gym" / "sources.py"))
                sources["write"]()
                library = copy / "impact_gym" / f"kernels{sysconfig.get_config_var('EXT_SUFFIX')}"
                compiled(library.with_name("kernels.pyx"), library.parent, library, "-O1", sources["digest"]())
        environment = os.environ | {"PYTHONPATH": str(copy), "TMPDIR": folder}
        flags = ("-x", "-q", "--tb=line", "--durations=0", "--hypothesis-seed=0", "-p", "no:cacheprovider", "-m", "")
        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-p", "tests.mutants.trial", *flags, *tests], cwd=copy, env=environment,
            text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            output, _ = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            output = f"FAILED by taking longer than {LIMIT:g} s"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    passed = process.returncode == 0
    failed = re.findall(r"^(?:FAILED|ERROR) (.*)", output, re.M)
    if file and passed:
        raise SurvivedError(f"{SURVIVED} {', '.join(tests)}")
    if not (file or passed):
        raise ValueError(f"without any edit {', '.join(tests)} fail: {failed or output[-2000:]}")
    seconds = {test: float(took) for took, test in re.findall(r"^(\S+)s call +(.*)$", output, re.M)}
    return {"killer": (failed or [output.strip()[-200:]])[0], "seconds": monotonic() - start, "tests": seconds}


def pytest_collection_modifyitems(items):
    """Run the quickest tests first: they find most edits. Their times, in SECONDS, are those without an edit."""
    seconds = json.loads(Path(os.environ[SECONDS]).read_text()) if SECONDS in os.environ else {}
    items.sort(key=lambda item: seconds.get(item.nodeid, 0.0))
