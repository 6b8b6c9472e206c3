"""Which requests and messages the server answers, and what it keeps of a try when a page floods it, or it is killed."""

import asyncio
import json
import signal
import socket
from unittest import mock

import pytest
from play_client import Page, Simulated, choices, near_setup, pushed, served
from refusal import refused
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Close
from websockets.http11 import Request
from websockets.protocol import State
from websockets.sync.client import connect

from experiments.play import attempts
from experiments.play.server import RATE, Site, serve

OURS = {"Host": "localhost:80", "Origin": "http://localhost:80"}


def test_only_our_own_page_is_answered(world):
    def asked(path="/token/", method="GET", **headers):
        """The answer's status; by default to a request with the headers of our own page."""
        given = Headers((name, value) for name, value in (OURS | headers).items() if value is not None)
        answer = asyncio.run(site.answer(None, Request(path, given, method)))
        assert answer is None or "default-src 'none'; script-src 'self'" in answer.headers["content-security-policy"]
        return answer.status_code if answer else 101

    site, ws = Site(world.session, "token", 80), {"path": "/token/ws", "Upgrade": "websocket"}
    for own in ({}, {"Host": "127.0.0.1:80"}, {"Origin": "http://127.0.0.1:80"}, {"Origin": None}):
        assert asked(**own) == 200
    for host in ("evil.example", "evil.example:80", "localhost:81", "localhost", None):  # a name bound to 127.0.0.1
        assert asked(Host=host) == 403
    for origin in ("http://evil.example", "null", "http://localhost:800", "https://localhost:80", "http://localhost"):
        assert asked(Origin=origin) == asked("/token/ws", Origin=origin) == 403
    assert (asked(**ws), asked(**ws, Origin=None)) == (101, 403)
    for path in ("/", "/wrong/", "//", "/toke/", "/token1/", "/xtoken/", "/favicon.ico", "*", "?/token/", "/%ff/"):
        assert asked(path) == 403
    for path in ("other", "play.js/more", "film/..%2f..%2fetc", "film/2020", "film/%00", f"film/{'x' * 7000}"):
        assert asked(f"/token/{path}") == 404
    assert [asked(method=method) for method in ("POST", "HEAD", "TRACE")] == [405] * 3


def test_films_are_of_the_tries_in_the_folder_alone(world):
    page, site = Page(world), Site(world.session, "token", 80)
    world.play(page, page.push)
    own = page.got("ended")[0]["entry"]["name"]
    elsewhere = attempts.write(world.folder.parent / "elsewhere.json", attempts.read(world.folder / f"{own}.json"))
    for name, says in (
        (f"..%2f{elsewhere.stem}", "film must be one of"),
        (own, '"You":'),
        ("", '"A late hand alone":'),
    ):
        answer = asyncio.run(site.answer(None, Request(f"/token/film/{name}", Headers(OURS))))
        assert (says in answer.body.decode(), answer.status_code) == (True, 404 if "%2f" in name else 200)


def talk(world, *messages, pause=0.0, gone=None):
    """Let a page send messages, one each `pause` (s), and then end as `gone` says; return why the server closes it."""

    def received():
        for each in (*messages, ConnectionClosed(None, gone)):
            world.now += pause
            yield each if isinstance(each, str | bytes | Exception) else json.dumps(each)

    page = mock.AsyncMock(**{"recv.side_effect": received(), "protocol.state": State.CLOSING})  # nothing is sent to it
    asyncio.run(Site(world.session, "token", 80, world.time).serve_page(page))
    code, reason = page.close.await_args.args
    assert (code, world.session.page) == (1008, None)
    return reason


INVALID = [
    ("rubbish", "a message must be JSON"), (b"\x00\xff", "JSON"), ("[" * 400, "JSON"), ("[1]", "must be a dict"),
    ('{"v": NaN}', "v must be finite"), ('{"v": 1.01}', "at most 1"), ('{"v": 1, "done": 1}', "one key"),
    ('{"begin": 3}', "begin must be a dict"), ({"distance": 0.21}, "at most 0.2 m"), ({"seen": 1}, "seen"),
    ({"delay": 9.0}, "at most 1 s"), ({"setup": "rigid"}, "setup must be one"), ({"slow": 0.5}, "at least 1"),
]  # fmt: skip


def test_message_that_makes_no_sense_ends_the_connection(world):
    for said, reason in INVALID:
        assert reason in talk(world, {"begin": choices(world.setup) | said} if isinstance(said, dict) else said)
        assert (world.session.busy, world.clock.wanted.empty()) == (False, True)


@pytest.mark.parametrize(("why", "messages", "how"), [
    ("the page was closed", [{"v": 0.5}] * 3000, {"pause": 1.01 / RATE}), ("a message must have one key", [{}], {}),
    ("more than 250 messages a second", [{"v": 0.5}] * 3000, {"pause": 0.9 / RATE}),
    ("the server was stopped", [], {"gone": Close(1012, "")}),
])  # fmt: skip
def test_player_who_leaves_or_floods_stops_the_arm(world, why, messages, how):
    assert talk(world, {"begin": choices(world.setup)}, *messages, **how) == why
    stick = world.clock.stick
    assert (stick.marks, stick.at(world.now), stick.stopped_at) == ([f"interrupted: {why}"], 0.0, world.now)


def test_folder_has_one_server_and_keeps_files_that_are_no_tries(world):
    (world.folder / "b.json").write_text("{")
    good = attempts.write(world.folder / "good.json", pushed(lambda _: 0.5))
    (world.folder / "<b>.json").write_text(good.read_text())
    refused(lambda: Simulated(world.folder.parent), f"{world.folder} is being written by another process")
    world.session.close()
    session = Simulated(world.folder.parent).session
    assert ([entry["name"] for entry in session.history], len(session.left_out)) == (["good"], 2)
    assert len([*world.folder.glob("*.json")]) == 3
    with socket.create_server(("127.0.0.1", 0)) as taken:
        refused(lambda: serve(session, taken.getsockname()[1], print), "port must be free, or 0 for any")
    session.close()


@pytest.mark.parametrize(("how", "exit_code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_server_that_is_stopped_in_a_try_loses_nothing(how, exit_code, tmp_path):
    """It listens here alone, and to no foreign page."""
    with served(near_setup(tmp_path), tmp_path) as server, connect(server.socket, origin=server.origin) as page:
        with pytest.raises(ConnectionRefusedError):  # a socket that listens at all addresses would listen there, too
            socket.create_connection(("127.0.0.2", server.origin.rpartition(":")[2]))
        with pytest.raises(InvalidStatus, match="403"):
            connect(server.socket, origin="http://evil.example")
        page.send(json.dumps({"begin": choices(tmp_path / "near.toml")}))
        for _ in range(15):
            page.recv(timeout=60.0)
            page.send('{"v": 0.6}')
        code, said = server.end(how)
    assert (code, "Traceback" in said) == (exit_code, False)
    (this,) = attempts.of_persons(tmp_path, marked=True)
    assert this.marks[0] == "interrupted: the server was stopped"
    assert max(this.operator["velocity"]) > 0.1
