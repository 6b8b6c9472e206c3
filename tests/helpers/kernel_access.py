"""The kernels with further entries for tests, compiled from `kernel_access.pyx`."""

import importlib.util
import shlex
import subprocess
import sys
import sysconfig
from functools import cache
from hashlib import sha256
from pathlib import Path

from impact_gym.support.files import locked

SOURCE, ROOT = Path(__file__).with_name("kernel_access.pyx"), Path(__file__).parents[2]
BUILT = ROOT / "build" / "kernel_access"
FLAGS = "-w", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off"  # round as those of setup.py


@cache
def kernels():
    """The module, compiled if a source has changed; the first process takes 4 s."""
    package = ROOT / "impact_gym"
    sources = (SOURCE, *sorted((*package.glob("*.pyx"), *package.rglob("*.pxi"), *package.rglob("*.h"))))
    content = b"".join(file.read_bytes() for file in sources)
    version = sha256(content).hexdigest()[:16] + sysconfig.get_config_var("EXT_SUFFIX")
    library, part, written = BUILT / version, BUILT / f"part-{version}", BUILT / "written.c"
    # without optimisation the compiler takes a tenth of the time
    link = *shlex.split(sysconfig.get_config_var("LDSHARED")), *FLAGS, "-O0", '-DCOMPILED_FROM="tests"'
    headers = (f"-I{folder}" for folder in (sysconfig.get_path("include"), package))
    with locked(BUILT / "lock"):
        if not library.exists():
            for stale in BUILT.glob("*.so"):
                stale.unlink()
            subprocess.run([sys.executable, "-m", "cython", "-o", written, SOURCE], check=True)
            subprocess.run([*link, *headers, written, "-o", part], check=True)
            part.rename(library)
    spec = importlib.util.spec_from_file_location("kernel_access", library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
