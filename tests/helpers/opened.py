"""`opened_kernels.pyx`, the kernels with entries for tests; compiled if a source of the kernels has changed."""

import fcntl
import importlib.util
import shlex
import subprocess
import sys
import sysconfig
from functools import cache
from hashlib import sha256
from pathlib import Path

SOURCE = Path(__file__).with_name("opened_kernels.pyx")
BUILT = Path(__file__).parents[2] / "build" / "opened_kernels"
FLAGS = "-O0 -w -fPIC -fno-math-errno -fno-trapping-math -ffp-contract=off -DCOMPILED_FROM='\"tests\"'"
"""Without optimisation the compiler takes a tenth of the time; each operation rounds as with the flags of setup.py."""


@cache
def kernels():
    """The compiled module; the first process takes 4 s."""
    package = SOURCE.parents[2] / "impact_gym"
    sources = (SOURCE, *sorted((*package.glob("*.pyx"), *package.rglob("*.pxi"), *package.rglob("*.h"))))
    content = b"".join(file.read_bytes() for file in sources)
    version = sha256(content).hexdigest()[:16] + sysconfig.get_config_var("EXT_SUFFIX")
    library, written = BUILT / version, BUILT / f"{version}.c"
    BUILT.mkdir(parents=True, exist_ok=True)
    with (BUILT / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not library.exists():
            for stale in BUILT.glob("*.so"):
                stale.unlink()
            headers = shlex.join(f"-I{folder}" for folder in (sysconfig.get_path("include"), package))
            link = f"{sysconfig.get_config_var('LDSHARED')} {FLAGS} {headers}"
            subprocess.run([sys.executable, "-m", "cython", "-o", written, SOURCE], check=True)
            subprocess.run([*shlex.split(link), written, "-o", written.with_suffix(".so")], check=True)
            written.with_suffix(".so").rename(library)
            written.unlink()
    spec = importlib.util.spec_from_file_location("opened_kernels", library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
