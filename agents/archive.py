"""Files of arrays and JSON with a checksum: how policies and checkpoints are kept. Reading one runs no code."""

import hashlib
import io
import json
import math
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.files import reason, whole_file
from impact_gym.validation import shown

Arrays = Mapping[str, NDArray[Any]]
DAMAGE = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError, SyntaxError),
    *(TypeError, ValueError, tokenize.TokenError, zipfile.BadZipFile, zlib.error, struct.error),
)
"""What reading a file can raise that is not an archive, or no longer."""


def write_archive(path: Path, kind: str, content: Mapping[str, Any], arrays: Arrays) -> None:
    """Write JSON `content` and `arrays` to `path`, whole or not at all; `kind` says what they are, with a version."""
    with whole_file(path) as file:
        save(file, kind, content, arrays)


def save(file: IO[bytes], kind: str, content: Mapping[str, Any], arrays: Arrays) -> None:
    """Write an archive to an open file."""
    header = {"format": kind, "content": dict(content), "sha256": _checksum(kind, content, arrays)}
    np.savez(file, allow_pickle=False, header=np.array(json.dumps(header)), **arrays)


def read_archive(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of an archive.

    Raises:
        ValueError: the file is no archive of this kind, or not what was written.
    """
    try:
        with path.open("rb") as file:
            return load(file, kind)
    except DAMAGE as error:
        pickled = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else reason(error)
        raise ValueError(f"{path} is no {kind} file, or is damaged: {_what_else(path) or pickled}") from error


def _what_else(path: Path) -> str:
    """Return what a file is that is no npz; "" where it is one, or not to be read."""
    try:
        with path.open("rb") as file:
            first = file.read(1000)
    except OSError:
        return ""
    if first.startswith(b"\x93NUMPY"):
        return "it is a single array, .npy"
    is_text = first.isascii() and not first.startswith(b"PK")
    return f"it is a text that begins with {shown(first.decode()[:40])}" if is_text else ""


def load(file: IO[bytes], kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of an archive in an open file.

    Raises:
        DAMAGE: it is none of this kind, or not what was written.
    """
    size = file.seek(0, io.SEEK_END)
    with zipfile.ZipFile(file) as archive:
        if (unpacked := sum(part.file_size for part in archive.infolist())) > size:
            raise ValueError(f"it would unpack from {size:,} to {unpacked:,} bytes")
        if packed := [part.filename for part in archive.infolist() if part.compress_type != zipfile.ZIP_STORED]:
            raise ValueError(f"{shown(packed[0])} is compressed, which none of ours is")  # a decoder may ask for memory
        header = json.loads(str(_read(archive, "header.npy")))
        if header["format"] != kind:
            raise ValueError(f"its format is {header['format']!r}, this version reads {kind!r}")
        names = [name for name in archive.namelist() if name != "header.npy"]
        arrays = {name.removesuffix(".npy"): _read(archive, name) for name in names}
    checksum = _checksum(kind, header["content"], arrays)
    if checksum != header["sha256"]:
        raise ValueError(f"its checksum is {checksum}, not {header['sha256']}: it was altered")
    return header["content"], arrays


def _read(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """Return an array, once it is known to be as large as what is there: a header alone asks for no memory.

    Raises:
        DAMAGE: it is not, or it holds objects.
    """
    form = np.lib.format
    with archive.open(name) as part:
        first = form.read_magic(part) == (1, 0)
        shape, _, dtype = (form.read_array_header_1_0 if first else form.read_array_header_2_0)(part)
        claimed, there = math.prod(shape) * dtype.itemsize, archive.getinfo(name).file_size - part.tell()
        if claimed != there and not dtype.hasobject:
            raise ValueError(f"{name} claims {claimed:,} bytes and has {there:,}")
        part.seek(0)
        array: NDArray[Any] = form.read_array(part, allow_pickle=False)
    return array


def _checksum(kind: str, content: Mapping[str, Any], arrays: Arrays) -> str:
    """Return SHA-256 of all that a reader gets."""
    digest = hashlib.sha256(json.dumps([kind, content], sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
