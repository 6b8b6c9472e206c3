"""Operators and channels that cannot be are refused, each in one line."""

import math

import pytest
from steered import ARM

import impact_gym as ig
from impact_gym.task import Task

REACH, DAYS = {"type": "Reach", "place_error": 0.0, "creep": 0.1}, [[0.0, 100.0], [16.0, 120.0]]


@pytest.mark.parametrize(("options", "message"), [
    ({"operator": {"type": "Pilot"}}, "operator must be a Replay or .*got"),
    ({"operator": {"type": "Replay", "time": [0, 1], "velocity": [0, 0.1], "length": 4.0}}, "at least the horizon, 8"),
    ({"operator": {"type": "Replay", "time": [0, 9], "velocity": [0, 0.1], "length": 8.0, "recording": (0, 3)}},
     "Replay.recording must be at most 2"),
    ({"operator": {"type": "Reach"}}, r"needs the fields \['place_error', 'creep'\]"),
    ({"operator": REACH | {"speed": 0.6}}, "operator.speed must be at most that of the arm, 0.5 m/s, got 0.6 m/s"),
    ({"operator": REACH | {"creep": (0.1, 0.6)}}, "operator.creep must be at most that of the arm, 0.5 m/s, got 0.6"),
    ({"operator": {"type": "Replay", "time": [0, 1], "velocity": [0, 0.7]}}, "must be -0.3 to 0.5 m/s, .* got 0.7 m/s"),
    ({"operator": {"type": "Replay", "time": [0, 1], "velocity": [0, -0.4]}}, "Replay.velocity must .* got -0.4 m/s"),
    ({"operator": {"type": "Replay", "time": [0, 1, 0.5], "velocity": [0, 0.1, 0]}}, "that rise from 0 s, got 1.0"),
    ({"operator": {"type": "Replay", "time": [0, math.nan], "velocity": [0, 0.1]}}, r"Replay.time\[1\] must be finite"),
    ({"operator": REACH | {"reaction": math.nan}}, "operator.reaction must be finite|Reach.reaction must be finite"),
    ({"operator": REACH, "velocity_range": (0.2, 0.5)}, "velocity_range must not begin above 0 m/s .* got 0.2 m/s"),
    ({"operator": REACH, "uplink": {"loss": 1.0}}, "loss must be finite and at least 0 and at most 0.99"),
    ({"operator": REACH, "uplink": {"delay": 9.0}}, "uplink.delay must be below the horizon, 8 s, got 9 s"),
    ({"operator": REACH, "downlink": {"delay": (0.1, 8.0)}}, "downlink.delay must be below the horizon"),
    ({"operator": REACH, "uplink": {"delay": 1.0, "jitter": 100.0}}, "8 s, got 101 s with the mean jitter"),
    ({"operator": REACH, "downlink": {"tail": 100.0, "tail_share": (0.0, 1.0)}}, "downlink.delay .* 8 s, got 100 s"),
    ({"operator": REACH, "downlink": {"trace": DAYS}}, "downlink.trace must .* horizon, 8 s, got 120 s: is it in ms"),
    ({"operator": REACH, "downlink": {"timeout": 0.2}}, "downlink.timeout must be left out: .* got 0.2 s"),
    ({"operator": REACH, "uplink": {"delay": 0.1, "trace": [[0, 0.1], [1, 0.1]]}}, "Channel.delay must be 0 beside a"),
    ({"operator": REACH, "uplink": {"trace": [[0.0, 0.1], [1.0, -0.1]]}}, r"delay\[1\] must .* at least 0 .* got -0.1"),
    ({"operator": REACH, "uplink": {"trace": [[0.0, 0.1], [1.0, math.nan]]}}, r"trace: delay\[1\] must be .* got nan"),
    ({"operator": REACH, "uplink": {"trace": [[0.0, 0.1], [2.0, 0.1], [1.0, 0.1]]}}, "from 0 s, got 2.0 s and 1.0 s"),
    ({"operator": REACH, "uplink": {"trace": "nowhere.csv"}}, "a CSV file of them, got 'nowhere.csv': nowhere.csv not"),
    ({"operator": REACH, "friction": 0.0}, "friction must be above 0"),
    ({"uplink": {"delay": 0.1}, "operator": None}, "uplink and downlink must be None without an operator"),
], ids=str)  # fmt: skip
def test_bad_operators_and_channels_are_refused_in_one_line(options, message):
    with pytest.raises(ValueError, match=message) as refusal:
        Task(**ARM | options)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("text", "message"), [
    ("nan,0.1\n1,0.1\n", r"time\[0\] must be finite .* got nan s"), ("", "must be rows of time and delay in s"),
    ("time,delay\n0,0.1\n1,soon\n", r"delay\[1\] must be finite .* got nan s"),
    ("0,0.1\n1,0.1,7\n", "must be rows of time and delay in s, or a CSV"),
    ("0;0.1\n1;0.1\n", "must be rows of time and delay in s"),
])  # fmt: skip
def test_bad_file_of_delays_is_refused_in_one_line(tmp_path, text, message):
    (tmp_path / "delays.csv").write_text(text)
    with pytest.raises(ValueError, match=message) as refusal:
        ig.Channel(trace=tmp_path / "delays.csv")
    assert "\n" not in str(refusal.value)
