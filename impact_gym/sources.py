"""The sources of the compiled solver: which are generated, and a check that it was compiled from those beside it."""

import hashlib
import runpy
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parent
REMEDY = "compile it with `make setup`, or `python setup.py build_ext --inplace` in the project's folder"


TABLEAU, NUMBERS = "solver/dop853.pxi", "task/numbers.pxi"
GENERATORS = {TABLEAU: HERE / "solver" / "tableau.py", NUMBERS: HERE / "task" / "numbers.py"}
"""Sources written by setup.py, each with the module whose `text()` it is."""
INPUTS = [f"impact_gym/{name}" for name in ("solver/tableau.py", "task/numbers.py", "quantities.py")]
"""What they are written from, in the project's folder: a change of it compiles anew."""


def generated(name: str) -> str:
    """Return the text of a generated source."""
    if "impact_gym" not in sys.modules:  # to compile: the package's own __init__ needs the solver
        sys.modules["impact_gym"] = package = ModuleType("impact_gym")
        package.__path__ = [str(HERE)]
    return str(runpy.run_path(str(GENERATORS[name]))["text"]())


def write() -> None:
    """Write the generated sources; one that is up to date is left alone, so that it is not compiled anew."""
    for name in GENERATORS:
        file, text = HERE / name, generated(name)
        if not file.is_file() or file.read_text() != text:
            file.write_text(text)


def digest() -> str:
    """Return a digest of the sources of `impact_gym.kernels`, empty where a wheel left them out."""
    files = {*HERE.glob("*.pyx"), *HERE.glob("*/*.pxi"), *HERE.glob("*/*.h")} - {HERE / name for name in GENERATORS}
    if not files:
        return ""
    contents = [file.read_bytes() for file in (*sorted(files), GENERATORS[TABLEAU])]
    return hashlib.sha256(b"".join([*contents, generated(NUMBERS).encode()])).hexdigest()[:16]


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
