"""`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR`."""

from experiments.design.options import DesignOptions, write_setup
from experiments.design.study import Search
from experiments.lab.study import StudyOptions, StudyRun
from impact_gym.support.command_line import command_of, run_command


def design(options: DesignOptions) -> None:
    """Search for designs; write the chosen design as a set-up file, and all results as a page."""
    search, command = Search(options), command_of("design", options)
    run = StudyRun(search.study(), StudyOptions(options.out, processes=options.processes), command)
    page = run.write()
    chosen = search.candidate(search.chosen(run))
    print(f"set-up: {write_setup(options.file, options.arm, chosen, command)}")
    print(f"results: {page.resolve().as_uri()}")


if __name__ == "__main__":
    run_command("design", DesignOptions, design)
