"""Read users' files, write files atomically, and lock folders."""

import csv
import errno
import fcntl
import io
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TypeVar

from impact_gym.support.validation import nearest, one_of, shown

Content = TypeVar("Content")


NO_FILE = "a folder, a device, a pipe, a socket, or a link that leads to no file"


def named_file(kind: str, name: Any, shipped: Path, suffix: str, *inside: str) -> Path:
    """Return the path of the file that `name` means.

    `name` is a shipped file's name without suffix, the path of a file, or a folder with one of the files `inside`.

    Raises:
        TypeError: `name` is neither a string nor a path.
        ValueError: there is no such file, and the message names a similar shipped file, or all shipped files; or it is
            NO_FILE, or a folder without such a file.
    """
    one_of(kind, name, str, os.PathLike)
    for path in (shipped / f"{name}{suffix}", Path(name), *(Path(name) / file for file in inside)):
        with suppress(OSError):  # the name can be too long for a file name
            if path.is_file():
                return path
    if os.path.lexists(name):
        raise ValueError(f"{kind} {shown(str(name))} must be a name or a file, but it is {NO_FILE}")
    known = (path.stem for path in shipped.glob(f"*{suffix}"))
    raise ValueError(f"{nearest(kind, str(name), known)} (there is no such file either)")


LARGEST = 100_000_000  # bytes; `parsed` refuses a larger file


def parsed(
    path: Path, kind: str, parse: Callable[[Any], Content], decode: Callable[[bytes], Any] | None = None
) -> Content:
    """Read a file and return `parse(decode(content))`; refuse devices and pipes, because reading might never end.

    The default `decode` reads UTF-8, converts line ends to line feeds, and removes a byte order mark.

    Raises:
        ValueError: the file cannot be opened, is not a regular file, is larger than `LARGEST`, is not text, or `parse`
            refuses it. The message names the file and its `kind`.
    """
    try:
        content = whole_content(path)
        return parse(decode(content) if decode else io.TextIOWrapper(io.BytesIO(content), "utf-8-sig").read())
    except (OSError, ValueError, TypeError, AttributeError, LookupError, RecursionError, csv.Error) as error:
        raise ValueError(f"{path} cannot be read as {kind}: {reason(error)}") from error


def whole_content(path: Path) -> bytes:
    """Return the bytes of a file. ValueError: it is no regular file, or is larger than `LARGEST`."""
    if path.exists() and not path.is_file():
        raise ValueError("it is no regular file")
    with path.open("rb") as file:
        content = file.read(LARGEST + 1)
    if len(content) > LARGEST:
        raise ValueError(f"it must have at most {LARGEST:,} bytes")
    return content


def reason(error: Exception) -> str:
    """Return in one line why a file cannot be read."""
    if isinstance(error, (RecursionError, KeyError)):
        return f"it has no {shown(*error.args)}" if isinstance(error, KeyError) else "it is nested too deeply"
    return " ".join(str(getattr(error, "strerror", None) or error).split()) or type(error).__name__


UNFINISHED = ".unfinished"
"""Suffix of the temporary file that `whole_file` writes; the file remains if the process is killed."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class DiskFullError(OSError):
    """The disk or the quota is full, or a file exceeds the largest size allowed."""


@contextmanager
def writing(what: str) -> Iterator[None]:
    """Turn an OSError with a code in NO_ROOM into a DiskFullError, whose message contains `what`."""
    try:
        yield
    except DiskFullError:  # the message of an inner `writing` already names the file
        raise
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        raise DiskFullError(f"no room to write {what}: {error.strerror}") from error


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """Write `path` atomically: yield a temporary file in the same folder, then rename it to `path`.

    If `path` is a link, the file that it points to is replaced.

    Raises:
        OSError: `path` is a folder, a device, a pipe or a loop of links, or cannot be written; `path` is unchanged.
        DiskFullError: there is no room; `path` is unchanged.
    """
    name, path = path, Path(os.path.realpath(path))
    if path.is_symlink() or (path.exists() and not path.is_file()):  # if links form a loop, `realpath` returns a link
        raise OSError(f"{name} must be a file or not exist yet, but it is {NO_FILE}: nothing is written")
    unfinished = path.with_name(f".{path.name}.{os.getpid()}{UNFINISHED}")
    with writing(str(name)):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with unfinished.open("wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(unfinished, path)
        finally:
            unfinished.unlink(missing_ok=True)


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[None]:
    """Hold the lock of the file `path`; only one process or thread at a time can hold this lock.

    The lock is released when the context or the process ends. Once the lock is held, all temporary files of
    `whole_file` in the lock's folder and subfolders are removed; killed processes leave such files.

    Raises:
        ValueError: another process or thread holds the lock and `wait` is False; or `path` is no regular file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise ValueError(f"{path} must be a regular file, because it is the lock of its folder: remove or rename it")
    with path.open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError as error:
            raise ValueError(f"{path.parent} is being written by another process or thread: try again later") from error
        for unfinished in path.parent.rglob(f".*{UNFINISHED}"):
            unfinished.unlink(missing_ok=True)
        yield


def remove_unfinished(folder: Path) -> None:
    """Remove files and folders in `folder` named .NAME.PROCESS.unfinished whose process on this machine has ended."""
    for unfinished in folder.glob(f".*{UNFINISHED}"):
        number = unfinished.name.removesuffix(UNFINISHED).rpartition(".")[2]
        try:
            os.kill(int(number), 0)  # sends nothing
        except (ProcessLookupError, ValueError, OverflowError):
            shutil.rmtree(unfinished) if unfinished.is_dir() else unfinished.unlink(missing_ok=True)
        except PermissionError:  # another user's process
            continue


def write_file(path: Path, content: str | bytes) -> Path:
    """Write bytes, or a text as UTF-8, to `path` atomically (see `whole_file`), and return `path`."""
    with whole_file(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)
    return path
