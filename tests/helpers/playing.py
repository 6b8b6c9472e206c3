"""The page that is played: its server in a process of its own, players with and without a browser."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import websockets
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from agents.setups import load_setup
from experiments.play import tries
from experiments.play.assistance import usual

ROOT = Path(__file__).parents[2]
NEAR = "teleop-spring"
RUBBISH = ('{"v":0.5}', "rubbish", '{"v":NaN}', '{"v":1e999}', "[]", '{"x":1}', "x" * 4000, '{"begin":{}}')


class Served:
    """A server that runs: where it is, and its process."""

    def __init__(self, process, address, folder):
        self.process, self.address, self.folder = process, address, folder
        self.origin = "/".join(address.split("/")[:3])

    def connect(self, **options):
        """Return a connection of a page."""
        where = self.address.replace("http", "ws") + "ws"
        return connect(where, **{"origin": self.origin, "compression": None, **options})

    def tries(self):
        """Return what was played so far."""
        return [this for _, this in tries.folder_of(self.folder)]

    @property
    def clock(self):
        """The process number of its clock."""
        (number,) = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return int(number)

    def memory(self):
        """Return what server and clock hold, bytes."""
        held = 0
        for number in (self.process.pid, self.clock):
            status = Path(f"/proc/{number}/status").read_text()
            held += 1024 * int(status.split("RssAnon:")[1].split()[0])
        return held

    def end(self, how=signal.SIGINT):
        """End it; return its exit code and what it printed since."""
        self.process.send_signal(how)
        out, _ = self.process.communicate(timeout=30)
        return self.process.returncode, out


@contextmanager
def served(folder, *words):
    """Serve the page from a folder of tries, at a free port; what is said of errors comes with the rest."""
    line = [
        sys.executable,
        "-m",
        "experiments.command",
        "play",
        *words,
        "--port",
        "0",
        "--no-open",
        "--out",
        str(folder),
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(line, cwd=folder.parent, env=environment, text=True,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip
    try:
        said = [process.stdout.readline()]
        while said[-1] and not said[-1].startswith("http://"):
            said.append(process.stdout.readline())
        assert said[-1], said
        yield Served(process, said[-1].strip(), folder)
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        process.communicate()


def choices(**chosen):
    """What the page's controls say."""
    return {"setup": NEAR, "assist": "none", "slow": 1.0, "seen": False, **usual(load_setup(NEAR)), **chosen}


def heard(page, kind, seconds=20.0, **having):
    """Return the next message of a kind that has some values."""
    end = time.monotonic() + seconds
    while True:
        message = json.loads(page.recv(timeout=end - time.monotonic()))
        if message["kind"] == kind and having.items() <= message.items():
            return message


def say(page, **message):
    """Say something to the server."""
    page.send(json.dumps(message))


def play(page, share=0.6, beats=None, **chosen):
    """Play a try as somebody does who pushes until a touch is seen; return what came of it."""
    say(page, begin=choices(**chosen))
    count, touched = 0, False
    while True:
        message = json.loads(page.recv(timeout=20.0))
        if message["kind"] in ("ended", "failed", "study"):
            return message
        if message["kind"] == "frame":
            touched |= message["touched"]
            count += 1
            if count % 4 == 1 and (beats is None or count < beats):
                say(page, v=0.0 if touched else share)


def closed(page, seconds=10.0):
    """Return code and reason with which the server closes a connection."""
    end = time.monotonic() + seconds
    try:
        while True:
            page.recv(timeout=end - time.monotonic())
    except ConnectionClosed as gone:
        return gone.rcvd.code, gone.rcvd.reason


async def flood(address, seconds, clients=50):
    """Send a thousand messages a second from each of so many clients, good ones and rubbish; return how many went."""
    sent, end = 0, time.monotonic() + seconds
    origin, where = "/".join(address.split("/")[:3]), address.replace("http", "ws") + "ws"

    async def one(number):
        nonlocal sent
        while time.monotonic() < end:
            try:
                async with websockets.connect(where, origin=origin, compression=None) as page:
                    begun, count = time.monotonic(), 0
                    while time.monotonic() < end:
                        await page.send(RUBBISH[number % len(RUBBISH)] if number % 2 else RUBBISH[0])
                        count, sent = count + 1, sent + 1
                        await asyncio.sleep(max(begun + count / 1000 - time.monotonic(), 0.0))
            except (OSError, websockets.WebSocketException):
                await asyncio.sleep(0.02)

    await asyncio.gather(*map(one, range(clients)))
    return sent


def lateness(found):
    """Return |wall - 16 ms| of all steps of tries, ms."""
    return 1e3 * np.abs(np.concatenate([this.late for this in found]))


READY, OVER = "#go:not([disabled])", "#answer:not([hidden])"


class Tab:
    """A page that is open, with what it complained of and what it asked of others."""

    def __init__(self, browser, server, width=1280, height=900, **options):
        self.context = browser.new_context(viewport={"width": width, "height": height}, **options)
        self.page, self.problems = self.context.new_page(), []
        own = (server.address, server.address.replace("http", "ws"), "data:")
        self.page.on("console", lambda message: self.problems.append(message.text))
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("request", lambda request: request.url.startswith(own) or self.problems.append(request.url))
        self.page.on("websocket", lambda socket: socket.url.startswith(own) or self.problems.append(socket.url))
        self.page.goto(server.address)
        self.page.wait_for_selector(READY + ", body.watching")

    def until_over(self):
        """Wait until the try is over and its film is there."""
        self.page.wait_for_selector(OVER, timeout=20000)
        self.page.wait_for_selector("#film h2:has-text('In slow motion')", timeout=20000)
        self.page.wait_for_selector("#film .igw-panel")
