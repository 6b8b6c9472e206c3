"""What pyproject.toml cannot say: the solver is compiled, and a wheel has one package at its top.

The names `agents` and `experiments` are others' as well. So in a wheel they lie below `impact_gym`, and what their
sources import, and name in strings, is renamed with them. A checkout, and what is installed from it to edit, is as it
lies here; `impact_gym.agents` is found there, too.
"""

import re
import runpy
import sys
from pathlib import Path
from typing import Any

from Cython.Build import cythonize
from setuptools import Extension, find_packages, setup
from setuptools.command.build_py import build_py

FLAGS = [
    "-O3",
    "-g0",  # what a debugger would want takes a quarter of the time and three quarters of the file
    "-fno-math-errno",  # nobody asks for errno, and
    "-fno-trapping-math",  # nobody waits for traps; inf and nan stay what they are
    "-ffp-contract=off",  # a * b + c rounds twice on every processor, so that they agree to the bit
]
BELOW = ("agents", "experiments")
DATA = {
    "impact_gym": ["robot/*.json", "robot/*.urdf", "task/sets/*.csv", "py.typed"],
    "agents": ["setups/*.toml", "tuned/*", "policies/*.npz", "export/*.jinja"],
    "experiments": ["**/*.jinja", "**/*.js", "**/*.css", "**/*.toml"],
}
NAMED = re.compile(r"""((?:^|\n)\s*(?:from|import)\s+|["'])(agents|experiments)(?=[\s.:"'])""")


def placed(package: str) -> str:
    """Return where a package of the checkout lies in a wheel."""
    return f"impact_gym.{package}" if package.partition(".")[0] in BELOW else package


class Build(build_py):
    """Copies modules, with the names under which they find each other there."""

    def build_module(self, module: str, module_file: str, package: Any) -> Any:
        """Copy a module, renamed where it says so."""
        out, copied = super().build_module(module, module_file, package)
        if not self.editable_mode and any(f".{name}." in f"{package}." for name in BELOW):
            text = Path(out).read_text()
            Path(out).write_text(NAMED.sub(lambda match: f"{match[1]}impact_gym.{match[2]}", text))
        return out, copied


sources = runpy.run_path("impact_gym/sources.py")
sources["write"]()
kernels = Extension(
    "impact_gym.kernels",
    ["impact_gym/kernels.pyx"],
    depends=["impact_gym/solver/taylor.h", *sources["INPUTS"]],
    extra_compile_args=FLAGS,
    define_macros=[("COMPILED_FROM", f'"{sources["digest"]()}"')],
)
packages = find_packages(include=["impact_gym*", "agents*", "experiments*"])
if "editable_wheel" in sys.argv:
    layout = {
        "packages": packages,
        "package_dir": {"": "."},
        "package_data": DATA,
    }  # a plain path, as every tool follows
else:
    layout = {
        "packages": [*map(placed, packages)],
        "package_dir": {placed(name): name for name in BELOW},
        "package_data": {placed(name): files for name, files in DATA.items()},
    }
setup(ext_modules=cythonize(kernels), cmdclass={"build_py": Build}, include_package_data=False, **layout)
