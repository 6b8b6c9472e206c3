"""Arguments of the environment: a strategy for any of them, and arguments with a range for every number."""

from episode_runs import ROBOT
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

import impact_gym as ig

STORM = settings(
    deadline=None, derandomize=True, database=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)
"""Examples are the same in every run; none is shrunk or stored."""

SPANS = {
    "tool_mass": (0.05, 0.4), "alarm_threshold": (0.2, 15.0), "force_noise": (0.0, 2.0), "force_bias": (0.0, 1.0),
    "range_noise": (0.001, 0.05), "range_bias": (-0.02, 0.02), "time_weight": (0.5, 8.0), "reaction_delay": (0.0, 0.05),
    "friction": (0.0, 0.6),
}  # fmt: skip
ESTIMATE = "range_noise", "range_bias"
SPRING = {"stiffness": (20.0, 600.0), "damping_ratio": (0.0, 1.5), "stroke": (0.5, 0.6)}
MECHANISM = {
    "stiffness": (40.0, 80.0), "free_length": (0.07, 0.08), "height": (0.02, 0.03), "front_stop": (0.001, 0.02),
    "rear_stop": (-0.03, -0.01), "stop_stiffness": (1e4, 1e5), "stop_damping_ratio": (0.5, 1.0),
}  # fmt: skip
ARM = {"mass": (3.0, 6.0), "stiffness": (5e4, 2e5), "damping": (0.0, 60.0)}
SCENARIO = {
    "object_mass": (0.02, 2.5), "contact_stiffness": (1e3, 1e8), "restitution": (0.02, 1.0), "distance": (0.05, 0.35),
}  # fmt: skip
DRAWN = SPANS | {
    "force_noise": (0.1, 2.0), "force_bias": (0.1, 1.0), "scenario": SCENARIO, "robot": {"type": "Robot", **ARM},
}  # fmt: skip
RANGE_SENSOR = {
    "noise": (0.0, 0.01), "share": (0.0, 0.1), "bias": (-0.01, 0.01), "dropout": (0.0, 0.5), "delay": (0.0, 0.1),
    "scale": (-0.1, 0.1), "correlation": (0.0, 0.9), "resolution": (0.0, 0.005), "nearest": (0.0, 0.05),
    "farthest": (0.2, 1.0),
}  # fmt: skip
EVERYTHING_DRAWN = {
    "sensor": {name: DRAWN[name] for name in DRAWN if name not in ESTIMATE} | {"range_sensor": RANGE_SENSOR},
    "spring": DRAWN | {"coupling": {"type": "SpringDamper", **SPRING}},
    "mechanism": DRAWN | {"coupling": {"type": "Bistable", **MECHANISM}},
}
"""Arguments with a range for every number that may have one, without an operator."""
HAND = {"place_error": (-0.05, 0.05), "creep": (0.05, 0.2), "speed": (0.3, 0.5), "reaction": (0.1, 0.3)}
OPERATORS = {
    "Reach": HAND | {"lag_slope": (1.0, 3.0), "noise": (0.0, 0.5)},
    "SecondOrderLag": HAND | {"stiffness": (21.0, 71.0), "damping": (5.7, 12.8)},
    "Tracker": HAND | {"gain": (2.0, 4.5)}, "Trapezoid": {name: HAND[name] for name in ("speed", "reaction")},
}  # fmt: skip
TWO = {"time": [0.0, 7.9, 8.0, 15.9], "velocity": [0.3, 0.0, 0.1, 0.2], "length": 8.0, "recording": (0.0, 2.0)}
"""Two recordings, one after the other."""
CHANNEL = {
    "delay": (0.0, 0.3), "jitter": (0.0, 0.05), "tail": (0.0, 0.1), "tail_share": (0.0, 0.5), "loss": (0.0, 0.4),
    "burst": (1.0, 5.0), "timeout": (0.05, 0.2),
}  # fmt: skip
DISPLAY = {name: span for name, span in CHANNEL.items() if name != "timeout"}
STEERED_DRAWN = {
    name: DRAWN | {
        "operator": {"type": name, **numbers}, "uplink": CHANNEL, "downlink": DISPLAY, "friction": (0.1, 0.5),
        "horizon": 8.0, "velocity_range": [-0.3, 0.5],
    }
    for name, numbers in (OPERATORS | {"Replay": TWO}).items()
}  # fmt: skip
"""Arguments with a range for every number, with each kind of operator."""
RECORDED = {"type": "Replay", "time": [0.0, 0.5, 3.0, 3.1], "velocity": [0.0, 0.3, 0.3, 0.0]}
TRACED = {"trace": [[0.0, 0.02], [0.5, 0.3], [1.0, 0.1]]}


def number_or_range(low, high):
    number = st.integers(0, 1000).map(lambda share: low + (high - low) * share / 1000)
    return number | st.tuples(number, number).map(sorted).map(tuple)


def some_of(spans):
    return st.fixed_dictionaries({}, optional={name: number_or_range(*span) for name, span in spans.items()})


def described(kind, spans):
    """Mappings that describe a coupling, a robot or an operator."""
    numbers = st.fixed_dictionaries({name: number_or_range(*span) for name, span in spans.items()})
    return numbers.map(lambda given: {"type": kind, **given})


RIGID = st.just({"type": "Rigid"})
SOFT = described("SpringDamper", SPRING) | described("Bistable", MECHANISM) | st.sampled_from([
    ig.SpringDamper(150.0, 0.3), {"type": "SpringDamper", "stiffness": 80.0},
    ig.Bistable(80.0, rear_stop=-0.01), {"type": "Bistable"},
])  # fmt: skip
LIMITS = {"force_limit": st.sampled_from([5.0, 25.0]), "velocity_limit": st.sampled_from([0.1, 0.5])}
OWN = {
    **{name: number_or_range(*span) for name, span in SPANS.items() if name not in ESTIMATE},
    "scenario": st.sampled_from(["train", "hard"]) | some_of(SCENARIO),
    "robot": st.sampled_from([None, ROBOT, ig.Robot(2.0, 4e4, 10.0)]) | described("Robot", ARM),
    "alarm": st.sampled_from(["force", "reading"]), "dissipation": st.sampled_from(["hu-guo", "exact", "fixed"]),
    "missed_cost": st.floats(0.0, 5.0), "force_weight": st.integers(0, 20).map(lambda share: share / 1000),
    "control_period": st.floats(0.009, 0.03), "acceleration_range": st.just((0.5, 8.0)),
    "rtol": st.sampled_from([1e-5, 1e-8, 1e-11]), "max_episode_steps": st.sampled_from([None, 41, 13]),
}  # fmt: skip
"""Arguments that may differ between the rows of a batch."""
OBSERVED = {
    "deflection_sensor": st.booleans(), "privileged": st.integers(0, 2).map(lambda drawn: drawn == 2),
    "past_readings": st.integers(0, 3), "velocity_range": st.sampled_from([(-0.5, 1.5), (0.0, 1.0)]),
    "horizon": st.sampled_from([1.2, 1.2, 1.0]), "after_alarm": st.sampled_from([0.15, 0.15, 0.2]),
    "observe_range_noise": st.booleans(),
}  # fmt: skip
"""Arguments that are the same in all rows of a batch."""


@st.composite
def rows_of_tasks(draw, count=3):
    """Arguments of the environment for each of `count` rows; all rows observe the same quantities."""
    common, seen = draw(st.fixed_dictionaries(OBSERVED)), draw(st.sampled_from(["", "estimate", "sensor"]))
    common["observe_range_noise"] &= seen == "estimate"
    always = {"coupling": SOFT if common["deflection_sensor"] else SOFT | RIGID}
    always |= {"range_noise": number_or_range(*SPANS["range_noise"])} if seen == "estimate" else {}
    always |= {"range_sensor": some_of(RANGE_SENSOR)} if seen == "sensor" else {}
    optional = OWN | ({"range_bias": number_or_range(*SPANS["range_bias"])} if seen == "estimate" else {})
    if draw(st.booleans()):  # with an operator
        common |= {"velocity_range": (-0.3, 0.5), "horizon": 1.5}
        operator = st.sampled_from([*OPERATORS]).flatmap(lambda name: described(name, OPERATORS[name]))
        always |= {"friction": number_or_range(0.1, 0.5), "control_period": st.floats(0.012, 0.03)}
        always |= {"operator": operator | st.just(RECORDED), "uplink": some_of(CHANNEL) | st.just(TRACED)}
        always |= {"downlink": some_of(DISPLAY) | st.just(TRACED)}
    always |= LIMITS if draw(st.booleans()) else {}  # in all rows
    row = st.fixed_dictionaries(always, optional={name: of for name, of in optional.items() if name not in always})
    if common["privileged"]:  # in each row a critic observes what any row draws
        return [common | draw(row)] * count
    return [common | draw(row) for _ in range(count)]
