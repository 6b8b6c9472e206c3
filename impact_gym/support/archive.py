"""Checksums, and archives: files with JSON, arrays and a checksum. Reading an archive runs no code."""

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from impact_gym.support.files import reason, whole_content
from impact_gym.support.validation import shown

Arrays = Mapping[str, NDArray[Any]]


def checksum(*parts: Any) -> str:
    """Return the SHA-256 of `parts`, one after the other: bytes, texts, arrays (not their shapes) and JSON values."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            part = np.ascontiguousarray(part).tobytes()
        elif not isinstance(part, str | bytes):
            part = json.dumps(part, sort_keys=True)
        digest.update(part.encode() if isinstance(part, str) else part)
    return digest.hexdigest()


def refuse_altered(expected: str, *parts: Any) -> None:
    """Raise ValueError unless `expected` is the `checksum` of `parts`."""
    if (found := checksum(*parts)) != expected:
        raise ValueError(f"its checksum is {found}, not {expected}: it was altered or damaged")


def archive_of(kind: str, content: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return the bytes of an archive of `content` (JSON) and `arrays`; `kind` names the format and its version."""
    header = {"format": kind, "content": dict(content), "sha256": checksum(*_parts(kind, content, arrays))}
    np.savez(file := io.BytesIO(), allow_pickle=False, header=np.array(json.dumps(header)), **arrays)
    return file.getvalue()


def read_archive(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of an archive. ValueError: the file is missing, damaged or of another format."""
    try:
        return unpacked(whole_content(path), kind)
    except Exception as error:  # a damaged file may raise any error
        pickled = "it holds pickled objects, which are never loaded" if "pickle" in str(error) else reason(error)
        raise ValueError(f"{path} is no {kind} file, or is damaged: {pickled}") from error


def unpacked(packed: bytes, kind: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of an archive; any exception means that it is damaged or of another format."""
    with NpzFile(io.BytesIO(packed), allow_pickle=False) as archive:
        parts = archive.zip.infolist()  # type: ignore[union-attr]  # `zip` is None after closing
        if (size := sum(part.file_size for part in parts)) > len(packed):
            raise ValueError(f"its parts add up to {size:,} bytes, more than the {len(packed):,} bytes of the file")
        if compressed := [part.filename for part in parts if part.compress_type != zipfile.ZIP_STORED]:
            raise ValueError(f"{shown(compressed[0])} is compressed, which is not allowed")
        parts.sort(key=lambda part: part.header_offset)
        for part, after in pairwise(parts):
            if part.header_offset + part.file_size > after.header_offset:
                raise ValueError(f"its parts {shown(part.filename)} and {shown(after.filename)} overlap")
        header = json.loads(str(archive["header"]))
        if header["format"] != kind:
            raise ValueError(f"its format is {header['format']!r}, this version reads {kind!r}")
        arrays = {name: array for name, array in archive.items() if name != "header"}
    refuse_altered(header["sha256"], *_parts(kind, header["content"], arrays))
    return header["content"], arrays


def _parts(kind: str, content: Mapping[str, Any], arrays: Arrays) -> list[Any]:
    named = [(f"{name} {arrays[name].dtype.str} {arrays[name].shape}", arrays[name]) for name in sorted(arrays)]
    return [[kind, content], *chain.from_iterable(named)]
