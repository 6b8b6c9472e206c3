"""`impact-gym play`: steer the tool in the browser, alone or assisted."""

import os
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from agents.command_line import run_command


@dataclass(frozen=True)
class Play:
    """Steer the tool in the browser, on this machine only, with a chosen delay and assistance.

    The command prints the page's address and serves the page until you stop it. Every try is saved as a file.
    """

    setup: Annotated[Positional[str], arg(metavar="[SETUP]")] = "teleop-rigid"
    """Name or file of a set-up with an operator; the player takes the operator's place."""
    assist: Annotated[str, arg(metavar="NAME")] = "none"
    """Assistance at the arm: none, brake, limit, policy or rule."""
    port: Annotated[int, arg(metavar="PORT")] = 8765
    """Port of the server; 0: any free port."""
    open: Annotated[FlagCreatePairsOff[bool], arg(help_behavior_hint="")] = True
    """Do not open the page in a browser."""
    out: Annotated[Path | None, arg(metavar="FOLDER", help_behavior_hint="(default: runs/play/SETUP)")] = None
    """Folder of the tries."""


def work(options: Play) -> None:
    """Serve the page until the command is stopped."""
    from experiments.play import assistance, server, session

    setup = assistance.playable(options.setup)
    played = session.Session(setup, options.assist, options.out or Path("runs/play") / setup.name)

    def ready(address: str) -> None:
        print(address, flush=True)
        for each in played.left_out:
            print("kept, but not shown:", "".join(filter(str.isprintable, each)), flush=True)
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
