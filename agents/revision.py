"""Which sources something was made with."""

import subprocess
from pathlib import Path


def revision() -> dict[str, str | None]:
    """Return the commit and what has changed since, as git says; None where there is no git or no repository."""
    return {
        "commit": _git("rev-parse", "HEAD"),
        "changed since": _git("status", "--porcelain", "--untracked-files=no"),
    }


def _git(*command: str) -> str | None:
    try:
        said = subprocess.run(["git", *command], cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return said.stdout.strip()
