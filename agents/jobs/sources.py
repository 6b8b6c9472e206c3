"""The project's sources: a digest of them, and a copy for the nodes of a cluster."""

import hashlib
import importlib.util
import sysconfig
import zipfile
from collections.abc import Iterable
from pathlib import Path

ALWAYS = ("agents", "impact_gym")  # packages that are sent to each node
STANDARD = Path(sysconfig.get_path("stdlib")).resolve()
SOURCES = (".py", ".pyx", ".pxi", ".h", ".csv", ".json", ".toml", ".npz", ".jinja", ".css", ".js", ".typed")
"""Kinds of files that a package here reads or is made of."""
COMPILED = (".so",)


def digest_of(*modules: str) -> str:
    """Return SHA-256 of the sources and data files of modules and whole packages, for `Job.depends`.

    Raises:
        ValueError: no such module.
    """
    digest = hashlib.sha256()
    for name in sorted(modules):
        root = _origin(name)
        for path in _files(root):
            digest.update(f"{name} {path.relative_to(root.parent)}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def stage(functions: Iterable[str], path: Path, always: Iterable[str] = ALWAYS) -> Path:
    """Write a zip of what jobs of these functions import that is not installed, for a cluster's nodes; return `path`.

    These are the top-level packages and modules of this project and of the functions, without what they import from
    elsewhere. The compiled kernels go along, so the nodes need the same Python. The same files make the same zip, so a
    node that has it is not sent it again.
    """
    names = {*always, *(function.partition(":")[0].partition(".")[0] for function in functions)}
    content: dict[str, Path] = {}
    for name in names:
        origin = _origin(name)
        if {"site-packages", "dist-packages"} & {*origin.parts} or origin.is_relative_to(STANDARD):
            continue  # installed, so it is for the nodes to have it as well
        content |= {file.relative_to(origin.parent).as_posix(): file for file in _files(origin, COMPILED)}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in sorted(content):
            entry = zipfile.ZipInfo(name)  # dated 1980, not today
            entry.external_attr = 0o644 << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content[name].read_bytes())
    return path


def _origin(name: str) -> Path:
    """Return a package's folder or a module's file."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    origin = spec and next(iter(spec.submodule_search_locations or ()), spec.origin)
    if not origin:
        raise ValueError(f"there is no module {name!r}")
    return Path(origin).resolve()


def _files(root: Path, besides: tuple[str, ...] = ()) -> list[Path]:
    """Return a module's file, or those of a package in the order of their names."""
    if root.is_file():
        return [root]
    suffixes = SOURCES + besides
    return sorted(path for path in root.rglob("*") if path.suffix in suffixes and not path.name.startswith("."))
