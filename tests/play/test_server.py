"""Who is listened to, and what becomes of a try when somebody goes, floods, or kills the server."""

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, closing, suppress

import pytest
from playing import ROOT, choices, closed, heard, play, say, served
from websockets.exceptions import ConnectionClosed, InvalidStatus


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
    for path in ("/", "/wrong/", "//", "/%ff/", f"/{'x' * 3000}/", "/favicon.ico"):
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
    (b"\x00\xff", 1007, "JSON"),
    ("{}", 1008, "one key"), ('{"v": NaN}', 1008, "v must be finite"), ('{"v": 1e999}', 1008, "v must be finite"),
    ('{"v": 1.01}', 1008, "v must be finite and at least -1 and at most 1"), ('{"v": "1"}', 1008, "v must be a number"),
    ('{"v": [1]}', 1008, "v must be a number"), ('{"begin": 3}', 1008, "begin must be a dict"),
    ('{"q": 1}', 1008, "message must be one of"),
    (json.dumps({"begin": choices(delay=9.0)}), 1008, "delay must be finite and at least 0 and at most 1 s"),
    (json.dumps({"begin": choices(delay=float("nan"))}), 1008, "delay must be finite"),
    (json.dumps({"begin": choices(setup="linear-blind")}), 1008, "setup must be one of"),
    (json.dumps({"begin": choices(assist="magic")}), 1008, "assist must be one of"),
    (json.dumps({"begin": choices(slow=0.0)}), 1008, "slow must be finite and at least 1"),
    ("[" * 400, 1007, "JSON"), ("x" * 5000, 1009, ""),
], ids=lambda value: str(value)[:24])  # fmt: skip
def test_what_cannot_be_understood_is_refused_with_a_reason(server, said, code, reason):
    with server.connect() as page:
        page.send(said)
        got = closed(page)
        assert got[0] == code
        assert reason in got[1]


def test_player_who_floods_is_refused_after_the_arm_has_stopped_and_the_try_is_kept(server):
    with server.connect() as page:
        say(page, begin=choices(assist="brake"))
        heard(page, "frame")
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
        play(page, assist="brake")
        before = server.memory()
        script = f"import asyncio, playing; print(asyncio.run(playing.flood({server.address!r}, 12.0)))"
        helpers = os.pathsep.join([str(ROOT), str(ROOT / "tests" / "helpers")])
        line = [sys.executable, "-c", script]
        clients = subprocess.Popen(line, env=os.environ | {"PYTHONPATH": helpers}, stdout=subprocess.PIPE, text=True)
        played = []
        while clients.poll() is None:
            played.append(play(page, assist="brake")["kind"])
        assert {*played} == {"ended"}
        assert int(clients.communicate()[0]) > 5000
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
        say(first, begin=choices())
        say(first, v=0.2)
        assert heard(second, "began")
        frame = heard(second, "frame")
        assert frame["to"][2] is None  # nobody is told where the object is
        say(second, take=1)
        assert heard(first, "role", player=False)
        assert heard(second, "role", player=True)
        assert heard(second, "ended")["entry"]["marks"] == ["interrupted: another tab took the stick"]
        assert play(second, assist="brake")["kind"] == "ended"


def test_page_that_goes_in_the_middle_leaves_a_try_that_is_marked(server):
    with server.connect() as page:
        say(page, begin=choices())
        say(page, v=0.3)
        heard(page, "frame")
    with server.connect() as page:
        assert heard(page, "ended")["entry"]["marks"] == ["interrupted: the page was closed"]
        assert server.tries()[-1].marks == ["interrupted: the page was closed"]
        assert play(page, assist="brake")["entry"]["marks"] == []


def test_pages_beyond_the_most_are_refused(server):
    with ExitStack() as pages:
        for _ in range(16):
            heard(pages.enter_context(server.connect()), "hello")
        with pytest.raises(InvalidStatus) as refusal, server.connect():
            pass
        assert refusal.value.response.status_code == 503


def test_commands_stop_and_the_arm_stops(server):
    with server.connect() as page:
        say(page, begin=choices(delay=0.0, jitter=0.0))
        say(page, v=0.5)
        frames = [heard(page, "frame") for _ in range(30)]
        moving = {frame["t"]: frame["to"][0] - frame["from"][0] for frame in frames}
        assert max(moving.values()) > 1e-3
        still = [way for time, way in moving.items() if time > 0.25 + 0.1]  # without a message, and time to brake
        assert len(still) > 5
        assert {*still} == {0.0}
        assert heard(page, "ended")["entry"]["missed"]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_server_that_is_stopped_in_the_middle_loses_nothing(how, tmp_path):
    folder = tmp_path / "tries"
    with served(folder) as server, server.connect() as page:
        play(page, assist="brake")
        say(page, begin=choices())
        for _ in range(20):
            heard(page, "frame")
            say(page, v=0.4)
        clock = server.clock
        code, said = server.end(how)
        assert code == {signal.SIGKILL: -9, signal.SIGINT: 130, signal.SIGTERM: -15}[how]
        assert "Traceback" not in said
        while os.path.exists(f"/proc/{clock}"):
            time.sleep(0.05)
        first, second = server.tries()
        assert first.counts
        assert second.marks == ["interrupted: the server was stopped"]
        assert max(second.operator["velocity"]) > 0.1
    with served(folder) as server, server.connect() as page:
        assert [each["marks"] for each in heard(page, "hello")["tries"]] == [first.marks, second.marks]


def test_clock_that_is_killed_leaves_a_journal_of_which_the_next_server_makes_a_try(tmp_path):
    folder = tmp_path / "tries"
    with served(folder) as server, server.connect() as page:
        say(page, begin=choices())
        for _ in range(20):
            heard(page, "frame")
            say(page, v=0.4)
        os.kill(server.clock, signal.SIGKILL)
        assert "the clock has stopped" in heard(page, "failed")["text"]
        assert server.tries() == []
    with served(folder) as server:
        (this,) = server.tries()
        assert this.marks == ["interrupted: the server was killed"]
        assert not [*folder.glob("*.journal")]


def command(folder, *words):
    line = [sys.executable, "-m", "experiments.command", "play", "--no-open", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True, timeout=60, check=False)


def test_bad_arguments_are_refused_in_one_line(tmp_path):
    (tmp_path / "mine.toml").write_text("[environment]\ntool_mass = 0.2\n")
    teleop = (
        (ROOT / "agents" / "setups" / "teleop-rigid.toml")
        .read_text()
        .replace("horizon =", "control_period = 0.01\nhorizon =")
    )
    (tmp_path / "fast.toml").write_text(teleop)
    (tmp_path / "plan.toml").write_text('title = "a"\nsetup = "teleop-spring"\nsmallest = 0.01\nconsent = "b"\n')
    (tmp_path / "tries").mkdir()
    (tmp_path / "tries" / "a.json").write_text("{}")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        for words, message in (
            (("--port", str(port)), f"port must be a free one from 0 (any) to 65535, got {port}"),
            (("--port", "99999"), "port must be a free one"),
            (("no-such",), "no set-up 'no-such'"),
            (("linear-blind",), "has no operator: add operator = "),
            (("mine.toml",), "has no operator: add operator = "),
            (("fast.toml",), "control_period must be 0.016 s to be played, got 0.01 s"),
            (("--assist", "magic"), "assist must be one of none, brake, limit, policy, rule, got 'magic'"),
            (("--plan", "plan.toml"), "outcome must be fixed before anybody plays"),
            (("--plan", "none.toml"), "none.toml is not read as TOML"),
            (("--scripted", "3"), "scripted and report need a plan"),
            (("--out", "tries"), "a.json is not read as a try"),
        ):  # fmt: skip
            done = command(tmp_path, *words)
            assert done.returncode == 1, words
            (line,) = done.stderr.splitlines()
            assert line.startswith("impact-gym play: ")
            assert message in line


def test_without_a_display_the_address_is_to_be_opened_by_hand(tmp_path):
    environment = {name: value for name, value in os.environ.items() if "DISPLAY" not in name} | {
        "PYTHONPATH": str(ROOT)
    }
    line = [sys.executable, "-m", "experiments.command", "play", "--port", "0"]
    process = subprocess.Popen(line, cwd=tmp_path, env=environment, text=True, stdout=subprocess.PIPE)
    assert process.stdout.readline().startswith("http://127.0.0.1:")
    assert process.stdout.readline() == "no browser could be opened here: open the address above\n"
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert process.returncode == 130
