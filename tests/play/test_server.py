"""Which requests the server answers, and what it keeps of a try when a page leaves, floods it, or it is killed."""

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest
from play_client import ROOT, SETUP, closed, heard, say, served
from refusal import refused
from websockets.exceptions import ConnectionClosed, InvalidStatus

from experiments.play import __main__ as command


def answer(server, path=None, **headers):
    """Send a request with these headers; return status and headers of the answer."""
    with closing(http.client.HTTPConnection(server.origin.removeprefix("http://"))) as asked:
        asked.putrequest("GET", path or server.path, skip_host="Host" in headers)
        for name, value in headers.items():
            asked.putheader(name, value)
        asked.endheaders()
        reply = asked.getresponse()
        reply.read()
        return reply.status, reply.headers


def test_only_our_own_page_is_answered_and_on_this_machine_alone(server):
    port = server.origin.rpartition(":")[2]
    status, headers = answer(server)
    assert status == answer(server, Host=f"localhost:{port}", Origin=f"http://localhost:{port}")[0] == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    for host in ("evil.example", f"evil.example:{port}"):  # a name that was bound to 127.0.0.1
        assert answer(server, Host=host)[0] == 403
    assert answer(server, Origin="http://evil.example")[0] == 403
    token = server.address.split("/")[3]
    half = len(token) // 2
    near = (f"/{part}/" for part in (token[:half], token[half:], token[:half] + "x" * half, "x" * half + token[half:]))
    for path in ("/", "/wrong/", "//", "/%ff/", f"/{'x' * 3000}/", "/favicon.ico", *near):
        assert answer(server, path)[0] == 403
    for name in ("..%2f..%2fetc", "20200101-000000-000000"):
        assert answer(server, f"{server.path}film/{name}")[0] == 404
    for wrong in ("http://evil.example", "null", server.origin + "0", server.origin.replace("http", "https"), None):
        with pytest.raises(InvalidStatus) as refusal, server.connect(origin=wrong):
            pass
        assert refusal.value.response.status_code == 403
    with pytest.raises(ConnectionRefusedError):  # a socket that listens at all addresses would listen there, too
        socket.create_connection(("127.0.0.2", port))


@pytest.mark.parametrize(("said", "reason"), [
    ("rubbish", "a message must be JSON"), ("[1]", "message must be a dict"), (b"\x00\xff", "JSON"),
    ("[" * 400, "JSON"), ("{}", "one key"), ('{"v": NaN}', "v must be finite"), ('{"v": 1e999}', "v must be finite"),
    ('{"v": 1.01}', "v must be finite and at least -1 and at most 1"), ('{"v": "1"}', "v must be a number"),
    ('{"v": [1]}', "v must be a number"), ('{"begin": 3}', "begin must be a dict"), ('{"q": 1}', "must be one of"),
    ({"delay": 9.0}, "delay must be finite and at least 0 and at most 1 s"), ({"seen": 1}, "seen"),
    ({"delay": float("nan")}, "delay must be finite"), ({"setup": "linear-blind"}, "setup must be one of"),
    ({"assist": "magic"}, "assist must be one of"), ({"slow": 0.0}, "slow must be finite and at least 1"),
], ids=lambda value: str(value)[:24])  # fmt: skip
def test_what_cannot_be_understood_is_refused_with_a_reason(server, said, reason):
    with server.connect() as page:
        page.send(json.dumps({"begin": server.choices(**said)}) if isinstance(said, dict) else said)
        code, why = closed(page)
        assert code == 1008
        assert reason in why


def test_message_that_is_too_long_and_pages_beyond_the_most_are_refused(server):
    with ExitStack() as pages:
        for _ in range(16):
            heard(page := pages.enter_context(server.connect()), "hello")
        with pytest.raises(InvalidStatus) as refusal, server.connect():
            pass
        assert refusal.value.response.status_code == 503
        page.send("x" * 5000)
        assert closed(page)[0] == 1009


def test_player_who_floods_is_refused_after_the_arm_has_stopped_and_the_try_is_kept(server):
    with server.connect() as page:
        server.push(page, 1)
        with suppress(ConnectionClosed):
            for _ in range(3000):
                say(page, v=0.5)
        assert closed(page) == (1008, "more than 250 messages a second")
    with server.connect() as page:
        heard(page, "ended")
        this = server.tries()[-1]
        assert this.marks == ["interrupted: more than 250 messages a second"]
        assert this.operator["velocity"][-1] == 0.0


def test_second_page_is_told_so_watches_and_may_take_the_stick(server):
    with server.connect() as first, server.connect() as second, server.connect(max_queue=1):
        assert heard(first, "role", others=2)["player"]
        assert not heard(second, "role")["player"]
        say(second, v=1.0)  # who watches has no stick
        server.push(first, 1)
        assert heard(second, "began")
        assert heard(second, "frame")["to"][2] is None  # nobody is told where the object is
        say(second, take=1)
        assert heard(first, "role", player=False)
        assert heard(second, "role", player=True)
        assert heard(second, "ended")["entry"]["marks"] == ["interrupted: another tab took the stick"]
        name = server.push(second)["entry"]["name"]
        assert answer(server, f"{server.path}film/{name}")[0] == 200


@pytest.mark.parametrize(("how", "exit_code"), [(signal.SIGKILL, -9), (signal.SIGINT, 130), (signal.SIGTERM, -15)])
def test_server_that_is_stopped_in_the_middle_loses_nothing(how, exit_code, tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        server.push(page, 20)
        code, said = server.end(how)
        assert code == exit_code
        assert "Traceback" not in said
        (this,) = server.tries()
        assert this.marks[0] == "interrupted: the server was stopped"
        assert max(this.operator["velocity"]) > 0.1


def test_second_server_of_a_folder_is_refused_and_leaves_the_try_of_the_first(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        server.push(page, 5)
        mine = command.Play(str(server.setup), open=False, out=tmp_path / "tries", port=0)
        refused(lambda: command.work(mine), f"{tmp_path / 'tries'} is being written by another process")
        say(page, done=1)
        assert heard(page, "ended")["entry"]["marks"] == []


def test_files_of_which_no_try_can_be_made_are_kept_and_said_and_reach_no_page(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        name = server.push(page)["entry"]["name"]
    whole = (server.folder / f"{name}.json").read_text()
    kept = {"a.json": json.dumps(json.loads(whole) | {"marks": ["</script>"]}), "b.json": "{", "<b>.json": whole}
    for file, text in kept.items():
        (server.folder / file).write_text(text)
    with served(tmp_path / "tries", SETUP) as again, again.connect() as page:
        assert [entry["name"] for entry in heard(page, "hello")["tries"]] == [name]
        said = [again.process.stdout.readline() for _ in range(len(kept))]
        assert "Traceback" not in again.end()[1]
    for file in kept:
        assert (server.folder / file).exists()
        assert sum(f"/{file} " in line for line in said) == 1


@pytest.mark.parametrize(("line", "status"), [
    ("OPTIONS * HTTP/1.1", 403), ("GET http://{host}{path} HTTP/1.1", 403), ("TRACE {path} HTTP/1.1", 405),
    ("PRI * HTTP/2.0", None), ("CONNECT {host} HTTP/1.1", 403), ("POST {path} HTTP/1.1", 405), ("rubbish", None),
    ("GET {path}film/%00 HTTP/1.1", 404), ("GET {path}film/%ff%fe HTTP/1.1", 404), ("GET /{long} HTTP/1.1", 403),
    ("GET {path}film/{long} HTTP/1.1", 404), ("GET {path} HTTP/1.1\r\nX: {long}", 200), ("GET ?{path} HTTP/1.1", 403),
    ("GET {path}ws HTTP/1.1", 426), ("GET {path} HTTP/1.1\r\nHost: {host}", 403), ("HEAD {path} HTTP/1.1", 405),
])  # fmt: skip
def test_odd_request_has_a_proper_answer_and_none_if_it_is_no_request(server, line, status):
    host = server.origin.removeprefix("http://")
    asked = line.format(host=host, path=server.path, long="x" * 7000)
    with socket.create_connection(host.split(":")) as odd:
        odd.settimeout(10.0)
        odd.sendall(f"{asked}\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
        assert odd.recv(12) == (f"HTTP/1.1 {status}".encode() if status else b"")


def test_page_says_that_its_clock_was_killed(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        server.push(page, 1)
        pid = server.process.pid
        (clock,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        os.kill(int(clock), signal.SIGKILL)
        assert "the clock has stopped" in heard(page, "failed")["text"]


def test_port_that_is_taken_is_refused_in_one_line_and_without_a_display_the_address_is_to_be_opened_by_hand(tmp_path):
    environment = {name: value for name, value in os.environ.items() if "DISPLAY" not in name}
    line = [sys.executable, "-m", "experiments.play", f"--out={tmp_path / 'own'}", "--port"]
    how = {"cwd": tmp_path, "env": environment | {"PYTHONPATH": str(ROOT)}, "text": True, "stdout": subprocess.PIPE}
    with subprocess.Popen([*line, "0"], **how) as process:
        port = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/.*\n", process.stdout.readline())[1]
        assert process.stdout.readline() == "no browser could be opened here: open the address above\n"
        line[3] += "-other"
        second = subprocess.run([*line, port], **how, stderr=subprocess.PIPE, timeout=60, check=False)
        process.send_signal(signal.SIGINT)
    assert (second.returncode, process.returncode) == (1, 130)
    assert re.fullmatch(f"impact-gym play: port must be free, or 0 for any free port, got {port}.*\n", second.stderr)
