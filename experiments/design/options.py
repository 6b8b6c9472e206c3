"""The options of `impact-gym design`, and the set-up file of the chosen design."""

import tomllib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
import tyro

from agents.setups import Setup, load_setup
from experiments.design.pads import Pad
from experiments.design.search import CONTACT, Candidate, Limits
from experiments.design.variables import SearchVariable, search_variables, searched_environment
from impact_gym.parameters import SI, Count, Index, Options
from impact_gym.support.files import parsed, write_file
from impact_gym.support.validation import distinct, identifier

PAPER, FRONT, CHOSEN = "paper's rule", "designs", "chosen"  # names of chart lines; more: `DesignOptions.others`
SPRING = "paper's spring"


@dataclass(frozen=True)
class DesignOptions(Options):
    """Search for the coupling and the controller with the lowest V_p (the object's final velocity).

    The search penalizes a design that exceeds --deflection or --stroke in any scenario, exceeds --peak-force in more
    than 5 % of the scenarios, or breaks --touched-once.
    """

    setup: tyro.conf.Positional[str]
    """Name of a shipped set-up, or file of a set-up."""
    free: tuple[str, ...]
    """Numbers that the search may change, each as NAME=LOW:HIGH, such as coupling.stiffness=10:300. NAME is tool_mass,
    or "coupling." followed by a parameter of the coupling."""
    out: Path
    """Folder for all results. To continue after an interruption, repeat the command."""
    pad: str = ""
    """Pad on the tool: memory-foam, neoprene or norbornene. Empty: no pad. The tool's mass includes the pad."""
    times: Annotated[tuple[float, ...], SI("-", above=0)] = (0.9, 1.0, 1.15, 1.35)
    """Limits of the mean approach time (time until the touch), relative to that of the paper's rule with the paper's
    spring. The command searches for a coupling for each of these limits."""
    limits: Annotated[Limits, tyro.conf.arg(name="")] = field(default_factory=Limits)
    tolerance: Annotated[float, SI("-", at_least=0, at_most=0.5)] = 0.05
    """Largest relative manufacturing error of each number of --free. Each scenario draws its own errors. In the
    search, these errors are up to 1.2 times as large."""
    scenarios: Count = 500
    """Number of scenarios in which each candidate (a design with a controller) is simulated."""
    budget: Count = 7200
    """Largest number of candidates in each search, rounded up to a multiple of --population."""
    population: Annotated[int, SI("-", at_least=4)] = 18
    """Number of candidates in each generation of the search (CMA-ES)."""
    against: tuple[str, ...] = ("bistable-blind", "bistable-paper")
    """Set-ups whose couplings are compared with the design. The command searches for a controller for each of
    these couplings."""
    seeds: Count = 2
    """Number of searches for a design at each approach time, each with another seed. The command takes the design with
    the lowest loss."""
    processes: Index = 2
    """Number of searches at the same time, each on one core. 0: the searches run in this process."""

    def __post_init__(self) -> None:
        super().__post_init__()
        identifier("setup", self.file.stem)  # name of the new set-up
        if not self.times:
            raise ValueError("times must have at least one approach time, relative to the paper's rule (no unit)")
        distinct("times", self.times)
        distinct("against", self.against)
        if self.pad:
            Pad.of(self.pad)
        object.__setattr__(self, "times", tuple(sorted(self.times)))
        _ = self.searched, self.others  # these properties raise ValueError if a design is invalid

    @cached_property
    def arm(self) -> Setup:
        """The set-up."""
        return load_setup(self.setup)

    @cached_property
    def variables(self) -> list[SearchVariable]:
        """The numbers that the search may change."""
        return search_variables(self.free, self.arm)

    @cached_property
    def searched(self) -> dict[str, Any]:
        """The set-up's environment, in which each searched number has its range LOW to HIGH."""
        return searched_environment(self.arm, self.variables, self.limits.deflection)

    @cached_property
    def others(self) -> dict[str, dict[str, Any]]:
        """The set-up's environment with the paper's spring, and with the coupling of each set-up in `against`."""
        own = {name: value for name, value in self.arm.environment.items() if name != "coupling"}
        compared = {name: {**own, "coupling": load_setup(name).environment["coupling"]} for name in self.against}
        return {SPRING: own} | compared  # the default coupling is the paper's spring

    @property
    def file(self) -> Path:
        """The set-up file of the chosen design."""
        return self.out / f"{self.arm.name}-designed.toml"

    @property
    def typical(self) -> float:
        """The element of `times` that is nearest to 1, the approach time of the paper's rule."""
        return min(self.times, key=lambda allowed: abs(allowed - 1.0))


OF_TEACHER = ("teacher", "imitation_steps")  # about imitating a baseline that the new set-up lacks


def write_setup(path: Path, setup: Setup, candidate: Candidate, command: str) -> Path:
    """Write a design to `path` as a set-up file that begins with `command` as a comment; return the path."""
    content = parsed(setup.path, "TOML", tomllib.loads)
    task = setup.task.changed(candidate.design)
    environment = task.arguments()
    about = f"designed from {setup.name}: " + "; ".join(f"{name} {x:.4g}" for name, x in candidate.design.items())
    if candidate.pad:
        about += (
            f", on a pad of {candidate.material}; this file draws stiffness and restitution of the contact through the "
            "pad independently of each other; in the search both were computed from the object's stiffness and "
            "restitution without the pad"
        )
        ranges = {name: list(ends) for name, ends in task.scenario.by_id().items()}
        corners = candidate.pad.contact(*np.meshgrid(*(ranges[name] for name in CONTACT)))
        through_pad = {name: [float(v.min()), float(v.max())] for name, v in zip(CONTACT, corners, strict=True)}
        environment["scenario"] = ranges | through_pad
    baseline = f"{path.stem}-profile"
    tables = {
        "version": content.get("version", 1),
        "title": f"{setup.title}: a designed coupling",
        "about": about,
        "environment": environment,
        "training": {k: v for k, v in content.get("training", {}).items() if k not in OF_TEACHER},
        "baselines": {"tuned": {baseline: candidate.rule}, "against": [baseline]},
        "evaluation": {k: v for k, v in content.get("evaluation", {}).items() if k not in ("at_most", "of")},
    }
    written = tomli_w.dumps({name: value for name, value in tables.items() if value})
    controller = f"{candidate.rule} with {', '.join(f'{value:.6g}' for value in candidate.parameters)}"
    write_file(path, f"# {command}\n# Its controller: the {controller}\n{written}")
    load_setup(path)
    return path
