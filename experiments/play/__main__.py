"""`impact-gym play`: take the stick in the browser, or run a study of persons who do."""

import os
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from agents.command_line import run_command


@dataclass(frozen=True)
class Play:
    """Serve a page, on this machine alone, on which one steers the tool and feels what delay and assistance do.

    It prints the page's address and serves until it is stopped. Every try is a file.
    """

    setup: Positional[str] = "teleop-spring"
    """Set-up with an operator, whose place the player takes: a name or a file."""
    assist: str = "none"
    """Who assists: none, brake, limit, policy or rule."""
    port: int = 8765
    """Of the server; 0 takes a free one."""
    open: bool = True
    """Open the page in a browser."""
    out: Path | None = None
    """Folder of the tries: runs/play/SETUP, or runs/play/NAME of a plan."""
    plan: Path | None = None
    """A study: a TOML file with conditions, outcome and consent."""
    scripted: int = 0
    """With a plan: let so many scripted persons play it first, without a browser."""
    report: bool = False
    """With a plan: write the page about it from what has been played, and end."""


def work(options: Play) -> None:
    """Do what the options ask for."""
    from experiments.play import assistance, plan, server, session

    study = None
    setup = assistance.playable(options.setup)
    assistance.assistance(options.assist, setup)
    folder = options.out or Path("runs/play") / (options.plan.stem if options.plan else setup.name)
    if options.plan is None and (options.scripted or options.report):
        raise ValueError("scripted and report need a plan: --plan FILE")
    if options.plan is not None:
        from experiments.play import report

        the_plan = plan.read(options.plan)
        study, setup = plan.Study(the_plan, folder), assistance.playable(the_plan.setup)
        report.play_scripted(study, folder, options.scripted)
        print(report.standing(the_plan, folder))
        if options.scripted or options.report:
            print(f"play: {report.write(the_plan, folder).resolve().as_uri()}")
            return
    played = session.Session(setup.called, options.assist, folder, study)

    def ready(address: str) -> None:
        print(address, flush=True)
        display = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if options.open and not (display and webbrowser.open(address)):
            print("no browser could be opened here: open the address above", flush=True)

    try:
        server.serve(played, options.port, ready)
    finally:
        played.close()
        if played.refused:
            print("refused:", ", ".join(f"{count} x {why}" for why, count in played.refused.most_common(9)), flush=True)


if __name__ == "__main__":
    run_command("play", Play, work, "the tries that ended are kept")
