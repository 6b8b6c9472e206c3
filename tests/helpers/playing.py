"""Players of the page, with and without a browser, and its server in a process of its own."""

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
    """Return a try that is to be played, with the sliders where they begin but for some."""
    return Try(setup, assist, seed, record_of(usual(load_setup(setup)) | sliders), slow=slow)


def pushed(velocity, after=4, **asked):
    """Return a try of somebody who commands velocity(time), and lets go some steps after the touch."""
    live, touched = Live(wanted(**asked)), 0
    while not live.ended:
        touched += bool(live.batch.bodies().touched[0])
        live.step(velocity(live.time) if touched <= after else 0.0)
    return live.finished()


def near_setup(folder):
    """Write a set-up whose objects stand so near that a try takes little time; return its file."""
    environment = load_setup(SETUP).environment | {"scenario": {"distance": [0.1, 0.2]}}
    return write_file(folder / "near.toml", tomli_w.dumps({"environment": environment}))


class Served:
    """A server that runs: where it is, and its process."""

    def __init__(self, process, setup, folder):
        self.process, self.setup, self.folder = process, setup, folder
        self.address = process.stdout.readline().strip()
        assert self.address.startswith("http://"), self.address + process.stdout.read()
        self.origin, self.path = re.fullmatch("(http://[^/]+)(.*)", self.address).groups()

    def connect(self, **options):
        """Return a connection of a page."""
        where = self.address.replace("http", "ws") + "ws"
        return connect(where, **{"origin": self.origin, "compression": None, "close_timeout": 0.3, **options})

    def tries(self, count=0):
        """Return what was played so far, once there are so many."""
        while len(found := [this for _, this in try_files.folder_of(self.folder)]) < count:
            time.sleep(0.05)
        return found

    @property
    def clock(self):
        """The process number of its clock."""
        (number,) = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return int(number)

    def memory(self):
        """Return what server and clock hold, bytes."""
        texts = [Path(f"/proc/{number}/status").read_text() for number in (self.process.pid, self.clock)]
        return sum(1024 * int(text.split("RssAnon:")[1].split()[0]) for text in texts)

    def end(self, how=signal.SIGINT):
        """End it; return its exit code and what it printed since."""
        self.process.send_signal(how)
        out, _ = self.process.communicate(timeout=30)
        return self.process.returncode, out

    def choices(self, **chosen):
        """Return what the page's controls say."""
        usually = usual(load_setup(self.setup))
        return {"setup": str(self.setup), "assist": "none", "slow": 1.0, "seen": False, **usually, **chosen}

    def push(self, page, frames=math.inf):
        """Play a try as somebody does who pushes until a touch is seen, or so many frames; return the last message."""
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
    """Serve the page from a folder of tries, at a free port; with a near set-up unless another is named."""
    setup = setup or near_setup(folder.with_name(folder.name + "-setup"))
    line = [sys.executable, "-m", "experiments.play", str(setup), "--port=0", "--no-open", f"--out={folder}"]
    how = {"cwd": folder.parent, "env": os.environ | {"PYTHONPATH": str(ROOT)}, "text": True}
    how["start_new_session"] = True  # a group of its own, which may be killed
    with subprocess.Popen(line, **how, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        try:
            yield Served(process, setup, folder)
        finally:
            process.kill()


def heard(page, kind, **having):
    """Return the next message of a kind that has some values."""
    while True:
        message = json.loads(page.recv(timeout=20.0))
        if message["kind"] == kind and having.items() <= message.items():
            return message


def say(page, **message):
    """Say something to the server."""
    page.send(json.dumps(message))


def closed(page):
    """Return code and reason with which the server closes a connection."""
    with pytest.raises(ConnectionClosed) as gone:
        list(iter(lambda: page.recv(timeout=10.0), None))
    return gone.value.rcvd.code, gone.value.rcvd.reason


READY = "#go:not([disabled])"


def open_page(browser, server, width=1280, height=900, **options):
    """Return a page that is open, and the list of what it complains of and of others that it asks."""
    page, problems = browser.new_context(viewport={"width": width, "height": height}, **options).new_page(), []
    own = (server.address, server.address.replace("http", "ws"), "data:")
    page.on("console", lambda message: problems.append(message.text))
    page.on("pageerror", lambda error: problems.append(str(error)))
    for kind in ("request", "websocket"):
        page.on(kind, lambda asked: asked.url.startswith(own) or problems.append(asked.url))
    page.goto(server.address)
    page.wait_for_selector(READY + ", body.watching")
    return page, problems


def begin(page, key="Enter"):
    """Begin a try."""
    page.keyboard.press(key)
    page.wait_for_selector("body.playing")


def until_over(page):
    """Wait until the try is over and its result is there."""
    page.wait_for_selector("body:not(.playing) #answer:not([hidden])", timeout=20000)


def pressed(page, name):
    """Return the text of the button that is chosen of a setting."""
    return page.locator(f"[data-set={name}][aria-pressed=true]").text_content()
