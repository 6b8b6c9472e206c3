"""The one part of the build that pyproject.toml cannot say: `impact_gym/kernels.pyx` is compiled."""

import os
import runpy
from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup

FLAGS = ["-O3", "-fno-math-errno", "-fno-trapping-math"]  # inf and nan stay what they are; nobody asks for errno
CPU = Path("/proc/cpuinfo")
if "IMPACT_GYM_PORTABLE" not in os.environ and CPU.exists() and {"avx2", "fma"} <= set(CPU.read_text().split()):
    FLAGS += ["-mavx2", "-mfma"]  # as nearly all x86 processors since 2013 have them: a tenth faster

digest = runpy.run_path("impact_gym/sources.py")["digest"]()
kernels = Extension(
    "impact_gym.kernels",
    ["impact_gym/kernels.pyx"],
    extra_compile_args=FLAGS,
    define_macros=[("COMPILED_FROM", f'"{digest}"')],
)
setup(ext_modules=cythonize(kernels))
