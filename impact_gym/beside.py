"""Import of `impact_gym.agents` and `impact_gym.experiments` in a checkout, where both are beside the package."""

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType


class Beside:
    """Finder and loader that import `impact_gym.agents` as the module `agents` of the checkout."""

    @staticmethod
    def find_spec(name: str, _path: object = None, _target: object = None) -> ModuleSpec | None:
        """Return the spec of a module of `agents` or `experiments`."""
        beside = name.startswith("impact_gym.") and name.split(".")[1] in ("agents", "experiments")
        return ModuleSpec(name, Beside) if beside else None  # type: ignore[arg-type]

    @staticmethod
    def create_module(spec: ModuleSpec) -> ModuleType:
        """Import the module under its name in the checkout."""
        module = import_module(spec.name.removeprefix("impact_gym."))
        spec.loader_state = module.__spec__
        return module

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        """Restore the spec of the module, which has run already."""
        module.__spec__ = module.__spec__.loader_state  # type: ignore[union-attr]


def install() -> None:
    """Register the finder, in a checkout."""
    if not Path(__file__).with_name("agents").is_dir():
        sys.meta_path.insert(0, Beside)
