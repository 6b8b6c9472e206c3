"""Files that are whole or not there, and what is said where a disk is full."""

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
SQLITE_NO_ROOM = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR)
"""Primary codes: SQLite takes a quota for an error of the disk."""


class DiskFullError(OSError):
    """There is no room for what was to be written."""


@contextmanager
def writing(what: str) -> Iterator[None]:
    """Say in one line that there is no room for `what`, a thing and its path, whichever library finds out.

    Raises:
        DiskFullError: the disk, or what one may have of it, is full.
    """
    try:
        yield
    except DiskFullError:  # which says already what was being written
        raise
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        raise DiskFullError(f"no room to write {what}: {error.strerror}") from error
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in SQLITE_NO_ROOM:
            raise
        raise DiskFullError(f"no room to write {what}: {error}") from error


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file beside `path` for writing and move it there once it is complete.

    Raises:
        DiskFullError: there is no room for it; what was at `path` is as it was.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    with writing(str(path)):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with unfinished.open("wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(unfinished, path)
        finally:
            unfinished.unlink(missing_ok=True)
