"""Write the generated sources of the compiled program, and check that the program matches its present sources."""

import hashlib
import runpy
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

HERE = Path(__file__).parents[1]
REMEDY = "compile it with `make setup`, or `python setup.py build_ext --inplace` in the project's folder"


TABLEAU, NUMBERS = "solver/dop853.pxi", "task/numbers.pxi"
GENERATORS = {TABLEAU: HERE / "solver" / "tableau.py", NUMBERS: HERE / "task" / "numbers.py"}
"""Sources that setup.py writes, each with the module whose function `text()` returns the source."""
INPUTS = [f"impact_gym/{name}" for name in ("solver/tableau.py", "task/numbers.py", "quantities.py")]
"""Files that determine the generated sources; if one changes, setup.py compiles again."""


def generated(name: str) -> str:
    """Return the text of a generated source."""
    if "impact_gym" not in sys.modules:  # in setup.py, which cannot import the package before it compiles the solver
        sys.modules["impact_gym"] = package = ModuleType("impact_gym")
        package.__path__ = [str(HERE)]
    return str(runpy.run_path(str(GENERATORS[name]))["text"]())


def write() -> None:
    """Write the generated sources whose text has changed; rewriting the others would cause a new compilation."""
    for name in GENERATORS:
        file, text = HERE / name, generated(name)
        if not file.is_file() or file.read_text() != text:
            file.write_text(text)


def digest() -> str:
    """Return a digest of the sources of `impact_gym.kernels`; "" in a wheel, which does not contain them."""
    files = {*HERE.glob("*.pyx"), *HERE.glob("*/*.pxi"), *HERE.glob("*/*.h")} - {HERE / name for name in GENERATORS}
    if not files:
        return ""
    contents = [file.read_bytes() for file in (*sorted(files), GENERATORS[TABLEAU])]
    return hashlib.sha256(b"".join([*contents, generated(NUMBERS).encode()])).hexdigest()[:16]


def compiled_from() -> str:
    """Return the digest of the sources from which `impact_gym.kernels` was compiled."""
    from impact_gym.kernels import COMPILED_FROM

    return str(COMPILED_FROM)


def check() -> None:
    """Raise ImportError if there is no compiled program, or its sources have changed."""
    if find_spec("impact_gym.kernels") is None:
        raise ImportError(f"impact_gym: the solver is not compiled; {REMEDY}")
    if digest() not in ("", compiled_from()):
        raise ImportError(f"impact_gym: the sources of the solver have changed since it was compiled; {REMEDY}")
