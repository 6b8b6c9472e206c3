"""In a checkout, `agents` and `experiments` lie beside the package; a wheel has them in it. Both names work in both."""

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType


class Beside:
    """Finds `impact_gym.agents` as the module `agents` that it is in a checkout."""

    @staticmethod
    def find_spec(name: str, _path: object = None, _target: object = None) -> ModuleSpec | None:
        """Return how to import a module that lies beside."""
        beside = name.startswith("impact_gym.") and name.split(".")[1] in ("agents", "experiments")
        return ModuleSpec(name, Beside) if beside else None  # type: ignore[arg-type]

    @staticmethod
    def create_module(spec: ModuleSpec) -> ModuleType:
        """Import it under its name here."""
        module = import_module(spec.name.removeprefix("impact_gym."))
        spec.loader_state = module.__spec__
        return module

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        """Have it be what it was; it has run already."""
        module.__spec__ = module.__spec__.loader_state  # type: ignore[union-attr]


def install() -> None:
    """Have Python look there, in a checkout."""
    if not Path(__file__).with_name("agents").is_dir():
        sys.meta_path.insert(0, Beside)
