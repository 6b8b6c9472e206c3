"""The page's server: it checks messages of the page, and forwards messages of the clock (the process that plays) to it.

The server answers only requests from this machine that have a secret token in the address.
"""

import asyncio
import json
import logging
import secrets
import socket
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, suppress
from datetime import datetime
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from websockets.asyncio import server
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from agents.setups import Setup
from experiments.lab import player
from experiments.play import attempts, clock, contest
from experiments.play.assistance import NAMES, RANGES, about, assistance, playable, record_of, related
from impact_gym.support.files import locked
from impact_gym.support.validation import choice, flag, identifier, number, one_of

HERE, LAB = Path(__file__).parent, Path(__file__).parents[1] / "lab"
SCRIPTS = tuple(HERE / name for name in ("stage.js", "stick.js", "settings.js", "chart.js", "play.js"))
HOST = "127.0.0.1"
MESSAGE_BYTES, RATE = 512, 250.0  # limits: bytes in a message; messages per second from a page
FILM_LIMIT = 60.0  # s, time limit for the server to make a film
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Resource-Policy": "same-origin", "Connection": "close",
}  # fmt: skip
RESTART = 1012  # code with which the server closes a connection when the server stops
MAX_ON_CHART = 200  # largest number of attempts on the chart
Page = Callable[[dict[str, Any]], object]
"""A function that sends a message to a page."""


class Session:
    """The page that steers, which is the one opened last, and the attempt in progress, if there is one."""

    def __init__(self, setup: Setup, assist: str, folder: Path, start: Callable[[], Any] = clock.start) -> None:
        """Read the attempts in `folder`, `start` the clock; ValueError: no such assistance, or the folder is in use."""
        assistance(assist, setup)
        self._lock = ExitStack()  # the clock's process inherits the lock
        self._lock.enter_context(locked(folder / ".lock", wait=False))
        self.setup, self.assist, self.folder = setup.cli_name, assist, folder
        self.page: Page | None = None
        self.setups = {name: about(playable(name)) for name in related(setup).values()}
        self.busy, self._speeds = False, (-1.0, 1.0)  # whether an attempt is in progress; velocity range, m/s
        self._seen_at, self._newest = 0.0, -1  # s, latest time for sending a frame; number of the newest sent frame
        self.history: deque[dict[str, Any]] = deque(maxlen=MAX_ON_CHART)
        self.left_out = list[str]()  # reasons for which .json files are left out
        for path in sorted(folder.glob("*.json")):
            try:
                name = identifier(f"name of {path}", path.stem)
                self.history.append(clock.entry_of(name, attempts.read(path)))
            except ValueError as problem:
                self.left_out.append(str(problem))
        self.pipe, self._join_clock = start()

    def handle(self, page: Page, message: Any) -> None:
        """Handle a message of a page; ValueError: the message is invalid."""
        one_of("message", message, dict)
        if len(message) != 1:
            raise ValueError("a message must have one key")
        ((word, value),) = message.items()
        choice("message", word, ("v", "begin", "done"))
        if page is not self.page:
            return
        if word == "v":
            stick = number("v", value, "(of full speed)", at_least=-1.0, at_most=1.0)
            if self.busy:  # the clock keeps all inputs of an attempt
                self._send("v", abs(stick) * self._speeds[stick >= 0.0])
        elif word == "done":
            self._send("stop", "")
        elif not self.busy:
            self._begin(value)

    def _begin(self, options: Any) -> None:
        one_of("begin", options, dict)
        choice("setup", options.get("setup"), list(self.setups))
        choice("assist", options.get("assist"), list(NAMES))
        flag("seen", options.get("seen"))
        chosen, settings = self.setups[options["setup"]], {}
        for name, usual in chosen["usual"].items():
            unit, low, high = RANGES[name]
            settings[name] = number(name, options.get(name, usual), unit, at_least=low, at_most=high)
        slow = number("slow", options.get("slow"), "(times)", at_least=1.0, at_most=attempts.SLOWEST)
        record = record_of(settings)
        if (distance := options.get("distance")) is not None:  # without a distance in the record, the distance is drawn
            near, far = chosen["distance"]
            record["distance"] = number("distance", distance, "m", at_least=near, at_most=far)
        self._speeds, self._newest, self.busy = chosen["speeds"], -1, True
        seed, path = secrets.randbelow(2**31), self.folder / f"{datetime.now():%Y%m%d-%H%M%S-%f}.json"
        wanted = attempts.Attempt(options["setup"], options["assist"], seed, record, slow=slow)
        self._send("play", (wanted, path, options["seen"]))

    def join(self, page: Page) -> None:
        """Let a page steer; send set-ups, assistances, RANGES and earlier attempts to this page."""
        if self.page:
            self.page({"kind": "taken"})
            self._send("stop", "another tab took the stick")
        self.page = page
        page({
            "kind": "hello", "setups": self.setups, "setup": self.setup, "assists": NAMES, "assist": self.assist,
            "attempts": list(self.history), **{name: limits for name, (_, *limits) in RANGES.items()},
        })  # fmt: skip

    def leave(self, page: Page, why: str) -> None:
        """Remove a page, for the reason `why`; if this page steered, the arm stops."""
        if page is self.page:
            self._send("stop", why)
            self.page = None

    def _send(self, word: str, value: Any) -> None:
        with suppress(OSError):
            self.pipe.send((word, value))

    def listen(self) -> None:
        """Handle the messages of the clock that have arrived."""
        loop = asyncio.get_running_loop()
        try:
            while self.pipe.poll():
                self.schedule(self.pipe.recv(), loop)
        except (EOFError, OSError):
            loop.remove_reader(self.pipe.fileno())
            self._forward({"kind": "failed", "text": "the clock has stopped: start impact-gym play again"})

    def schedule(self, message: dict[str, Any], loop: Any) -> None:
        """Let `loop` forward a frame of the clock after the frame's delay, and a result after the last frame."""
        at = loop.time() + message.pop("wait", 0.0)
        if message["kind"] == "frame":
            self._seen_at = max(self._seen_at, at)
        elif message["kind"] in ("ended", "failed"):
            at = max(at, self._seen_at + 1e-6)  # two calls at the same time may run in any order
        loop.call_at(at, self._forward, message)

    def _forward(self, message: dict[str, Any]) -> None:
        """Send a message to the page, except a frame that is not newer than the last one."""
        kind = message["kind"]
        if kind == "frame":
            if message["n"] <= self._newest:
                return
            self._newest = message["n"]
            if message["touched"]:
                self._send("touched", None)
        elif kind in ("ended", "failed"):
            self.busy = False
        if kind == "ended":
            self.history.append(message["entry"])
        if self.page:
            self.page(message)

    def close(self) -> None:
        """Stop the clock, which saves the attempt in progress, and release the folder."""
        self.pipe.close()
        self._join_clock(20.0)
        self._lock.close()


def foreign(request: Request, token: str, port: int) -> str | None:
    """Return why to refuse a request: another host (DNS rebinding), another origin, another token; None: accept."""
    hosts = [f"{name}:{port}" for name in (HOST, "localhost")]
    host, origin = map(request.headers.get_all, ("Host", "Origin"))
    if len(host) != 1 or host[0] not in hosts:
        return "another host"
    if origin not in [[f"http://{each}"] for each in hosts] and (origin or "Upgrade" in request.headers):
        return "another origin"
    given = f"{request.path.partition('?')[0]}/".split("/")[1]  # added "/": the path of `OPTIONS *` has none
    return None if secrets.compare_digest(given, token) else "another token"


def reply(status: int, text: str, kind: str = "text/plain") -> Response:
    """Return an answer with HEADERS."""
    body = text.encode(errors="replace")
    about = {"Content-Type": f"{kind}; charset=utf-8", "Content-Length": str(len(body))}
    return Response(status, HTTPStatus(status).phrase, Headers(HEADERS | about), body)


class Site:
    """Content at addresses that begin with /token/: page, style sheet, script, films, messages."""

    def __init__(self, session: Session, token: str, port: int, now: Callable[[], float] = time.monotonic) -> None:
        self.session, self.token, self.port, self.now = session, token, port, now
        styles = [(LAB / "page.css").read_text(), player.style(), (HERE / "play.css").read_text()]
        self.files = {
            "": ((HERE / "page.html.jinja").read_text(), "text/html"),
            "play.css": ("\n".join(styles), "text/css"),
            "page.js": ((LAB / "page.js").read_text(), "text/javascript"),
            "play.js": (player.script(*SCRIPTS), "text/javascript"),
        }

    async def answer(self, _connection: server.ServerConnection, request: Request) -> Response | None:
        """Return the answer to a request; None: open a WebSocket for messages."""
        if wrong := foreign(request, self.token, self.port):
            return reply(403, f"{wrong}\n")
        if request.method != "GET":
            return reply(405, "only GET\n")
        kind, _, name = request.path.partition("?")[0].removeprefix(f"/{self.token}/").partition("/")
        if kind == "ws":
            return None
        if kind in self.files and not name:
            return reply(200, *self.files[kind])
        if kind != "film":
            return reply(404, "not found\n")
        try:
            film = await asyncio.to_thread(self.film, unquote(name))
        except (OSError, RuntimeError, ValueError, TypeError, LookupError) as problem:
            return reply(404, str(problem))
        return reply(200, json.dumps(film), "application/json")

    def film(self, name: str) -> dict[str, Any]:
        """Return `contest.film` of an attempt in `history`; without a name: of a model of a hand."""
        if not name:
            return contest.film(*contest.example(self.session.setup))
        choice("film", name, [entry["name"] for entry in self.session.history])  # no other file
        return contest.film(*contest.again(attempts.read(self.session.folder / f"{name}.json")))

    async def serve_page(self, page: server.ServerConnection) -> None:
        """Exchange messages with a page until it disconnects or sends an invalid message, or messages too fast."""

        def send(message: dict[str, Any]) -> None:
            server.broadcast([page], json.dumps(message))

        why, allowance, last = "the page was closed", RATE, self.now()
        self.session.join(send)
        try:
            while True:
                text, before, last = await page.recv(), last, self.now()
                allowance = min(allowance + RATE * (last - before), RATE) - 1.0
                if allowance < 0.0:
                    raise ValueError(f"more than {RATE:g} messages a second")
                self.session.handle(send, json.loads(text))
        except (json.JSONDecodeError, UnicodeDecodeError, RecursionError):
            why = "a message must be JSON"
        except ValueError as problem:
            why = str(problem).partition(", got ")[0][:120]  # leave out text that the page sent
        except ConnectionClosed as gone:
            why = clock.STOPPED if gone.sent and gone.sent.code == RESTART else why
        finally:
            self.session.leave(send, why)
        await page.close(1008, why)


async def _serve(session: Session, listening: socket.socket, ready: Callable[[str], None]) -> None:
    site = Site(session, secrets.token_urlsafe(16), listening.getsockname()[1])
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    running = await server.serve(
        site.serve_page, sock=listening, process_request=site.answer, server_header=None, compression=None,
        max_size=MESSAGE_BYTES, open_timeout=FILM_LIMIT, close_timeout=1.0, ping_interval=5.0, ping_timeout=10.0,
    )  # fmt: skip
    try:
        asyncio.get_running_loop().add_reader(session.pipe.fileno(), session.listen)
        ready(f"http://{HOST}:{site.port}/{site.token}/")
        await running.wait_closed()
    finally:
        running.close(code=RESTART)
        await running.wait_closed()


def serve(session: Session, port: int, ready: Callable[[str], None]) -> None:
    """Call `ready` with the address, then serve until interrupted. ValueError: the port is in use or out of range."""
    number("port", port, "-", at_least=0, at_most=65535)
    try:
        listening = socket.create_server((HOST, port))
    except OSError as problem:
        raise ValueError(f"port must be free, or 0 for any free port, got {port}: {problem}") from None
    asyncio.run(_serve(session, listening, ready))
