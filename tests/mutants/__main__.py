"""`make mutants`: does a test notice when a line of the code is wrong?

Every mutant is one small edit (`edits.py`), tried in a copy of the project with the tests that should notice
(`mutants.toml`). What was killed is kept in `--out` and not tried again while its file stays as it is; survivors are
tried anew each time. Each needs its reason in `mutants.toml`: `equivalent` where no test could notice, else `accepted`.
"""

import argparse
import hashlib
import json
import tomllib
from collections import Counter
from pathlib import Path

from agents.jobs import JobsFailedError, cached
from impact_gym.files import whole_file
from tests.mutants.edits import Edit, mutants
from tests.mutants.trial import ROOT, SURVIVED, trial

TABLE = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text("utf-8"))
TESTS = {file: tuple(place["tests"]) for place in TABLE["place"] for file in place["files"]}
REASONS = {(entry["file"], entry["before"], entry["after"]): entry for entry in TABLE["survivor"]}


def main():
    parser = argparse.ArgumentParser(prog="make mutants", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/mutants"), help="folder of what was tried")
    parser.add_argument("--only", default="", help="files whose names begin so")
    parser.add_argument("--processes", type=int, default=None, help="trials at the same time; default: one a core")
    options = parser.parse_args()
    edits = [*(named(**entry) for entry in TABLE["named"]), *mutants(list(TESTS), TABLE["left_out"])]
    edits = [edit for edit in edits if edit.file.startswith(options.only)]
    lost = tried(edits, folder=options.out, processes=options.processes)
    lines, count = [], Counter()
    for edit in edits:
        kind, why = judged(edit, lost.get(edit, ""))
        count[kind] += 1
        if kind != "killed":
            lines += [f"{kind}: {edit.file}:{edit.line}", f"- {edit.before}", f"+ {edit.after}", why, ""]
    asked = len(edits) - count["no mutant"] - count["equivalent"]
    lines.append(", ".join(f"{number} {kind}" for kind, number in sorted(count.items())))
    lines.append(f"{count['killed'] / max(asked, 1):.1%} of {asked} killed, not counting equivalent ones")
    with whole_file(options.out / "mutants.txt") as file:
        file.write("\n".join([*lines, ""]).encode())
    print(*lines, sep="\n")


def named(file, before, after):
    """The edit of some words that stand once in a file."""
    source = (ROOT / file).read_text("utf-8")
    if source.count(before) != 1:
        raise SystemExit(f"mutants.toml: {before!r} must stand once in {file}, stands {source.count(before)} times")
    line = source[: source.index(before)].count("\n")
    whole = source.split("\n")[line : line + before.count("\n") + 1]
    return Edit(file, line + 1, "\n".join(whole), "\n".join(whole).replace(before, after))


def tests_of(edit):
    """The tests that should notice: those of the longest name that the edit's file begins with."""
    return TESTS[max((name for name in TESTS if edit.file.startswith(name)), key=len)]


def tried(edits, folder, processes):
    """Why edits were not killed. Before, all tests must pass without any."""
    packages = ("agents", "experiments", "impact_gym", "tests")
    sources = sorted(file for name in packages for file in Path(name).rglob("*.p*"))
    options = {"folder": folder, "processes": processes}
    for tests in {tests_of(edit) for edit in edits}:
        cached(trial, [vars(Edit()) | {"tests": list(tests)}], depends=digest(sources), title="unedited", **options)
    reasons = {}
    by_file = {}
    for edit in edits:
        by_file.setdefault(edit.file, []).append(edit)
    for file, of_file in by_file.items():
        asked = [vars(edit) | {"tests": list(tests_of(edit))} for edit in of_file]
        try:
            cached(trial, asked, depends=digest([ROOT / file]), title=file, **options)
        except JobsFailedError as error:
            lost = {call.arguments: failure.reason for call, failure in error.failed.items()}
            reasons |= {
                edit: lost[arguments]
                for edit, each in zip(of_file, asked, strict=True)
                if (arguments := json.dumps(each, sort_keys=True)) in lost
            }
    return reasons


def digest(files):
    """What a trial depends on: the content of these files."""
    return hashlib.sha256(b"".join(file.read_bytes() for file in files if file.is_file())).hexdigest()


def judged(edit, reason):
    """What became of an edit, and why."""
    if not reason:
        return "killed", ""
    if SURVIVED not in reason:
        return "no mutant", reason
    entry = REASONS.get((edit.file, edit.before.strip(), edit.after.strip()), {"kind": "unexplained", "why": reason})
    return entry["kind"], entry["why"]


if __name__ == "__main__":
    main()
