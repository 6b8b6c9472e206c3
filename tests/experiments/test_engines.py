"""The study of engines: cases, exact law, MuJoCo, and this module as an engine that crashes, hangs and lies."""

import json
import math
import os
import time
from dataclasses import asdict, replace
from functools import partial

import numpy as np
import pytest
from refusal import refused

from experiments import reference
from experiments.lab.study import Cell, StudyOptions, StudyRun
from experiments.studies import engines
from experiments.studies.engines import cases, mujoco, ours
from experiments.studies.engines.drive import Variant, drive, measured
from impact_gym.physics.impact import free_tool

CASES = cases.read()
MADE_UP, PACKAGE = "tests.experiments.test_engines", "numpy"
FAULTS = {"hangs": "no answer within 1 s", "crashes": "process was lost", "says nan": "not finite",
          "makes momentum": "", "honest": "", "missing": "not installed: pip install numpy"}  # fmt: skip
VARIANTS = {fault: Variant("e", options={"fault": fault}) for fault in FAULTS}


def build(case, step, fault):
    """Velocities jump at the touch, with a fault."""
    state = [0.0, case.start_speed, 0.0]
    time.sleep(3600.0 if fault == "hangs" else 0.0)

    def advance(push):
        if fault == "crashes":
            os.abort()
        state[0] += state[1] * step
        if state[0] > case.distance and state[2] == 0.0:
            after = free_tool(case.tool_mass, case.object_mass, case.speed, 0.0, case.restitution)
            state[1:] = np.multiply(after, [1.0, 1.01 if fault == "makes momentum" else 1.0])
        return state[0], state[1], math.nan if fault == "says nan" else state[2]

    return advance


def test_answers_are_those_of_the_independent_solver():
    assert len(CASES) == 20
    for case in CASES.values():
        if case.restitution:  # no law of damping has a restitution of 0
            assert case.solved(reference.simulate, rtol=1e-12) == pytest.approx(case.answers, rel=1e-11), case.name


def test_answers_of_free_bodies_have_closed_forms():
    for case in (case for case in CASES.values() if not case.spring):
        m_t, m_p, e, v, k = case.tool_mass, case.object_mass, case.restitution, case.speed, case.stiffness
        assert case.answers["object_velocity"] == pytest.approx((1 + e) * m_t * v / (m_t + m_p), rel=1e-14)
        if e == 1.0:  # Hertz: Johnson, Contact Mechanics, section 11.4
            deepest = (1.25 * m_t * m_p / (m_t + m_p) * v**2 / k) ** 0.4
            lasts = 0.8 * math.sqrt(math.pi) * math.gamma(0.4) / math.gamma(0.9) * deepest / v
            assert case.answers["peak_force"] == pytest.approx(k * deepest**1.5, rel=1e-11)
            assert case.answers["contact_duration"] == pytest.approx(lasts, rel=1e-11)


@pytest.mark.parametrize("name", CASES)
def test_exact_law_delivers_what_was_asked(name):
    case = CASES[name]
    (row,) = measured("ours", "exact", asdict(case), None, "0")
    velocity = case.answers["object_velocity"] * (1.0 + case.asked_restitution) / (1.0 + case.restitution)
    assert row["object_velocity"] == pytest.approx(velocity, rel=1e-9)  # no law has a restitution of 0
    assert case.spring or row["delivered"] == pytest.approx(case.asked_restitution, abs=1e-9)


@pytest.mark.parametrize("name", ["restitution-0.5", "figure-19a"])
def test_law_in_steps_converges_to_the_answers(name):
    case = CASES[name]
    for measure in ("object_velocity", "peak_force"):
        errors = [abs(drive(case, ours.build, step)[measure] / case.answers[measure] - 1.0) for step in (5e-4, 5e-5)]
        assert errors[1] < errors[0] / 5.0 < 0.05


def test_mujoco_converges_to_a_spring_and_damper():
    pytest.importorskip("mujoco")
    build, elastic, inelastic = partial(mujoco.build, impedance=0.01), CASES["restitution-1"], CASES["restitution-0.3"]
    found = drive(elastic, build, 1e-5)
    assert (found["peak_force"], found["delivered"]) == pytest.approx((elastic.answers["peak_force"], 1.0), rel=1e-4)
    assert found["momentum_error"] < 1e-12
    assert abs(found["energy"]) < 1e-4
    assert drive(inelastic, build, 1e-5)["delivered"] == pytest.approx(0.3, abs=1e-3)


def test_faults_of_an_engine_are_rows(tmp_path):
    shared = {"name": MADE_UP, "case": asdict(CASES["restitution-0.5"]), "step": 2e-3}
    labels = [{"variant": fault, "case": "restitution-0.5", "step": 2e-3} for fault in FAULTS]
    installed = {fault: "" if fault == "missing" else "1" for fault in FAULTS}
    cells = [Cell(each, {**shared, "variant": fault, "installed": installed[fault]})
             for fault, each in zip(FAULTS, labels, strict=True)]  # fmt: skip
    made_up = [replace(engines.measurement(MADE_UP), name=name, cells=lambda *_, own=own: own, seconds=seconds)
               for name, own, seconds in ((MADE_UP, cells[1:], 3600.0), ("hanging", cells[:1], 1.0))]  # fmt: skip
    run = StudyRun(replace(engines.STUDY, measurements=made_up), StudyOptions(tmp_path / "out", processes=2))
    rows = {row["variant"]: row for each in made_up for row in run[each.name].to_dicts()}
    for fault, said in FAULTS.items():
        assert said in (rows[fault]["failure"] or "")
        assert bool(said) == bool(rows[fault]["failure"])
    for fault, momentum_error in (("makes momentum", 0.01), ("honest", 0.0)):
        assert rows[fault]["momentum_error"] == pytest.approx(momentum_error, abs=1e-12)
    assert (rows["honest"]["delivered"], rows["honest"]["off"]) == pytest.approx((0.5, 0.0), abs=1e-12)
    table = engines.compared(engines.rows_of({MADE_UP: run[MADE_UP]})).rows
    assert FAULTS["crashes"] in table[0][3]
    assert [row[0] for row in table if "above 1e-6" in row[-1]] == ["numpy, makes momentum"]


def test_bad_input_is_refused_in_one_line(tmp_path):
    refused(partial(drive, CASES["slow"], ours.build, 0.0), "step must be finite and above 0 s", "0.0")
    read = partial(cases.read, tmp_path / "bad.json")
    for field, value in (("stiffness", None), ("answers", None), ("speed", -1.0)):
        bad = json.loads(cases.SHIPPED.read_text())
        bad["cases"][3].pop(field) if value is None else bad["cases"][3].update({field: value})
        (tmp_path / "bad.json").write_text(json.dumps(bad))
        refused(read, "bad.json cannot be read as cases", "restitution-0.5", field)
