"""Players of the page, with and without a browser, and its server in a separate process."""

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import tomli_w
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from agents.setups import load_setup
from experiments.play import try_files
from experiments.play.assistance import record_of, usual
from experiments.play.tries import Live, Try
from impact_gym.files import write_file

ROOT = Path(__file__).parents[2]
SETUP = "teleop-spring"


def wanted(assist="none", seed=1, setup=SETUP, slow=1.0, **sliders):
    """A try before it is played, with the usual values of all other sliders."""
    return Try(setup, assist, seed, record_of(usual(load_setup(setup)) | sliders), slow=slow)


def pushed(velocity, after=4, **asked):
    """A try by a person who commands velocity(time) and releases the stick some steps after the touch."""
    live, touched = Live(wanted(**asked)), 0
    while not live.ended:
        touched += bool(live.batch.bodies().touched[0])
        live.step(velocity(live.time) if touched <= after else 0.0)
    return live.finished()


def near_setup(folder):
    """Write a set-up with near objects, so that a try takes little time; return its file."""
    environment = load_setup(SETUP).environment | {"scenario": {"distance": [0.1, 0.2]}}
    return write_file(folder / "near.toml", tomli_w.dumps({"environment": environment}))


class Served:
    """A running server: its address and its process."""

    def __init__(self, process, setup, folder):
        self.process, self.setup, self.folder = process, setup, folder
        self.address = process.stdout.readline().strip()
        assert self.address.startswith("http://"), self.address + process.stdout.read()
        self.origin, self.path = re.fullmatch("(http://[^/]+)(.*)", self.address).groups()

    def connect(self, **options):
        where = self.address.replace("http", "ws") + "ws"
        return connect(where, **{"origin": self.origin, "compression": None, "close_timeout": 0.3, **options})

    def tries(self, count=0):
        """Wait until there are `count` tries; return all."""
        while len(found := [this for _, this in try_files.folder_of(self.folder)]) < count:
            time.sleep(0.05)
        return found

    def end(self, how=signal.SIGINT):
        """End the server; return its exit code and what it and its clock print until both have ended."""
        self.process.send_signal(how)
        out, _ = self.process.communicate(timeout=30)
        return self.process.returncode, out

    def choices(self, **chosen):
        """The settings of the page, as its controls send them."""
        usually = usual(load_setup(self.setup))
        return {"setup": str(self.setup), "assist": "none", "slow": 1.0, "seen": False, **usually, **chosen}

    def push(self, page, frames=math.inf):
        """Play a try: push until the touch is displayed, or for some frames; return the last message."""
        say(page, begin=self.choices())
        count, touched, message = 0, False, heard(page, "began")
        while count < frames and message["kind"] not in ("ended", "failed"):
            message = json.loads(page.recv(timeout=20.0))
            if message["kind"] == "frame":
                touched |= message["touched"]
                if count % 4 == 0:
                    say(page, v=0.0 if touched else 0.6)
                count += 1
        return message


@contextmanager
def served(folder, setup=None):
    """Serve the page with a folder of tries, at a free port; by default with a near set-up."""
    setup = setup or near_setup(folder.with_name(folder.name + "-setup"))
    line = [sys.executable, "-m", "experiments.play", str(setup), "--port=0", "--no-open", f"--out={folder}"]
    with subprocess.Popen(
        line, cwd=folder.parent, env=os.environ | {"PYTHONPATH": str(ROOT)}, text=True,
        start_new_session=True,  # so that the whole process group may be killed
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as process:  # fmt: skip
        try:
            yield Served(process, setup, folder)
        finally:
            process.kill()


def heard(page, kind, **having):
    """The next message of a kind with these values."""
    while True:
        message = json.loads(page.recv(timeout=20.0))
        if message["kind"] == kind and having.items() <= message.items():
            return message


def say(page, **message):
    page.send(json.dumps(message))


def closed(page):
    """The code and the reason with which the server closes a connection."""
    with pytest.raises(ConnectionClosed) as gone:
        list(iter(lambda: page.recv(timeout=10.0), None))
    return gone.value.rcvd.code, gone.value.rcvd.reason


READY = "#go:not([disabled])"


def begin(page, key="Enter"):
    page.keyboard.press(key)
    page.wait_for_selector("body.playing")


def until_over(page):
    page.wait_for_selector("body:not(.playing) #answer:not([hidden])", timeout=20000)
