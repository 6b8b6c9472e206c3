"""Build script: compiles the solver, and moves the packages `agents` and `experiments` into `impact_gym` in a wheel.

Other projects also install packages with these two names. impact_gym/support/beside.py makes `impact_gym.agents` and
`impact_gym.experiments` importable in a checkout, too.
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
    "-g0",  # debug information would take a quarter of the build's time and three quarters of the compiled file
    "-fno-math-errno",  # the solver does not read errno
    "-fno-trapping-math",  # the solver does not trap floating-point exceptions
    "-ffp-contract=off",  # a * b + c is rounded twice on every processor
]
BELOW = ("agents", "experiments")
DATA = {
    "impact_gym": ["robot/*.json", "robot/*.urdf", "task/sets/*.csv", "py.typed"],
    "agents": ["setups/*.toml", "tuned/*", "policies/*.npz", "export/*.jinja"],
    "experiments": ["**/*.c", "**/*.jinja", "**/*.js", "**/*.css", "**/*.toml", "**/*.yml", "**/*.json"],
}
NAMED = re.compile(r"""((?:^|\n)\s*(?:from|import)\s+|["'])(agents|experiments)(?=[\s.:"'])""")


def placed(package: str) -> str:
    """Return the name that a package of the checkout has in a wheel."""
    return f"impact_gym.{package}" if package.partition(".")[0] in BELOW else package


class Build(build_py):
    """Copies modules into a wheel."""

    def build_module(self, module: str, module_file: str, package: Any) -> Any:
        """Copy a module. In modules of BELOW in a wheel, put `impact_gym.` before names of BELOW (imports, strings)."""
        out, copied = super().build_module(module, module_file, package)
        if not self.editable_mode and any(f".{name}." in f"{package}." for name in BELOW):
            text = Path(out).read_text()
            Path(out).write_text(NAMED.sub(lambda match: f"{match[1]}impact_gym.{match[2]}", text))
        return out, copied


sources = runpy.run_path("impact_gym/support/sources.py")
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
    }  # an editable install is then a path in a .pth file, which type checkers can read
else:
    layout = {
        "packages": [*map(placed, packages)],
        "package_dir": {placed(name): name for name in BELOW},
        "package_data": {placed(name): files for name, files in DATA.items()},
    }
setup(ext_modules=cythonize(kernels), cmdclass={"build_py": Build}, include_package_data=False, **layout)
