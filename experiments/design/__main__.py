"""`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR`; the options are those of `Study`."""

from agents.command_line import command_of, run_command
from experiments.design.page import row, sentence, write_page
from experiments.design.run import run
from experiments.design.study import CHOSEN, Study, write_setup
from experiments.lab.results import noted


def design(study: Study) -> None:
    """Search for the design, write it as a set-up, and write the page."""
    study, line = study.checked(), command_of("design", study)
    study.out.mkdir(parents=True, exist_ok=True)
    with noted(study.out, line, ("cma",), again=False) as runs:
        entries = run(study)
    for entry in entries:
        print(sentence(row(entry, entries[0])))
    chosen = next(entry for entry in entries if entry.line == CHOSEN and entry.allowed == study.typical)
    setup = write_setup(study.out / f"{study.arm.name}-designed.toml", study.arm, chosen.rig, line)
    print(f"set-up: {setup}")
    print(f"page: {write_page(study, entries, setup.name, runs).resolve().as_uri()}")


if __name__ == "__main__":
    run_command("design", Study, design)
