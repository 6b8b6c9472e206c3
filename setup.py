"""The one part of the build that pyproject.toml cannot say: `impact_gym/kernels.pyx` is compiled."""

import runpy

from Cython.Build import cythonize
from setuptools import Extension, setup

FLAGS = [
    "-O3",
    "-g0",  # what a debugger would want takes a quarter of the time and three quarters of the file
    "-fno-math-errno",  # nobody asks for errno, and
    "-fno-trapping-math",  # nobody waits for traps; inf and nan stay what they are
    "-ffp-contract=off",  # a * b + c rounds twice on every processor, so that they agree to the bit
]

digest = runpy.run_path("impact_gym/sources.py")["digest"]()
kernels = Extension(
    "impact_gym.kernels",
    ["impact_gym/kernels.pyx"],
    extra_compile_args=FLAGS,
    define_macros=[("COMPILED_FROM", f'"{digest}"')],
)
setup(ext_modules=cythonize(kernels))
