"""Numbers for the paper's scenes: the table 'Printed, and ours' in docs/provenance.md, by our solver and the slow one.

Printed are the speed of 1 m/s, the detection, each scene's masses, stiffnesses and restitution. Distance, acceleration
and stops were identified by the project, and the numbers asserted here were found by the independent solver. What the
text says of them is compared in the study `paper`, whose verdicts tests/experiments/test_paper_study.py asserts.
"""

import numpy as np
import pytest
from golden import OBJECT_VELOCITIES
from scenes import scene
from solvers import BOTH

import impact_gym as ig

RIGID, SPRING, LINEAR, BISTABLE = ig.Rigid(), ig.SpringDamper(150.0), ig.SpringDamper(50.0), ig.Bistable()
BRAKE = ig.Brake(threshold=1.0, delay=0.016, deceleration=8.0)  # printed, printed, identified


def approach(coupling, k_c, restitution, simulate=ig.simulate, **options):
    return simulate(scene(k_c, restitution, coupling), ig.Trapezoid(1.0, 8.0, BRAKE), 1.5, 1e-9, **options)


SCENES = {  # coupling, contact stiffness (N/m^1.5), restitution, number of contacts, impulse of the coupling (N s)
    "13a": (RIGID, 1e5, 1.0, 1, None),
    "16, before the break": (ig.SpringDamper(85.0), 1e5, 1.0, 1, None),
    "16, at the break": (ig.SpringDamper(90.0), 1e5, 1.0, 2, None),
    "16, behind the break": (ig.SpringDamper(92.0), 1e5, 1.0, 2, None),
    "17a": (SPRING, 1e5, 1.0, 2, None),
    "17b": (SPRING, 1e4, 1.0, 1, None),
    "18": (SPRING, 1e4, 0.1, 1, None),
    "19a": (SPRING, 1e5, 0.1, 1, 0.1962),
    "19b": (SPRING, 1e3, 0.1, 1, 0.1092),
    "23a": (BISTABLE, 1e3, 0.1, 1, 0.0058),
    "23b": (LINEAR, 1e3, 0.1, 1, 0.0791),
    "25": (RIGID, 1e3, 0.1, 1, None),
}
VELOCITIES = OBJECT_VELOCITIES | {"13a": pytest.approx(1.999867, abs=1e-6), "18": pytest.approx(0.865, abs=5e-4)}


@pytest.mark.parametrize("figure", SCENES)
@BOTH
def test_scene_of_figure_has_the_velocity_contacts_and_impulse_of_the_independent_solver(simulate, figure):
    *scene_of_figure, contacts, impulse = SCENES[figure]
    outcome = approach(*scene_of_figure, simulate)
    velocity = VELOCITIES[figure]
    assert outcome.object_velocity == (pytest.approx(velocity, rel=1e-5) if isinstance(velocity, float) else velocity)
    assert len(outcome.contacts) == contacts
    assert impulse is None or outcome.coupling_impulse == pytest.approx(impulse, abs=5e-5)


@BOTH
def test_mechanism_of_fig_23a_snaps_in_the_contact_wherever_its_rear_stop_is(simulate):
    bistable, rigid = (approach(coupling, 1e3, 0.1, simulate) for coupling in (BISTABLE, RIGID))
    assert 1 - bistable.object_velocity / rigid.object_velocity == pytest.approx(0.51, abs=5e-4)  # printed in Fig. 25
    (crossing,), (contact,) = bistable.snap_through, bistable.contacts
    assert contact.start < crossing < contact.end
    for rear_stop in (-0.01, -0.03):
        moved = approach(ig.Bistable(rear_stop=rear_stop), 1e3, 0.1, simulate)
        assert moved.object_velocity == pytest.approx(bistable.object_velocity, rel=1e-12)


@pytest.mark.parametrize("coupling", [RIGID, SPRING], ids=["rigid", "spring"])
def test_brake_stops_the_flange_and_sees_the_alarm_at_its_threshold(coupling):
    outcome = approach(coupling, 1e5, 0.5, trace=True)
    trace, detection = outcome.trace, outcome.detection_time
    assert np.interp(detection, trace.time, trace.contact_force) == pytest.approx(BRAKE.threshold, rel=1e-6)
    assert np.all(trace.contact_force[trace.time < detection] < BRAKE.threshold)
    start = detection + BRAKE.delay
    imposed = np.interp(trace.time, [0.0, 1 / 8, start, start + 1 / 8, 2.0], [0.0, 1.0, 1.0, 0.0, 0.0])
    assert trace.flange_velocity == pytest.approx(imposed, abs=1e-12)
