"""`make mutants`: Cosmic Ray edits PART of the code, one place at a time; edits that TESTS do not notice are listed.

Its settings are in mutants.toml, with the edits that no test has to notice and the reasons. The edits are a random
sample, tried in a copy of the checkout in runs/mutants. After an interruption, the same command goes on.
"""

import argparse
import os
import random
import re
import shutil
import sys
import tomllib
from pathlib import Path

from cosmic_ray.commands import execute, init
from cosmic_ray.config import load_config
from cosmic_ray.modules import find_modules
from cosmic_ray.testing import run_tests
from cosmic_ray.work_db import use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

LEFT_OUT = shutil.ignore_patterns(".*", "runs", "reports", "site", "build", "*.egg-info", "__pycache__")
SETTINGS = Path(__file__).with_suffix(".toml")
TABLE = tomllib.loads(SETTINGS.read_text("utf-8"))


def fill(session, part, seed):
    """Fill a session with a sample of 100 of all edits of the modules in `part`; the other edits are skipped."""
    init(find_modules([Path(part)]), session, {})
    edits = {item.job_id: item.mutations[0] for item in session.work_items}
    useful = [job for job, edit in edits.items() if re.fullmatch("|".join(TABLE["operators"]), edit.operator_name)]
    useful.sort(key=lambda job: (str(edits[job].module_path), edits[job].operator_name, edits[job].occurrence))
    chosen = {*random.Random(seed).sample(useful, min(100, len(useful)))}
    session.set_multiple_results([job for job in edits if job not in chosen], WorkResult(WorkerOutcome.SKIPPED))


def unnoticed(session):
    """Return the edits after which all tests passed, except accepted ones: file, lines before, lines after."""
    found = []
    for item, result in session.completed_work_items:
        if result.test_outcome == TestOutcome.SURVIVED:
            lines = [line for line in result.diff.splitlines() if not line.startswith(("---", "+++"))]
            texts = (" ".join(line[1:].strip() for line in lines if line.startswith(sign)) for sign in "-+")
            edit = [str(item.mutations[0].module_path), *texts]
            found += [edit] if edit not in [accepted[:3] for accepted in TABLE["accepted"]] else []
    return found


def main():
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("--part", default="impact_gym/identification", help="folder or module")
    parser.add_argument("--tests", default="tests/identify", help="tests that should notice each edit")
    parser.add_argument("--seed", type=int, default=0, help="seed of the sample")
    options = parser.parse_args()
    folder = Path("runs", "mutants", f"{options.part.replace('/', '-')}-{options.seed}").absolute()
    copy = folder / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(".", copy, ignore=LEFT_OUT)
    os.chdir(copy)
    os.environ["PYTHONPATH"] = str(copy)
    config = load_config(SETTINGS)
    config["test-command"] = f"{sys.executable} {config['test-command']} {options.tests}"
    outcome, output = run_tests(config.test_command, config.timeout)
    if outcome != TestOutcome.SURVIVED:
        raise SystemExit(f"without an edit, {options.tests} must pass:\n{output[-2000:]}")
    with use_db(folder / "session.sqlite") as session:
        if not session.num_work_items:
            fill(session, options.part, options.seed)
        execute(session, config)
        found = unnoticed(session)
        tried = sum(result.worker_outcome != WorkerOutcome.SKIPPED for _, result in session.results)
    for file, before, after in found:
        print(f"{file}\n- {before}\n+ {after}\n")
    raise SystemExit(f"{len(found)} of {tried} edits were not noticed" if found else 0)


if __name__ == "__main__":
    main()
