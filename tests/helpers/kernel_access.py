"""The kernels with further entries for tests, compiled from `kernel_access.pyx`."""

import fcntl
import importlib.util
import shlex
import subprocess
import sys
import sysconfig
from functools import cache
from hashlib import sha256
from pathlib import Path

SOURCE, ROOT = Path(__file__).with_name("kernel_access.pyx"), Path(__file__).parents[2]
BUILT = ROOT / "build" / "kernel_access"
FLAGS = "-w", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off"  # round as those of setup.py


def compile_to(library):
    """Without optimisation the compiler takes a tenth of the time."""
    written, headers = library.with_suffix(".c"), (sysconfig.get_path("include"), ROOT / "impact_gym")
    subprocess.run([sys.executable, "-m", "cython", "-o", written, SOURCE], check=True)
    link = *shlex.split(sysconfig.get_config_var("LDSHARED")), *FLAGS, "-O0", '-DCOMPILED_FROM="tests"'
    subprocess.run([*link, *(f"-I{folder}" for folder in headers), written, "-o", library], check=True)
    written.unlink()


@cache
def kernels():
    """The module, compiled if a source has changed; the first process takes 4 s."""
    package = ROOT / "impact_gym"
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
            compile_to(part)
            part.rename(library)
    spec = importlib.util.spec_from_file_location("kernel_access", library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
