"""Pages and their server: in this process on simulated time, and as a process of its own."""

import os
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import tomli_w
from simulated_time import World

from agents.setups import load_setup
from experiments.play import attempts
from experiments.play.assistance import record_of, usual
from experiments.play.attempts import Attempt, Live
from experiments.play.clock import Clock
from experiments.play.server import Session
from impact_gym.support.files import write_file

SETUP = "teleop-spring"
SERVE = """
import os, runpy
def refuse(*priority): raise PermissionError  # as on a machine that gives no real-time priority
os.sched_setscheduler = refuse
runpy.run_module("experiments.play", run_name="__main__")
"""


def pushed(velocity, after=4, assist="none", seed=1, setup=SETUP, **sliders):
    """A try by a person who commands velocity(time) and releases the stick some steps after the touch."""
    live, touched = Live(Attempt(setup, assist, seed, record_of(usual(load_setup(setup)) | sliders))), 0
    while not live.ended:
        touched += bool(live.batch.bodies().touched[0])
        live.step(velocity(live.time) if touched <= after else 0.0)
    return live.finished()


def near_setup(folder):
    """Write a set-up with near objects, so that a try takes little time; return its file."""
    environment = load_setup(SETUP).environment | {"scenario": {"distance": [0.1, 0.2]}, "horizon": 4.0}
    return write_file(folder / "near.toml", tomli_w.dumps({"environment": environment}))


def choices(setup, **chosen):
    """The settings of the page, as its controls send them."""
    usually = usual(load_setup(setup))
    return {"setup": str(setup), "assist": "none", "slow": 1.0, "seen": False, **usually, **chosen}


class Simulated(World):
    """A session and its clock in this process, on simulated time, and both ends of their connection."""

    def __init__(self, folder):
        super().__init__()
        self.setup, self.folder = near_setup(folder), folder / "tries"
        self.sent = []  # messages of the clock, and when it sent them
        self.clock = Clock(self, self.time, self.sleep)
        self.session = Session(load_setup(self.setup), "none", self.folder, lambda: (self, lambda seconds: None))

    def send(self, message):
        if isinstance(message, tuple):
            self.clock.hear(*message)
        else:
            self.sent.append(message | {"at": self.now})
            self.session.schedule(message, self)

    def close(self):
        """Nothing is to be closed."""

    def play(self, page, steer=lambda frame: None, seed=1, **chosen):
        """Let a page begin a try, and `steer(frame)` it at each frame that it gets; return the try or its failure."""
        page.steer = steer
        self.sent.clear()
        page.say(begin=choices(self.setup, **chosen))
        wanted, path, seen = self.clock.wanted.get_nowait()
        self.clock.play(replace(wanted, seed=seed), path, seen)
        self.sleep(2.0)  # until the last message has arrived
        return attempts.read(path) if self.sent[-1]["kind"] == "ended" else self.sent[-1]


class Page:
    """A page of a simulated session, without a browser."""

    def __init__(self, world):
        self.world, self.messages, self.steer = world, [], lambda frame: None
        world.session.join(self)

    def __call__(self, message):
        self.messages.append(message | {"at": self.world.now})
        if message["kind"] == "frame":
            self.steer(message)

    def say(self, **message):
        self.world.session.handle(self, message)

    def got(self, kind):
        return [message for message in self.messages if message["kind"] == kind]

    def push(self, frame):
        """Push until the touch is seen."""
        self.say(v=0.0 if frame["touched"] else 0.6)


class Served:
    """A running server, its clock's process included: where it is, and how to end it."""

    def __init__(self, process):
        self.process, self.address = process, process.stdout.readline().strip()
        self.socket, self.origin = self.address.replace("http", "ws") + "ws", self.address.rsplit("/", 2)[0]

    def end(self, how):
        """End the server with a signal; return its exit code and what it and its clock print until both have ended."""
        self.process.send_signal(how)
        out, _ = self.process.communicate(timeout=60)
        return self.process.returncode, out


@contextmanager
def served(setup, folder):
    """Serve the page with a folder of tries, at a free port."""
    line = [sys.executable, "-c", SERVE, str(setup), "--port=0", "--no-open", f"--out={folder}"]
    own = {"cwd": folder, "env": os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}, "text": True}
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **own) as process:
        try:
            yield Served(process)
        finally:
            process.kill()
