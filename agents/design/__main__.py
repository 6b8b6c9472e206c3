"""The command line of `agents.design`."""

import math
import shlex
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import tyro

from agents.archive import write_archive
from agents.command_line import command_line
from agents.design.free import read_all, searched_environment
from agents.design.limits import UNITS, Limits
from agents.design.pads import pad_of
from agents.design.set_up_file import write_setup
from agents.design.study import Entry, Study, lines, run, with_papers_spring
from agents.design.told import told_policy
from agents.setups import Setup, load_setup
from impact_gym.validation import number, whole

FORMAT = "impact_gym designs 1"
MECHANISMS = ("bistable-blind", "bistable-paper")


@dataclass(frozen=True)
class DesignOptions:
    """Search for the coupling that, with its best controller, leaves the object slowest at each approach time.

    Deflection and stroke are kept to in all scenarios of the search, peak force and energy in 95 % of them.
    """

    setup: tyro.conf.Positional[str]
    """A name or a file."""
    free: tuple[str, ...]
    """NAME=LOW:HIGH of each number that may be chosen, tool_mass or of the coupling: coupling.stiffness=10:300."""
    out: Path
    """Folder for all of it; what is done is kept there, and the same command goes on."""
    inner: str = ""
    """A policy that is told of the design, such as linear-designs: it chooses designs in a minute, and only then is
    a controller searched for each; otherwise design and controller are searched together."""
    pad: str = ""
    """A pad of agents/design/pads.py on the tool; its mass counts as the tool's."""
    times: tuple[float, ...] = (0.9, 1.0, 1.15, 1.35)
    """Approach times, as multiples of that of the paper's rule with the paper's spring."""
    deflection: float = 0.05
    """m, that the tool may move against the flange before the first touch."""
    stroke: float | None = None
    """m, likewise in the whole episode."""
    release: float | None = None
    """J, that a mechanism may set free where it snaps through."""
    peak_force: float | None = None
    """N, of the contact."""
    energy: float | None = None
    """J, that the object leaves with."""
    touched_once: float | None = None
    """Least share of the scenarios without a second blow, such as 0.95."""
    against: tuple[str, ...] = MECHANISMS
    """Set-ups whose coupling is compared, with a controller of its own."""
    tolerance: float = 0.05
    """Share by which each number of a design may be off as it is built: in search and test each scenario meets another.
    Without it a mechanism is found that holds its tool by a hair."""
    scenarios: int = 500
    """Training scenarios that each candidate is played through."""
    budget: int = 7200
    """Candidates of each search."""
    population: int = 18
    """Of these in a generation: they are played together."""
    seeds: int = 2
    """Searches for each design, of which validation chooses one."""
    processes: int = 2
    """Searches at a time, each on one core; 0: none but this process."""

    def study(self) -> Study:
        """Return the study, all of it checked.

        Raises:
            ValueError: names what is wrong.
        """
        for name, least in (("scenarios", 1), ("budget", 1), ("population", 4), ("seeds", 1), ("processes", 0)):
            whole(name, getattr(self, name), at_least=least)
        for name, unit in UNITS.items():
            if getattr(self, name) is not None:
                number(name, getattr(self, name), unit, above=0, at_most=1.0 if name == "touched_once" else math.inf)
        for time in self.times:
            number("times", time, "(no unit)", above=0)
        number("tolerance", self.tolerance, "(no unit)", at_least=0.0, at_most=0.5)
        if not self.times:
            raise ValueError("times must name an approach time at least, as a multiple of that of the paper's rule")
        if self.pad:
            pad_of(self.pad)
        setup = load_setup(self.setup)
        free = read_all(self.free, setup)
        searched = searched_environment(setup, free, self.deflection)
        if self.inner:
            told_policy(self.inner, setup, free)
            if self.pad:
                raise ValueError(f"--inner {self.inner} knows of no pad, leave out --pad {self.pad}")
        limits = Limits(*(getattr(self, name) for name in Limits._fields))
        others = {"paper's spring": with_papers_spring(setup.environment)}
        others |= {
            name: setup.environment | {"coupling": load_setup(name).environment["coupling"]} for name in self.against
        }
        rest = (self.scenarios, self.budget, self.population, self.seeds, self.out, self.processes, others, self.inner)
        return Study(setup, free, searched, sorted(self.times), limits, self.pad, self.tolerance, *rest)


def write(entries: list[Entry], setup: Setup, options: DesignOptions, seconds: float) -> Path:
    """Write what came of a study in so many seconds, and the chosen design as a set-up; return the set-up's path."""
    arrays = {f"{name}_{place}": values for place, one in enumerate(entries) for name, values in one.played.items()}
    told = [{name: value for name, value in asdict(one).items() if name != "played"} for one in entries]
    line = shlex.join(["python", "-m", "agents.design", *sys.argv[1:]])
    content = {
        "command": line,
        "seconds": seconds,
        "setup": setup.name,
        "tolerance": options.tolerance,
        "entries": told,
    }
    write_archive(options.out / "designs.npz", FORMAT, content, arrays)
    chosen = min((one for one in entries if one.line == "chosen"), key=lambda one: abs(one.share - 1.0))
    return write_setup(options.out / f"{setup.name}-designed.toml", setup, chosen, line)


def main() -> None:
    """Search for the design that the command line asks for."""
    with command_line("agents.design"):
        options = tyro.cli(DesignOptions, prog="python -m agents.design")
        study = options.study()
        options.out.mkdir(parents=True, exist_ok=True)
        begun = perf_counter()
        entries = run(study)
        for line in lines(entries):
            print(line)
        print(f"set-up: {write(entries, study.setup, options, perf_counter() - begun)}")
        subprocess.run([sys.executable, "-m", "experiments.design", str(options.out)], check=False)


if __name__ == "__main__":
    main()
