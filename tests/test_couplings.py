"""A coupling answers for itself: by its laws, and a class that lacks an answer is refused by name at every door."""

from dataclasses import dataclass, replace

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID
from refusal import refused
from solver_scenes import MOTION, scene

import impact_gym as ig
from agents.check import lag
from agents.setups import load_baseline
from experiments.reference.chain import Chain
from impact_gym import kernels, pack
from impact_gym.couplings import COUPLINGS, Coupling
from impact_gym.task import Task

MASS = 0.125  # kg
SPRING, STOPPED = ig.SpringDamper(50.0, 0.4), ig.SpringDamper(50.0, 0.4, stroke=0.021)


@dataclass(frozen=True, slots=True)
class Viscous(Coupling):
    """A coupling that answers nothing."""


@pytest.mark.parametrize("coupling", [SPRING, STOPPED, ig.Bistable()], ids=["spring", "stops", "bistable"])
def test_pull_is_the_force_of_a_simulated_coupling(coupling):
    trace = ig.simulate(scene(coupling=coupling), MOTION, 1.0, trace=True).trace
    deflection = trace.tool_position - trace.flange_position
    rows = zip(deflection, trace.tool_velocity - trace.flange_velocity, strict=True)
    forces = np.array([coupling.pull(*row, MASS) for row in rows])
    stops = [-STOPPED.stroke, STOPPED.stroke, ig.Bistable().rear_stop - ig.Bistable().rest]
    away = np.abs(np.subtract.outer(deflection, stops)).min(axis=1) > 1e-9  # at a stop its force jumps
    assert forces[away] == pytest.approx(trace.coupling_force[away], rel=1e-6, abs=1e-5)


def test_lag_holds_the_tool_at_a_steady_acceleration():
    assert SPRING.pull(-SPRING.lag(MASS, 8.0), 0.0, MASS) == pytest.approx(MASS * 8.0)
    assert SPRING.oscillator(MASS) == pytest.approx((50.0 / MASS, 2.0 * 0.4 * (50.0 / MASS) ** 0.5))
    assert ig.Bistable().pull(0.0, 0.0, MASS) == pytest.approx(0.0, abs=1e-9)  # spring and stop balance at rest


def test_one_more_number_of_a_record_changes_no_other():
    names, values = list(pack.OF_PLAN), range(1, len(pack.OF_PLAN) + 1)
    for index in range(len(names) + 1):
        more = np.dtype([(name, float) for name in (*names[:index], "more", *names[index:])])
        packed = np.frombuffer(pack.packer(more, pack.OF_PLAN).pack(*values), more)[0]
        assert [packed[name] for name in (*names, "more")] == [*values, 0]


def test_a_number_without_a_place_in_the_record_is_refused(monkeypatch):
    monkeypatch.setattr(ig.Rigid, "kernel", lambda _: (kernels.RIGID, {"viscosity": 1.0}))
    refused(lambda: ig.simulate(scene(), MOTION), "'coupling.viscosity'", "quantities.py")


@dataclass(frozen=True, slots=True)
class Paired(Coupling):
    """A spring and damper whose numbers depend on each other."""

    stiffness: float
    damping_ratio: float

    def __post_init__(self):
        if self.stiffness * self.damping_ratio > 100.0:
            raise ValueError("too much")

    def kernel(self):
        """The kind and numbers of a `SpringDamper`."""
        return kernels.SPRING_DAMPER, {"stiffness": self.stiffness, "damping_ratio": self.damping_ratio}


def test_own_checks_of_a_coupling_hold_in_a_sweep():
    varied = {"coupling.stiffness": [50.0, 150.0]}
    refused(lambda: ig.sweep(scene(coupling=Paired(50.0, 1.0)), MOTION, varied), "at (1,): too much")
    paired, spring = (ig.sweep(scene(coupling=each), MOTION, varied) for each in (Paired(50.0, 0.4), SPRING))
    assert np.array_equal(paired.object_velocity, spring.object_velocity)


@pytest.mark.parametrize("answer", [
    lambda held: ig.sweep(scene(coupling=held), MOTION, {"tool.mass": [0.1]}), lambda held: held.pull(0.0, 0.0, MASS),
    lambda held: ig.simulate(scene(coupling=held), MOTION), lambda held: ig.advise(scene(coupling=held), MOTION),
    lambda held: lag(replace_coupling(held)), lambda held: held.drawn_length(MASS), lambda held: held.holding_force,
    lambda held: load_baseline("filtered-profile", 2.0).for_task(replace_coupling(held)).swing(0.0, 0.0, 0.0),
    lambda held: held.simplified(), lambda held: held.response_time(MASS), lambda held: held.stop_time(MASS),
])  # fmt: skip
def test_coupling_that_lacks_an_answer_is_refused_by_name(answer):
    refused(lambda: answer(Viscous()), "the coupling Viscous lacks ", "impact_gym/couplings.py")


def replace_coupling(held):
    """A task whose coupling is replaced behind its checks."""
    task = Task(range_sensor={"noise": 0.01})
    object.__setattr__(task, "coupling", held)
    return task


def test_unknown_coupling_has_no_reference_and_no_environment():
    with pytest.raises(NotImplementedError, match=r"no equations of the coupling Viscous\(\)"):
        Chain(scene(coupling=Viscous()), MOTION)
    refused(lambda: gym.make(ID, coupling=Viscous()), "coupling", *(kind.__name__ for kind in COUPLINGS))
    refused(lambda: replace(scene(), coupling="Viscous"), "Scene.coupling", "Rigid or SpringDamper or Bistable")
