"""Which requests and messages the server answers, and what it keeps of a try when a page floods it, or it is killed."""

import asyncio
import json
import signal
import socket
from functools import partial
from types import SimpleNamespace

import pytest
from play_client import Page, choices, closed, pushed, served
from refusal import refused
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Close
from websockets.http11 import Request

from experiments.play import __main__ as command
from experiments.play import server as serving
from experiments.play import session, try_files
from experiments.play.server import RATE, Client, Site

OURS = {"Host": "localhost:80", "Origin": "http://localhost:80"}


def asked(site, path="/token/", method="GET", **headers):
    """Status, headers and body of the answer to a request; by default with the headers of our own page."""
    given = Headers((name, value) for name, value in (OURS | headers).items() if value is not None)
    answer = asyncio.run(site.answer(None, Request(path, given, method)))
    return (answer.status_code, answer.headers, answer.body.decode()) if answer else (101, {}, "")


def test_only_our_own_page_is_answered(world, monkeypatch):
    site = Site(world.session, "token", 80)
    status, headers, body = asked(site)
    assert (status, "default-src 'none'" in headers["content-security-policy"]) == (200, True)
    assert "unsafe" not in headers["content-security-policy"]
    assert int(headers["content-length"]) == len(body.encode())
    for own in ({"Host": "127.0.0.1:80"}, {"Origin": "http://127.0.0.1:80"}, {"Origin": None}):
        assert asked(site, **own)[0] == 200
    for host in ("evil.example", "evil.example:80", "localhost:81", "localhost", None):  # a name bound to 127.0.0.1
        assert asked(site, Host=host)[0] == 403
    for origin in ("http://evil.example", "null", "http://localhost:800", "https://localhost:80", "http://localhost"):
        assert asked(site, Origin=origin)[0] == asked(site, "/token/ws", Origin=origin)[0] == 403
    assert asked(site, "/token/ws", Upgrade="websocket")[0] == 101
    assert asked(site, "/token/ws", Upgrade="websocket", Origin=None)[0] == 403
    for path in ("/", "/wrong/", "//", "/toke/", "/token1/", "/xtoken/", "/favicon.ico", "*", "?/token/", "/%ff/"):
        assert asked(site, path)[0] == 403
    for path in ("other", "play.js/more", "film/..%2f..%2fetc", "film/2020", "film/%00", f"film/{'x' * 7000}"):
        assert asked(site, f"/token/{path}")[0] == 404
    assert [asked(site, method=method)[0] for method in ("POST", "HEAD", "TRACE")] == [405] * 3
    try_files.write(world.folder / "a b.json", this := pushed(lambda _: 0.5))
    monkeypatch.setattr(serving.contest, "again", vars)
    monkeypatch.setattr(serving.contest, "film", lambda found: {"of": found["result"]})
    assert json.loads(asked(site, "/token/film/a%20b")[2]) == {"of": this.result}
    assert "slow-motion" in asked(site, "/token/play.js")[2]
    world.session.clients = [None] * 16
    assert asked(site, "/token/ws", Upgrade="websocket")[0] == 503


class Socket:
    """A connection whose page sends these texts, and then ends as `gone` says; it keeps what comes."""

    def __init__(self, *texts, gone=None):
        self.texts, self.gone, self.got, self.closed = [*texts], gone, [], None

    async def recv(self):
        await asyncio.sleep(0)
        if not self.texts:
            raise ConnectionClosed(None, self.gone)
        return self.texts.pop(0)

    async def send(self, text):
        self.got.append(json.loads(text))

    async def close(self, *code_and_reason):
        self.closed = code_and_reason


def talk(world, *messages, **how):
    """Let a page of the world's server send messages; return its connection."""
    page = Socket(*(each if isinstance(each, str | bytes) else json.dumps(each) for each in messages), **how)
    asyncio.run(Site(world.session, "token", 80, world.time).serve_page(page))
    return page


@pytest.mark.parametrize(("said", "reason"), [
    ("rubbish", "a message must be JSON"), ("[1]", "message must be a dict"), (b"\x00\xff", "JSON"),
    ("[" * 400, "JSON"), ("{}", "one key"), ('{"v": NaN}', "v must be finite"), ('{"v": 1e999}', "v must be finite"),
    ('{"v": 1.01}', "v must be finite and at least -1 and at most 1"), ('{"v": "1"}', "v must be a number"),
    ('{"v": [1]}', "v must be a number"), ('{"begin": 3}', "begin must be a dict"), ('{"q": 1}', "must be one of"),
    ('{"v": 1, "done": 1}', "one key"), ({"distance": 0.21}, "distance must be finite and at least 0.1"),
    ({"delay": 9.0}, "delay must be finite and at least 0 and at most 1 s"), ({"seen": 1}, "seen"),
    ({"delay": float("nan")}, "delay must be finite"), ({"setup": "rigid"}, "setup must be one of"),
    ({"assist": "magic"}, "assist must be one of"), ({"slow": 0.5}, "slow must be finite and at least 1"),
], ids=lambda value: str(value)[:24])  # fmt: skip
def test_message_that_makes_no_sense_ends_the_connection(world, said, reason):
    page = talk(world, {"begin": choices(world.setup) | said} if isinstance(said, dict) else said)
    assert page.closed[0] == 1008
    assert reason in page.closed[1]
    assert (world.session.clients, world.session.busy, world.clock.wanted.empty()) == ([], False, True)


LEAVES = {  # what a player sends after the begin, how its connection ends, and why the arm stops
    "the page was closed": ([], None), "the server was stopped": ([], Close(1012, "")),
    "more than 250 messages a second": ([{"v": 0.5}] * 260, None), "a message must have one key": ([{}], None),
}  # fmt: skip


@pytest.mark.parametrize("why", LEAVES)
def test_player_who_leaves_or_floods_stops_the_arm(world, why):
    messages, gone = LEAVES[why]
    page = talk(world, {"begin": choices(world.setup)}, *messages, gone=gone)
    assert page.closed == (1008, why)
    stick = world.clock.stick
    assert (stick.marks, stick.at(world.now), stick.stopped_at) == ([f"interrupted: {why}"], 0.0, world.now)


def test_page_that_does_not_read_is_left(world, monkeypatch):
    monkeypatch.setattr(serving, "TIME_LIMIT", 0.01)
    page = Socket(*["{}"])

    async def wait(*_):
        await asyncio.sleep(60.0)

    async def recv():
        await asyncio.sleep(0.05)
        return '{"v": 0}'

    page.send, page.recv = wait, recv
    asyncio.run(Site(world.session, "token", 80).serve_page(page))
    assert page.closed == (1008, "the page did not read")


@pytest.mark.parametrize(("rate", "refused_after"), [(0.99 * RATE, None), (1.2 * RATE, 1500)])
def test_250_messages_a_second_are_allowed(world, rate, refused_after):
    """After a burst of as many; what is saved up in a pause is no more."""

    async def received():
        client = Client(Socket(*["1"] * 4000), world.time)
        world.now += 60.0
        for number in range(4000):
            try:
                await client.receive()
            except ValueError:
                return number
            world.now += 1.0 / rate
        return None

    assert asyncio.run(received()) == pytest.approx(refused_after, abs=6)


def test_page_that_reads_slowly_gets_the_newest_picture(world):
    async def sent():
        client = Client(page := Socket(), world.time)
        for number, kind in enumerate(["hello", "frame", "frame", "role", "frame", "frame", "ended"]):
            client.enqueue({"kind": kind, "n": number})
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(client.send(), 0.05)
        return [message["n"] for message in page.got]

    assert asyncio.run(sent()) == [0, 2, 3, 5, 6]


def test_page_is_told_that_the_clock_has_ended(world):
    def poll():
        raise EOFError

    async def listen():
        world.session.pipe = SimpleNamespace(poll=poll, fileno=lambda: 0, close=lambda: None)
        world.session.listen()

    page = Page(world)
    page.say(begin=choices(world.setup))
    asyncio.run(listen())
    assert "the clock has stopped" in page.got("failed")[0]["text"]
    assert not world.session.busy


def test_command_names_files_that_are_no_tries_and_its_address(world, monkeypatch, capsys):
    """They are kept, and reach no page; a second server of a folder is refused; a port may be taken."""
    name = try_files.write(world.folder / "good.json", pushed(lambda _: 0.5)).stem
    whole = (world.folder / "good.json").read_text()
    kept = {"a.json": json.dumps(json.loads(whole) | {"marks": ["</script>"]}), "b.json": "{", "<b>.json": whole}
    for file, text in kept.items():
        (world.folder / file).write_text(text)
    mine = command.Play(str(world.setup), open=True, out=world.folder, port=0)
    refused(lambda: command.work(mine), f"{world.folder} is being written by another process")
    world.session.close()
    shown, serve = [], serving.serve

    def serve_at_a_taken_port(played, port, ready):
        ready("http://here/")
        shown.extend(entry["name"] for entry in played.history)
        with socket.create_server(("127.0.0.1", 0)) as taken:
            serve(played, taken.getsockname()[1], ready)

    monkeypatch.setattr(session, "Session", partial(session.Session, start=lambda: (SimpleNamespace(close=int), int)))
    monkeypatch.setattr(serving, "serve", serve_at_a_taken_port)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    refused(lambda: command.work(mine), "port must be free, or 0 for any free port, got ")
    address, *left_out, by_hand = capsys.readouterr().out.splitlines()
    assert (address, by_hand) == ("http://here/", "no browser could be opened here: open the address above")
    assert shown == [name]
    for file in kept:
        assert (world.folder / file).exists()
        assert sum(f"/{file} " in line for line in left_out) == 1


@pytest.mark.parametrize(("line", "status"), [
    ("OPTIONS * HTTP/1.1", 403), ("GET http://{host}{path} HTTP/1.1", 403), ("TRACE {path} HTTP/1.1", 405),
    ("PRI * HTTP/2.0", None), ("CONNECT {host} HTTP/1.1", 403), ("POST {path} HTTP/1.1", 405), ("rubbish", None),
    ("GET {path}film/%00 HTTP/1.1", 404), ("GET {path}film/%ff%fe HTTP/1.1", 404), ("GET /{long} HTTP/1.1", 403),
    ("GET {path}film/{long} HTTP/1.1", 404), ("GET {path} HTTP/1.1\r\nX: {long}", 200), ("GET ?{path} HTTP/1.1", 403),
    ("GET {path}ws HTTP/1.1", 426), ("GET {path} HTTP/1.1\r\nHost: {host}", 403), ("HEAD {path} HTTP/1.1", 405),
])  # fmt: skip
def test_odd_request_has_a_proper_answer_or_none(server, line, status):
    host = server.origin.removeprefix("http://")
    with socket.create_connection(host.split(":")) as odd:
        odd.settimeout(60.0)
        asked = line.format(host=host, path=server.path, long="x" * 7000)
        odd.sendall(f"{asked}\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
        assert odd.recv(12) == (f"HTTP/1.1 {status}".encode() if status else b"")


def test_server_listens_here_alone_and_to_short_messages(server):
    with pytest.raises(ConnectionRefusedError):  # a socket that listens at all addresses would listen there, too
        socket.create_connection(("127.0.0.2", server.origin.rpartition(":")[2]))
    with pytest.raises(InvalidStatus) as refusal, server.connect(origin="http://evil.example"):
        pass
    assert refusal.value.response.status_code == 403
    with server.connect() as page:
        page.send("x" * 600)
        assert closed(page)[0] == 1009


@pytest.mark.parametrize(("how", "exit_code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_server_that_is_stopped_in_a_try_loses_nothing(how, exit_code, tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        server.push(page, 20)
        code, said = server.end(how)
    assert code == exit_code
    assert "Traceback" not in said
    (this,) = server.tries()
    assert this.marks[0] == "interrupted: the server was stopped"
    assert max(this.operator["velocity"]) > 0.1
