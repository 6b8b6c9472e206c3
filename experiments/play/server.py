"""The server of the page: on this machine alone, for whoever has the address, with limits on what it accepts."""

import asyncio
import json
import secrets
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import uvicorn
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from experiments.lab import player
from experiments.play import contest
from experiments.play.clock import STOPPED
from experiments.play.session import Session

HERE, LAB = Path(__file__).parent, Path(__file__).parents[1] / "lab"
SCRIPTS = tuple(HERE / name for name in ("stage.js", "stick.js", "chart.js", "play.js"))
HOST = "127.0.0.1"
MOST_SEATS, MESSAGE_BYTES, RATE = 16, 512, 250.0  # pages, bytes, messages a second
RESTART = 1012  # code of a server that ends
PATIENCE = 5.0  # s, for a page that does not read
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff", "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Resource-Policy": "same-origin",
}  # fmt: skip


class Refused(Exception):  # noqa: N818  # it is an answer, not a fault
    """A page is not listened to any longer: a code of WebSocket's, and why."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code, self.why = code, why[:120]


class Seat:
    """A page that is connected: it gets what there is in order, as fast as it reads; of frames only the newest."""

    def __init__(self, socket: WebSocket) -> None:
        self.socket, self._waiting, self._news = socket, list[dict[str, Any]](), asyncio.Event()
        self._allowance, self._heard = RATE, time.monotonic()

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message; a frame takes the place of one that has not gone yet."""
        if message["kind"] == "frame" and self._waiting and self._waiting[-1]["kind"] == "frame":
            self._waiting.pop()
        self._waiting.append(message)
        self._news.set()

    async def send(self) -> None:
        """Send what there is, until the page goes or does not read."""
        with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
            while await self._news.wait():
                self._news.clear()
                while self._waiting:
                    text = json.dumps(self._waiting.pop(0), separators=(",", ":"))
                    await asyncio.wait_for(self.socket.send_text(text), PATIENCE)

    async def hear(self) -> dict[str, Any]:
        """Return what the page says next.

        Raises:
            Refused: it says too much at once, or too often, or nothing that can be understood.
            WebSocketDisconnect: it has gone.
        """
        message = await self.socket.receive()
        if message["type"] != "websocket.receive":
            raise WebSocketDisconnect(message.get("code", 1006))
        now = time.monotonic()
        self._allowance = min(self._allowance + RATE * (now - self._heard), RATE) - 1.0
        self._heard = now
        if self._allowance < 0.0:
            raise Refused(1008, f"more than {RATE:g} messages a second")
        try:
            said = json.loads(message.get("text") or "")
        except (ValueError, RecursionError):
            raise Refused(1007, "a message must be JSON") from None
        if not isinstance(said, dict):
            raise Refused(1007, "a message must be an object")
        return said


class Guard:
    """Refuses what does not come from our own page: another host (DNS rebinding), another origin, another token."""

    def __init__(self, app: Any, session: Session, token: str, port: int) -> None:
        self.app, self.session, self.token = app, session, token
        self.hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve a request, or refuse it with a reason."""
        why = self._wrong(scope) if scope["type"] in ("http", "websocket") else None
        if why is None:
            await self.app(scope, receive, send)
            return
        self.session.refused[why] += 1
        await Response(f"{why}\n", 403, HEADERS, "text/plain")(scope, receive, send)

    def _wrong(self, scope: Any) -> str | None:
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        if headers.get(b"host") not in self.hosts:
            return "another host"
        origin = headers.get(b"origin")
        if origin is None and scope["type"] == "websocket":
            return "no origin"
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return "another origin"
        given = scope["path"].split("/")[1].encode("utf-8", "replace")
        return None if secrets.compare_digest(given, self.token.encode()) else "another token"


def application(session: Session, token: str, port: int, ready: Callable[[], None]) -> Guard:
    """Return what is served below /token/."""
    templates = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
    styles = "\n".join([(LAB / "page.css").read_text(), player.style(), (HERE / "play.css").read_text()])
    program, page = player.script(*SCRIPTS), templates.get_template("page.html.jinja").render()

    def fixed(content: str, kind: str) -> Callable[[Request], Response]:
        return lambda _: Response(content, 200, HEADERS, kind)

    async def film(request: Request) -> Response:
        try:
            html = await asyncio.to_thread(session.film, request.path_params.get("name", ""))
        except (OSError, RuntimeError, ValueError) as problem:
            return Response(str(problem), 404, HEADERS, "text/plain")
        return Response(html, 200, HEADERS, "text/html")

    async def reference(_: Request) -> Response:
        return JSONResponse(await asyncio.to_thread(contest.reference, session.setup), 200, HEADERS)

    async def connected(page: WebSocket) -> None:
        with suppress(RuntimeError, TimeoutError, WebSocketDisconnect):  # it has gone already
            await _serve_page(session, page)

    @asynccontextmanager
    async def life(_: Starlette) -> AsyncIterator[None]:
        session.attach(loop := asyncio.get_running_loop())
        ready()
        yield
        await session.detach(loop)

    routes = [
        Route("/{token}/", fixed(page, "text/html")),
        Route("/{token}/play.css", fixed(styles, "text/css")),
        Route("/{token}/play.js", fixed(program, "text/javascript")),
        Route("/{token}/film", film), Route("/{token}/film/{name}", film), Route("/{token}/reference", reference),
        WebSocketRoute("/{token}/ws", connected),
    ]  # fmt: skip
    return Guard(Starlette(routes=routes, lifespan=life), session, token, port)


async def _serve_page(session: Session, page: WebSocket) -> None:
    """Serve a page that is connected until it goes, or is refused."""
    if len(session.seats) >= MOST_SEATS:
        session.refused["too many pages"] += 1
        await page.send_denial_response(Response(f"at most {MOST_SEATS} pages\n", 503, HEADERS, "text/plain"))
        return
    await page.accept()
    seat, why = Seat(page), "the page was closed"
    session.sit(seat)
    sender = asyncio.create_task(seat.send())
    try:
        while not sender.done():
            session.hear(seat, await seat.hear())
        why = "the page did not read"
    except (Refused, ValueError) as problem:
        refused = problem if isinstance(problem, Refused) else Refused(1008, str(problem))
        why = refused.why
        session.refused[why] += 1
        session.leave(seat, why)  # the arm stops first
        await asyncio.wait_for(page.close(refused.code, why), PATIENCE)
    except WebSocketDisconnect as gone:
        why = STOPPED if gone.code == RESTART else why
    finally:
        session.leave(seat, why)
        sender.cancel()


def listening(port: int) -> socket.socket:
    """Return a socket at a port of this machine; 0 takes a free one.

    Raises:
        ValueError: the port is in use, or none.
    """
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((HOST, port))
    except (OSError, OverflowError) as problem:
        sock.close()
        raise ValueError(f"port must be a free one from 0 (any) to 65535, got {port}: {problem}") from None
    return sock


def serve(session: Session, port: int, ready: Callable[[str], None]) -> None:
    """Serve until stopped; `ready` gets the address once a browser may open it."""
    sock, token = listening(port), secrets.token_urlsafe(16)
    port = sock.getsockname()[1]
    address = f"http://{HOST}:{port}/{token}/"
    app = application(session, token, port, lambda: ready(address))
    config = uvicorn.Config(
        app, log_config=None, log_level="critical", access_log=False, server_header=False, date_header=False,
        limit_concurrency=4 * MOST_SEATS, h11_max_incomplete_event_size=8192, ws_max_size=MESSAGE_BYTES,
        ws_per_message_deflate=False, ws_ping_interval=5.0, ws_ping_timeout=10.0, timeout_graceful_shutdown=3,
    )  # fmt: skip
    with sock:
        sock.listen(64)
        uvicorn.Server(config).run(sockets=[sock])
