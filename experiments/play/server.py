"""The page's server answers only requests from this machine that have a secret token in the address."""

import asyncio
import json
import logging
import secrets
import socket
import time
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from websockets.asyncio import server
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from experiments.lab import player
from experiments.play import attempts, contest
from experiments.play.clock import STOPPED
from experiments.play.session import Session
from impact_gym.support.validation import number

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
            path = self.session.folder / f"{unquote(name)}.json"
            film = await asyncio.to_thread(lambda: contest.film(contest.again(attempts.read(path))))
        except (OSError, RuntimeError, ValueError, TypeError, LookupError) as problem:
            return reply(404, str(problem))
        return reply(200, json.dumps(film), "application/json")

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
            why = STOPPED if gone.sent and gone.sent.code == RESTART else why
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
