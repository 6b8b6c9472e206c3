"""Origin of a result: sources, versions, machine and date."""

import importlib.util
import os
import platform
import re
import subprocess
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from impact_gym.support.archive import checksum

SOURCES = {".py", ".pyx", ".pxi", ".h", ".csv", ".json", ".toml", ".npz", ".jinja", ".css", ".js", ".typed"}
"""Suffixes of the files that can change the results of a package."""


def machine_and_versions(*packages: str) -> dict[str, Any]:
    """Return machine, date and versions of Python and of `packages`."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
        "versions": {"python": platform.python_version()} | {name: version(name) for name in packages},
    }


def revision() -> dict[str, str | None]:
    """Return git's commit and uncommitted changes; both are None if git is missing or does not track this file."""
    if _git("ls-files", "--error-unmatch", __file__) is None:
        return {"commit": None, "changed since": None}
    return {"commit": _git("rev-parse", "HEAD"), "changed since": _git("status", "--porcelain", "--untracked-files=no")}


def modern_command(command: str) -> str:
    """Return a command recorded by this or an earlier version, in the form of this version."""
    return re.sub(r"^python -m agents\.(\w+)", r"impact-gym \1", command).replace(" --algo ppo", "")


def digest_of(*modules: str) -> str:
    """Return the SHA-256 of the sources and data files of modules and packages; ValueError: there is no such module."""
    parts = list[Any]()
    for name in sorted(modules):
        root = origin_of(name)
        files = [path for path in root.rglob("*") if path.suffix in SOURCES and not path.name.startswith(".")]
        for path in sorted(files) if root.is_dir() else [root]:
            parts += [f"{name} {path.relative_to(root.parent)}\0", checksum(path.read_bytes())]
    return checksum(*parts)


def origin_of(name: str) -> Path:
    """Return the folder of a package or the file of a module; ValueError: there is no such module."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    origin = spec and next(iter(spec.submodule_search_locations or ()), spec.origin)
    if not origin:
        raise ValueError(f"there is no module {name!r}")
    return Path(origin).resolve()


def _git(*command: str) -> str | None:
    try:
        done = subprocess.run(["git", *command], cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
