"""Compile kernels for tests: a mutant's, or `kernel_access.pyx`, which has further entries."""

import fcntl
import importlib.util
import shlex
import subprocess
import sys
import sysconfig
from functools import cache
from hashlib import sha256
from pathlib import Path

SOURCE = Path(__file__).with_name("kernel_access.pyx")
BUILT = Path(__file__).parents[2] / "build" / "kernel_access"
FLAGS = "-w", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off"  # round as those of setup.py


def compiled(source, package, library, optimise, digest):
    """Compile a Cython source; without optimisation the compiler takes a tenth of the time."""
    written, headers = library.with_suffix(".c"), (f"-I{folder}" for folder in (sysconfig.get_path("include"), package))
    link = *shlex.split(sysconfig.get_config_var("LDSHARED")), *FLAGS, optimise, f'-DCOMPILED_FROM="{digest}"', *headers
    for command in ([sys.executable, "-m", "cython", "-o", written, source], [*link, written, "-o", library]):
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode:
            raise ValueError(f"{source} does not compile: {made.stderr.strip()[-300:]}")


@cache
def kernels():
    """The module of `kernel_access.pyx`, compiled if a source has changed; the first process takes 4 s."""
    package = SOURCE.parents[2] / "impact_gym"
    sources = (SOURCE, *sorted((*package.glob("*.pyx"), *package.rglob("*.pxi"), *package.rglob("*.h"))))
    content = b"".join(file.read_bytes() for file in sources)
    version = sha256(content).hexdigest()[:16] + sysconfig.get_config_var("EXT_SUFFIX")
    library, part = BUILT / version, BUILT / f"part-{version}"
    BUILT.mkdir(parents=True, exist_ok=True)
    with (BUILT / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not library.exists():
            for stale in BUILT.glob("*.so"):
                stale.unlink()
            compiled(SOURCE, package, part, "-O0", "tests")
            part.rename(library)
            part.with_suffix(".c").unlink()
    spec = importlib.util.spec_from_file_location("kernel_access", library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
