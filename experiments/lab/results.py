"""Where results go: whole folders, and the record of what produced them."""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

REPORTS = Path("reports")


MARK = ".impact_gym"
"""A file that says a folder was written here and may be replaced."""


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
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    old = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent)) / path.name
    try:
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
