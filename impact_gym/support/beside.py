"""Make the checkout's packages `agents` and `experiments` importable as parts of `impact_gym`."""

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType


class Beside:
    """A finder and loader of modules. For `impact_gym.agents`, for instance, it imports `agents`."""

    @staticmethod
    def find_spec(name: str, _path: object = None, _target: object = None) -> ModuleSpec | None:
        """Return a spec for `impact_gym.agents`, `impact_gym.experiments` and the modules inside them, else None."""
        beside = name.startswith("impact_gym.") and name.split(".")[1] in ("agents", "experiments")
        return ModuleSpec(name, Beside) if beside else None  # type: ignore[arg-type]

    @staticmethod
    def create_module(spec: ModuleSpec) -> ModuleType:
        """Import and return the module whose name is `spec.name` without `impact_gym.`."""
        module = import_module(spec.name.removeprefix("impact_gym."))
        spec.loader_state = module.__spec__
        return module

    @staticmethod
    def exec_module(module: ModuleType) -> None:
        """Restore the module's own spec, which Python has replaced; `create_module` has already run the module."""
        module.__spec__ = module.__spec__.loader_state  # type: ignore[union-attr]


def install() -> None:
    """Register the finder in a checkout; do nothing in an installed package."""
    if not Path(__file__).parent.with_name("agents").is_dir():
        sys.meta_path.insert(0, Beside)
