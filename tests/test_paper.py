"""The paper's scenes by our solver and the slow one: the table 'Printed, and ours' in docs/provenance.md.

The paper prints the speed of 1 m/s, the detection, and each scene's masses, stiffnesses and restitution. We identified
distance, acceleration and stops. The asserted numbers are from the independent solver. The study `paper` compares them
with the text; tests/experiments/test_paper_study.py asserts its verdicts.
"""

import pytest
from solver_scenes import BOTH

import impact_gym as ig
from experiments.lab.scenes import DURATION, MOTION, scene

RIGID, SPRING, LINEAR, BISTABLE = ig.Rigid(), ig.SpringDamper(150.0), ig.SpringDamper(50.0), ig.Bistable()
SCENES = {  # coupling, contact stiffness (N/m^1.5), restitution, V_p (m/s), contacts, impulse of the coupling (N s)
    "13a": (RIGID, 1e5, 1.0, pytest.approx(1.999867, abs=1e-6), 1, None),
    "16, before the break": (ig.SpringDamper(85.0), 1e5, 1.0, 0.739806, 1, None),
    "16, at the break": (ig.SpringDamper(90.0), 1e5, 1.0, 0.747012, 2, None),
    "16, behind the break": (ig.SpringDamper(92.0), 1e5, 1.0, 0.757929, 2, None),
    "17a": (SPRING, 1e5, 1.0, 0.903164, 2, None),
    "17b": (SPRING, 1e4, 1.0, 0.936088, 1, None),
    "18": (SPRING, 1e4, 0.1, pytest.approx(0.865, abs=5e-4), 1, None),
    "19a": (SPRING, 1e5, 0.1, 0.872899, 1, 0.1962),
    "19b": (SPRING, 1e3, 0.1, 0.794273, 1, 0.1092),
    "23a": (BISTABLE, 1e3, 0.1, 0.45074, 1, 0.0058),
    "23b": (LINEAR, 1e3, 0.1, 0.692859, 1, 0.0791),
    "25": (RIGID, 1e3, 0.1, 0.920628, 1, None),
}


@pytest.mark.parametrize("figure", SCENES)
@BOTH
def test_scene_of_figure_has_the_velocity_contacts_and_impulse_of_the_independent_solver(simulate, figure):
    coupling, k_c, restitution, velocity, contacts, impulse = SCENES[figure]
    outcome = simulate(scene(k_c, restitution, coupling), MOTION, DURATION)
    assert outcome.object_velocity == (pytest.approx(velocity, rel=1e-5) if isinstance(velocity, float) else velocity)
    assert len(outcome.contacts) == contacts
    assert impulse is None or outcome.coupling_impulse == pytest.approx(impulse, abs=5e-5)


@BOTH
def test_mechanism_of_fig_23a_snaps_in_the_contact_wherever_its_rear_stop_is(simulate):
    stops = [ig.Bistable(rear_stop=rear_stop) for rear_stop in (-0.01, -0.03)]
    bistable, rigid, *moved = (simulate(scene(1e3, 0.1, each), MOTION, DURATION) for each in (BISTABLE, RIGID, *stops))
    assert 1 - bistable.object_velocity / rigid.object_velocity == pytest.approx(0.51, abs=5e-4)  # printed in Fig. 25
    (crossing,), (contact,) = bistable.snap_through, bistable.contacts
    assert contact.start < crossing < contact.end
    assert [each.object_velocity for each in moved] == pytest.approx([bistable.object_velocity] * 2, rel=1e-12)
