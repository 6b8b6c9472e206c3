"""What something was made with: sources, versions, machine, date."""

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any


def circumstances(*packages: str) -> dict[str, Any]:
    """Return what a result depends on beside the code: machine, versions, date."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()}",
        "versions": {"python": platform.python_version()} | {name: version(name) for name in packages},
    }


def revision() -> dict[str, str | None]:
    """Return the commit and what has changed since, as git says; None where there is no git or it does not know us.

    An installation often lies within somebody else's repository, whose commit says nothing about these sources.
    """
    if _git("ls-files", "--error-unmatch", __file__) is None:
        return {"commit": None, "changed since": None}
    return {"commit": _git("rev-parse", "HEAD"), "changed since": _git("status", "--porcelain", "--untracked-files=no")}


def _git(*command: str) -> str | None:
    try:
        done = subprocess.run(["git", *command], cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()
