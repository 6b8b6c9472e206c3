"""The server of the page: local only, open to anyone with the address, with limits on requests and messages."""

import asyncio
import secrets
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from experiments.lab import player
from experiments.play.clock import STOPPED
from experiments.play.session import Session
from impact_gym.validation import number

HERE, LAB = Path(__file__).parent, Path(__file__).parents[1] / "lab"
SCRIPTS = tuple(HERE / name for name in ("stage.js", "stick.js", "settings.js", "chart.js", "play.js"))
HOST = "127.0.0.1"
MAX_CLIENTS, MESSAGE_BYTES, RATE = 16, 512, 250.0  # pages, bytes, messages a second
TIME_LIMIT = 5.0  # s, for a page that does not read and a connection without a request
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Resource-Policy": "same-origin",
}  # fmt: skip


class Connection(H11Protocol):
    """A connection that is closed after TIME_LIMIT without a request, or as the oldest of more than 256 without one."""

    waiting: ClassVar = deque["Connection"](maxlen=256)

    def connection_made(self, transport: Any) -> None:
        """Start the time limit."""
        super().connection_made(transport)
        self.loop.call_later(TIME_LIMIT, self.leave)
        if len(self.waiting) == self.waiting.maxlen:
            self.waiting[0].leave()
        self.waiting.append(self)

    def leave(self) -> None:
        """Close, unless a request has arrived."""
        if self.cycle is None and self in self.connections:
            self.transport.abort()


class Client:
    """A connected page: it receives messages in order, as fast as it reads them; of waiting frames only the newest."""

    def __init__(self, socket: WebSocket) -> None:
        self.socket, self._queue, self._has_messages = socket, list[dict[str, Any]](), asyncio.Event()
        self._allowance, self._last_message = RATE, time.monotonic()

    def enqueue(self, message: dict[str, Any]) -> None:
        """Queue a message; a frame replaces a frame that still waits."""
        if message["kind"] == "frame" and self._queue and self._queue[-1]["kind"] == "frame":
            self._queue.pop()
        self._queue.append(message)
        self._has_messages.set()

    async def send(self) -> None:
        """Send queued messages until the page disconnects or does not read."""
        with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
            while await self._has_messages.wait():
                self._has_messages.clear()
                while self._queue:
                    await asyncio.wait_for(self.socket.send_json(self._queue.pop(0)), TIME_LIMIT)

    async def receive(self) -> Any:
        """Return the next message of the page.

        Raises:
            ValueError: too many messages, or no JSON.
            WebSocketDisconnect: the page has disconnected.
        """
        try:
            message = await self.socket.receive_json()
        except (KeyError, ValueError, RecursionError):  # KeyError: bytes
            raise ValueError("a message must be JSON") from None
        before, self._last_message = self._last_message, time.monotonic()
        self._allowance = min(self._allowance + RATE * (self._last_message - before), RATE) - 1.0
        if self._allowance < 0.0:
            raise ValueError(f"more than {RATE:g} messages a second")
        return message


def foreign(scope: Any, token: str, port: int) -> str | None:
    """Return why a request is not from our page: another host (DNS rebinding), origin or token; None if it is."""
    hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
    host, origin = map(Headers(scope=scope).get, ("host", "origin"))
    if host not in hosts:
        return "another host"
    if origin not in {f"http://{host}" for host in hosts} and (origin is not None or scope["type"] == "websocket"):
        return "another origin"
    given = f"{scope['path']}/".split("/")[1].encode("utf-8", "replace")  # `OPTIONS *` has no path
    return None if secrets.compare_digest(given, token.encode()) else "another token"


def application(session: Session, token: str, port: int, ready: Callable[[str], None]) -> Callable[..., Any]:
    """Return the ASGI application below /token/, which answers our own page only."""
    styles = "\n".join([(LAB / "page.css").read_text(), player.style(), (HERE / "play.css").read_text()])
    program, page = player.script(*SCRIPTS), (HERE / "page.html.jinja").read_text()

    def fixed(content: str, kind: str) -> Callable[[Request], Response]:
        return lambda _: Response(content, 200, HEADERS, kind)

    def film(request: Request) -> Response:
        name, beside = request.path_params.get("name", ""), "/beside/" in request.url.path
        try:
            return JSONResponse(session.film(name, beside), 200, HEADERS)
        except (OSError, RuntimeError, ValueError, TypeError, LookupError) as problem:
            return Response(str(problem), 404, HEADERS, "text/plain")

    @asynccontextmanager
    async def life(_: Starlette) -> AsyncIterator[None]:
        asyncio.get_running_loop().add_reader(session.pipe.fileno(), session.listen)
        ready(f"http://{HOST}:{port}/{token}/")
        yield
        session.close()

    routes = [
        Route("/{token}/", fixed(page, "text/html")),
        Route("/{token}/play.css", fixed(styles, "text/css")),
        Route("/{token}/play.js", fixed(program, "text/javascript")),
        Route("/{token}/film", film), Route("/{token}/film/{name}", film), Route("/{token}/beside/{name}", film),
        WebSocketRoute("/{token}/ws", partial(_serve_page, session)),
    ]  # fmt: skip
    app = Starlette(routes=routes, lifespan=life)

    async def guarded(scope: Any, receive: Any, send: Any) -> None:
        why = None if scope["type"] == "lifespan" else foreign(scope, token, port)
        if why is None:
            return await app(scope, receive, send)
        session.refused[why] += 1
        await Response(f"{why}\n", 403, HEADERS, "text/plain")(scope, receive, send)

    return guarded


async def _serve_page(session: Session, page: WebSocket) -> None:
    """Serve a connected page until it disconnects or breaks a limit."""
    if len(session.clients) >= MAX_CLIENTS:
        session.refused["too many pages"] += 1
        await page.send_denial_response(Response(f"at most {MAX_CLIENTS} pages\n", 503, HEADERS, "text/plain"))
        return
    await page.accept()
    client, why = Client(page), "the page was closed"
    session.join(client)
    sender = asyncio.create_task(client.send())
    try:
        while not sender.done():
            session.handle(client, await client.receive())
        why = "the page did not read"
    except ValueError as problem:
        session.refused[why := str(problem).partition(", got ")[0][:120]] += 1  # without the page's own text
    except WebSocketDisconnect as gone:
        why = STOPPED if gone.code == 1012 else why  # code of a server that shuts down
    finally:
        session.leave(client, why)
        sender.cancel()
    with suppress(RuntimeError, TimeoutError, WebSocketDisconnect):  # already disconnected
        await asyncio.wait_for(page.close(1008, why), TIME_LIMIT)


def serve(session: Session, port: int, ready: Callable[[str], None]) -> None:
    """Serve until stopped; `ready` is called with the address once it answers.

    Raises:
        ValueError: the port is in use or out of range.
    """
    number("port", port, "-", at_least=0, at_most=65535)
    try:
        sock = socket.create_server((HOST, port))
    except OSError as problem:
        raise ValueError(f"port must be a free one, or 0 for any, got {port}: {problem}") from None
    token, port = secrets.token_urlsafe(16), sock.getsockname()[1]
    config = uvicorn.Config(
        application(session, token, port, ready), log_config=None, log_level="critical", access_log=False,
        server_header=False, date_header=False, http=Connection, h11_max_incomplete_event_size=8192,
        ws_max_size=MESSAGE_BYTES, ws_per_message_deflate=False, ws_ping_interval=5.0, ws_ping_timeout=10.0,
        timeout_graceful_shutdown=3,
    )  # fmt: skip
    with sock:
        uvicorn.Server(config).run(sockets=[sock])
