"""Where results go: whole folders, and the record of what produced them."""

import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from agents.provenance import circumstances
from impact_gym.files import write_file, writing

REPORTS = Path("reports")
KEPT = "kept"
"""Subfolder of a study with the results of its cells."""

MARK = ".impact_gym"
"""File that marks a folder as ours, to be replaced."""


def replaceable(path: Path) -> None:
    """Check that `path` is missing, an empty folder, or a folder that an earlier run wrote.

    Raises:
        ValueError: it is anything else.
    """
    if path.exists() and not (path.is_dir() and (not any(path.iterdir()) or (path / MARK).is_file())):
        raise ValueError(f"{path} is not replaced: no earlier run wrote it; name another folder or remove it")


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder; when the block ends without an error it takes the place of `path`.

    Raises:
        ValueError: `path` is there and is neither an empty folder nor one that an earlier run wrote.
    """
    replaceable(path)
    path = path.resolve()  # a link to the folder stays
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    old = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent)) / path.name
    try:
        with writing(str(path)):
            yield unfinished
        (unfinished / MARK).touch()
        unfinished.chmod(0o755)
        if path.exists():
            os.replace(path, old)
        os.replace(unfinished, path)
    except BaseException:
        if old.exists() and not path.exists():
            os.replace(old, path)
        raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
        shutil.rmtree(old.parent, ignore_errors=True)


def checksum(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextmanager
def noted(folder: Path, command: str, packages: Iterable[str]) -> Iterator[list[dict[str, Any]]]:
    """Note a run of a study in `folder`/results.json; give the notes of all runs, its own complete at the end.

    A note has the command, the circumstances, the load before and how many seconds it took, None if it was stopped.
    The notes begin anew where no results are kept.
    """
    log = folder / "results.json"
    runs: list[dict[str, Any]] = (
        json.loads(log.read_text())["runs"] if (folder / KEPT).is_dir() and log.is_file() else []
    )
    begun = time.perf_counter()
    note: dict[str, Any] = {"command": command, "seconds": None, "load_before": os.getloadavg()[0]}
    runs.append(note | circumstances("impact-gym", "numpy", "scipy", *packages))
    try:
        yield runs
        runs[-1]["seconds"] = time.perf_counter() - begun
    finally:
        write_file(log, json.dumps({"runs": runs}, indent=2) + "\n")
