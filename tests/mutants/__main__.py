"""`make mutants`: does a test fail if a line of the code is wrong?

Every mutant is one small edit (`edits.py`) in a copy of the project. The tests that should kill it (`mutants.toml`) run
in that copy. Killed mutants are stored in `--out` and not tried again until their file changes; survivors are tried in
each run. A survivor needs a reason in `mutants.toml`: `equivalent` if no test could fail, otherwise `accepted`.
"""

import argparse
import hashlib
import json
import os
import tomllib
from collections import Counter
from pathlib import Path

from agents.jobs import JobsFailedError, cached
from impact_gym.files import whole_file
from tests.mutants.edits import Edit, code, mutants
from tests.mutants.trial import ROOT, SECONDS, SURVIVED, trial

TABLE = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text("utf-8"))
TESTS = {file: tuple(place["tests"]) for place in TABLE["place"] for file in place["files"]}
REASONS = {(entry["file"], entry["before"], entry["after"]): entry for entry in TABLE["survivor"]}


def main():
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/mutants"), help="folder for results")
    parser.add_argument("--only", default="", help="start of the paths of the files to edit")
    parser.add_argument("--processes", type=int, default=None, help="trials at the same time; default: one per core")
    options = parser.parse_args()
    edits = [*(named(**entry) for entry in TABLE["named"]), *mutants(list(TESTS), TABLE["left_out"])]
    edits = [edit for edit in edits if edit.file.startswith(options.only)]
    reasons = failed_trials(edits, folder=options.out, processes=options.processes)
    lines, count = [], Counter()
    for edit in edits:
        kind, why = verdict(edit, reasons.get(edit, ""))
        count[kind] += 1
        if kind != "killed":
            lines += [f"{kind}: {edit.file}:{edit.line}", f"- {edit.before}", f"+ {edit.after}", why, ""]
    valid = len(edits) - count["no mutant"] - count["equivalent"]
    lines.append(", ".join(f"{number} {kind}" for kind, number in sorted(count.items())))
    lines.append(f"{count['killed'] / max(valid, 1):.1%} of {valid} killed, not counting equivalent ones")
    with whole_file(options.out / "mutants.txt") as file:
        file.write("\n".join([*lines, ""]).encode())
    print(*lines, sep="\n")


def named(file, before, after):
    """The edit of a text that occurs once in a file."""
    source = (ROOT / file).read_text("utf-8")
    if source.count(before) != 1:
        raise SystemExit(f"mutants.toml: {before!r} must occur once in {file}, got {source.count(before)} times")
    line = source[: source.index(before)].count("\n")
    whole = source.split("\n")[line : line + before.count("\n") + 1]
    return Edit(file, line + 1, "\n".join(whole), "\n".join(whole).replace(before, after))


def failed_trials(edits, folder, processes):
    """The reason of each edit that was not killed. All tests must pass without an edit first."""
    packages = ("agents", "experiments", "impact_gym", "tests")
    sources = sorted(file for name in packages for file in Path(name).rglob("*.p*"))
    options, reasons = {"folder": folder, "processes": processes}, {}
    files = dict.fromkeys(edit.file for edit in edits)
    by_file = {file: [edit for edit in edits if edit.file == file] for file in files}
    tests = {file: list(TESTS[max(filter(file.startswith, TESTS), key=len)]) for file in by_file}
    unedited = [vars(Edit()) | {"tests": each} for each in map(list, dict.fromkeys(map(tuple, tests.values())))]
    for order in ("as listed", "quickest first"):  # the second time in the order of the trials with an edit
        tried = cached(trial, unedited, depends=f"{digest(sources)} {order}", title=f"unedited, {order}", **options)
        if SECONDS not in os.environ:
            os.environ[SECONDS] = str(folder.absolute() / "seconds.json")
            seconds = {test: took for each in tried for test, took in each["tests"].items()}
            Path(os.environ[SECONDS]).write_text(json.dumps(seconds))
    for file, of_file in by_file.items():
        calls = {json.dumps(vars(edit) | {"tests": tests[file]}, sort_keys=True): edit for edit in of_file}
        try:
            cached(trial, [*map(json.loads, calls)], depends=digest([ROOT / file]), title=file, **options)
        except JobsFailedError as error:
            reasons |= {calls[call.arguments]: failure.reason for call, failure in error.failed.items()}
    return reasons


def digest(files):
    return hashlib.sha256(b"".join(file.read_bytes() for file in files if file.is_file())).hexdigest()


def verdict(edit, reason):
    """The kind of an edit after its trial, and the reason."""
    if not reason:
        return "killed", ""
    if SURVIVED not in reason:
        return "no mutant", reason
    entry = REASONS.get((edit.file, code(edit.before), code(edit.after)), {"kind": "unexplained", "why": reason})
    return entry["kind"], entry["why"]


if __name__ == "__main__":
    main()
