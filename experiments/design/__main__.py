"""`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR`."""

from experiments.design.options import DesignOptions, write_setup
from experiments.design.study import Search, study_of
from experiments.lab.study import StudyOptions, StudyRun
from impact_gym.support.command_line import command_of, run_command


def design(options: DesignOptions) -> None:
    """Search for designs; write the chosen design as a set-up file, and all results as a page."""
    checked, command = options.checked(), command_of("design", options)
    run = StudyRun(study_of(checked), StudyOptions(checked.out, processes=checked.processes), command)
    page = run.write()
    search = Search(checked)
    chosen = search.candidate(search.chosen(run))
    print(f"set-up: {write_setup(checked.file, checked.arm, chosen, command)}")
    print(f"results: {page.resolve().as_uri()}")


if __name__ == "__main__":
    run_command("design", DesignOptions, design)
