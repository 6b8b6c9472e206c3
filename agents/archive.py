"""Archives, the files of policies and checkpoints: arrays and JSON with a checksum. Reading one runs no code."""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from impact_gym.files import reason, whole_file
from impact_gym.validation import shown

Arrays = Mapping[str, NDArray[Any]]


def write_archive(path: Path, kind: str, content: Mapping[str, Any], arrays: Arrays) -> None:
    """Write JSON `content` and `arrays` to `path` atomically; `kind` names the format and its version."""
    with whole_file(path) as file:
        save(file, kind, content, arrays)


def save(file: IO[bytes], kind: str, content: Mapping[str, Any], arrays: Arrays) -> None:
    """Write an archive to an open file."""
    header = {"format": kind, "content": dict(content), "sha256": _checksum(kind, content, arrays)}
    np.savez(file, allow_pickle=False, header=np.array(json.dumps(header)), **arrays)


def read_archive(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of an archive; ValueError: the file is damaged, or its format is not `kind`."""
    try:
        with path.open("rb") as file:
            return load(file, kind)
    except Exception as error:  # a damaged file may raise any error
        pickled = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else reason(error)
        raise ValueError(f"{path} is no {kind} file, or is damaged: {pickled}") from error


def load(file: IO[bytes], kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of an archive in an open file; any exception: it is damaged or no `kind`."""
    size = file.seek(0, io.SEEK_END)
    with NpzFile(file, allow_pickle=False) as archive:
        parts = archive.zip.infolist()  # type: ignore[union-attr]  # None after closing
        if (unpacked := sum(part.file_size for part in parts)) > size:
            raise ValueError(f"it would unpack from {size:,} to {unpacked:,} bytes")
        # a small compressed part could unpack to any size
        if packed := [part.filename for part in parts if part.compress_type != zipfile.ZIP_STORED]:
            raise ValueError(f"{shown(packed[0])} is compressed; an archive is not")
        header = json.loads(str(archive["header"]))
        if header["format"] != kind:
            raise ValueError(f"its format is {header['format']!r}, this version reads {kind!r}")
        arrays = {name: array for name, array in archive.items() if name != "header"}
    checksum = _checksum(kind, header["content"], arrays)
    if checksum != header["sha256"]:
        raise ValueError(f"its checksum is {checksum}, not {header['sha256']}: it was altered")
    return header["content"], arrays


def _checksum(kind: str, content: Mapping[str, Any], arrays: Arrays) -> str:
    digest = hashlib.sha256(json.dumps([kind, content], sort_keys=True).encode())
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
