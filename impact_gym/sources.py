"""Refuse a stale compiled solver: one that is missing, or was compiled from other sources than those beside it."""

import hashlib
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
REMEDY = "compile it with `make setup`, or `python setup.py build_ext --inplace` in the project's folder"


def digest() -> str:
    """Return a digest of the sources of `impact_gym.kernels`, empty where a wheel left them out."""
    files = sorted((*HERE.glob("*.pyx"), *HERE.glob("*/*.pxi"), *HERE.glob("*/*.h")))
    content = b"".join(file.read_bytes() for file in files)
    return hashlib.sha256(content).hexdigest()[:16] if files else ""


def compiled_from() -> str:
    """Return the digest of the sources that the solver was compiled from."""
    from impact_gym.kernels import COMPILED_FROM

    return str(COMPILED_FROM)


def check() -> None:
    """Raise ImportError if the solver is not compiled, or was from other sources than those beside it."""
    if find_spec("impact_gym.kernels") is None:
        raise ImportError(f"impact_gym: the solver is not compiled; {REMEDY}")
    if digest() not in ("", compiled_from()):
        raise ImportError(f"impact_gym: the sources of the solver have changed since it was compiled; {REMEDY}")
