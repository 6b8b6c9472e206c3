"""`impact-gym play`: steer the tool in the browser, with or without assistance."""

import os
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import FlagCreatePairsOff, Positional

from impact_gym.support.command_line import run_command


@dataclass(frozen=True)
class Play:
    """Steer the tool in the browser, with a delay and an assistance that you choose.

    The command prints the address of a page, and serves this page until you stop the command. Only a browser on this
    machine can open the page. Each approach that you steer (a try) is saved as a file.
    """

    setup: Positional[str] = "teleop-rigid"
    """Name or file of a set-up that has an operator (a model of a person who steers the arm). You replace the
    operator."""
    assist: str = "none"
    """Assistance (a controller at the arm that may change your command): none, brake, limit, policy or rule."""
    port: int = 8765
    """Port of the server. 0: any free port."""
    open: FlagCreatePairsOff[bool] = True
    """With --no-open, the command does not open the page in a browser."""
    out: Path | None = None
    """Folder for the files of the tries. The default is runs/play/SETUP."""


def work(options: Play) -> None:
    """Serve the page until the command is stopped."""
    from experiments.play import assistance, server

    setup = assistance.playable(options.setup)
    played = server.Session(setup, options.assist, options.out or Path("runs/play") / setup.name)

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


if __name__ == "__main__":
    run_command("play", Play, work, "the tries that ended are kept")
