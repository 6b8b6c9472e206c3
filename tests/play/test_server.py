"""Who is listened to, and what becomes of a try when somebody goes, floods, or kills the server."""

import asyncio
import http.client
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, closing, suppress

import pytest
from playing import ROOT, begin, choices, closed, flood, heard, play, say, served
from websockets.exceptions import ConnectionClosed, InvalidStatus

from experiments.play import __main__ as command
from experiments.play.live import recover
from experiments.play.server import listening


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("play") / "tries") as running:
        yield running


def answer(server, path=None, **headers):
    """Return status and headers of an answer, asked for with any headers."""
    with closing(http.client.HTTPConnection(server.origin.removeprefix("http://"))) as asked:
        asked.putrequest("GET", path or server.address.removeprefix(server.origin), skip_host="Host" in headers)
        for name, value in headers.items():
            asked.putheader(name, value)
        asked.endheaders()
        reply = asked.getresponse()
        reply.read()
        return reply.status, reply.headers


def test_only_our_own_page_is_answered(server):
    port = server.origin.rpartition(":")[2]
    assert answer(server)[0] == 200
    assert answer(server, Host=f"localhost:{port}", Origin=f"http://localhost:{port}")[0] == 200
    assert answer(server, Host="evil.example")[0] == 403  # a name that was bound to 127.0.0.1
    assert answer(server, Host=f"evil.example:{port}")[0] == 403
    assert answer(server, Origin="http://evil.example")[0] == 403
    token = server.address.split("/")[3]
    half = len(token) // 2
    near = (f"/{part}/" for part in (token[:half], token[half:], token[:half] + "x" * half, "x" * half + token[half:]))
    for path in ("/", "/wrong/", "//", "/%ff/", f"/{'x' * 3000}/", "/favicon.ico", *near):
        assert answer(server, path)[0] == 403
    assert answer(server, server.address.removeprefix(server.origin) + "film/..%2f..%2fetc")[0] == 404
    for wrong in ("http://evil.example", "null", server.origin + "0", server.origin.replace("http", "https"), None):
        with pytest.raises(InvalidStatus) as refusal, server.connect(origin=wrong):
            pass
        assert refusal.value.response.status_code == 403
    policy = answer(server)[1]["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


def test_socket_listens_on_this_machine_alone(server):
    port = int(server.origin.rpartition(":")[2])
    with open(f"/proc/{server.process.pid}/net/tcp") as table:
        listening = [line.split()[1] for line in table if line.split()[3] == "0A"]
    assert f"0100007F:{port:04X}" in listening
    assert f"00000000:{port:04X}" not in listening


@pytest.mark.parametrize(("said", "code", "reason"), [
    ("rubbish", 1007, "a message must be JSON"), ("[1]", 1007, "a message must be an object"),
    (b"\x00\xff", 1007, "JSON"), ("[" * 400, 1007, "JSON"), ("x" * 5000, 1009, ""),
    ("{}", 1008, "one key"), ('{"v": NaN}', 1008, "v must be finite"), ('{"v": 1e999}', 1008, "v must be finite"),
    ('{"v": 1.01}', 1008, "v must be finite and at least -1 and at most 1"), ('{"v": "1"}', 1008, "v must be a number"),
    ('{"v": [1]}', 1008, "v must be a number"), ('{"begin": 3}', 1008, "begin must be a dict"),
    ('{"q": 1}', 1008, "message must be one of"),
    ({"delay": 9.0}, 1008, "delay must be finite and at least 0 and at most 1 s"),
    ({"delay": float("nan")}, 1008, "delay must be finite"), ({"setup": "linear-blind"}, 1008, "setup must be one of"),
    ({"assist": "magic"}, 1008, "assist must be one of"), ({"slow": 0.0}, 1008, "slow must be finite and at least 1"),
    ({"seen": 1}, 1008, "seen"),
], ids=lambda value: str(value)[:24])  # fmt: skip
def test_what_cannot_be_understood_is_refused_with_a_reason(server, said, code, reason):
    with server.connect() as page:
        page.send(json.dumps({"begin": choices(server, **said)}) if isinstance(said, dict) else said)
        got = closed(page)
        assert got[0] == code
        assert reason in got[1]


def test_player_who_floods_is_refused_after_the_arm_has_stopped_and_the_try_is_kept(server):
    with server.connect() as page:
        begin(server, page)
        with suppress(ConnectionClosed):
            for _ in range(3000):
                say(page, v=0.5)
        assert closed(page) == (1008, "more than 250 messages a second")
    with server.connect() as page:
        heard(page, "ended")
        kept = server.tries()
        assert kept[-1].marks == ["interrupted: more than 250 messages a second"]
        assert kept[-1].operator["velocity"][-1] == 0.0


@pytest.mark.storm
def test_flood_of_fifty_is_refused_with_reasons_and_leaves_the_player_alone(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        play(server, page)
        before, played = server.memory(), []
        clients = threading.Thread(target=asyncio.run, args=(flood(server, 12.0),))
        clients.start()
        while clients.is_alive():
            played.append(play(server, page)["kind"])
        assert {*played} == {"ended"}
        assert server.memory() < before + 40e6
        assert len(server.tries()) == 1 + len(played)
        assert not any("interrupted" in mark for this in server.tries() for mark in this.marks)
        _, said = server.end()
        for reason in ("more than 250 messages a second", "a message must be JSON", "too many pages"):
            assert reason in said
        assert "Traceback" not in said


def test_second_page_is_told_so_watches_and_may_take_the_stick(server):
    with server.connect() as first, server.connect() as second:
        assert heard(first, "role", others=1)["player"]
        assert not heard(second, "role")["player"]
        say(second, v=1.0)  # who watches has no stick
        begin(server, first)
        say(first, v=0.2)
        assert heard(second, "began")
        frame = heard(second, "frame")
        assert frame["to"][2] is None  # nobody is told where the object is
        say(second, take=1)
        assert heard(first, "role", player=False)
        assert heard(second, "role", player=True)
        assert heard(second, "ended")["entry"]["marks"] == ["interrupted: another tab took the stick"]
        assert play(server, second)["kind"] == "ended"


def test_pages_beyond_the_most_are_refused(server):
    with ExitStack() as pages:
        for _ in range(16):
            heard(pages.enter_context(server.connect()), "hello")
        with pytest.raises(InvalidStatus) as refusal, server.connect():
            pass
        assert refusal.value.response.status_code == 503


def test_client_that_reads_slowly_holds_nobody_up(server):
    with server.connect() as page, server.connect(max_queue=1):
        heard(page, "role")
        say(page, take=1)
        begin(server, page)
        say(page, done=1)
        assert heard(page, "ended")


def test_film_of_a_try_is_given_by_its_name(server):
    with server.connect() as page:
        name = play(server, page)["entry"]["name"]
    where = server.address.removeprefix(server.origin) + "film"
    assert [answer(server, f"{where}/{each}")[0] for each in (name, "20200101-000000-000000")] == [200, 404]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_server_that_is_stopped_in_the_middle_loses_nothing(how, tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        begin(server, page)
        for _ in range(20):
            heard(page, "frame")
            say(page, v=0.4)
        clock = server.clock
        code, said = server.end(how)
        assert code == {signal.SIGKILL: -9, signal.SIGINT: 130, signal.SIGTERM: -15}[how]
        assert "Traceback" not in said
        while os.path.exists(f"/proc/{clock}"):
            time.sleep(0.05)
        (this,) = server.tries()
        assert this.marks[0] == "interrupted: the server was stopped"
        assert max(this.operator["velocity"]) > 0.1


def test_clock_that_is_killed_leaves_a_journal_of_which_a_try_is_made(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        begin(server, page)
        for _ in range(20):
            heard(page, "frame")
            say(page, v=0.4)
        os.kill(server.clock, signal.SIGKILL)
        assert "the clock has stopped" in heard(page, "failed")["text"]
        assert server.tries() == []
    recover(server.folder)
    (this,) = server.tries()
    assert this.marks == ["interrupted: the server was killed"]
    assert max(this.operator["velocity"]) > 0.1
    assert not [*server.folder.glob("*.journal")]


@pytest.mark.parametrize(("options", "message"), [
    ({"setup": "no-such"}, "no set-up 'no-such'"),
    ({"setup": "linear-blind"}, "has no operator: add operator = "),
    ({"setup": "fast.toml"}, "control_period must be 0.016 s to be played, got 0.01 s"),
    ({"assist": "magic"}, "assist must be one of none, brake, limit, policy, rule, got 'magic'"),
    ({"out": ROOT / "agents" / "tuned"}, "is not read as a try"),
], ids=str)  # fmt: skip
def test_bad_arguments_are_refused_in_one_line(options, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    teleop = (ROOT / "agents" / "setups" / "teleop-rigid.toml").read_text()
    (tmp_path / "fast.toml").write_text(teleop.replace("horizon =", "control_period = 0.01\nhorizon ="))
    with pytest.raises(ValueError, match=f"^.*{re.escape(message)}.*$"):  # one line, as `.` is no end of a line
        command.work(command.Play(**{"open": False, "out": tmp_path / "tries", **options}))


def test_port_that_is_taken_is_refused_in_one_line_and_without_a_display_the_address_is_to_be_opened_by_hand(tmp_path):
    environment = {name: value for name, value in os.environ.items() if "DISPLAY" not in name}
    line = [sys.executable, "-m", "experiments.play", "--port"]
    how = {"cwd": tmp_path, "env": environment | {"PYTHONPATH": str(ROOT)}, "text": True}
    with subprocess.Popen([*line, "0"], **how, stdout=subprocess.PIPE) as process:
        address = process.stdout.readline()
        assert address.startswith("http://127.0.0.1:")
        assert process.stdout.readline() == "no browser could be opened here: open the address above\n"
        port = address.split(":")[2].split("/")[0]
        second = subprocess.run([*line, port], **how, capture_output=True, timeout=60, check=False)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
        assert (second.returncode, process.returncode) == (1, 130)
    assert re.fullmatch(f"impact-gym play: port must be .* from 0 \\(any\\) to 65535, got {port}.*\n", second.stderr)
    with pytest.raises(ValueError, match=r"port must be .* to 65535, got 99999"):
        listening(99999)
