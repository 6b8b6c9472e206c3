"""Numbers for the paper's scenes: the table 'Printed, and ours' in docs/provenance.md, by our solver and the slow one.

Printed are the speed of 1 m/s, the detection, each scene's masses, stiffnesses and restitution. Distance, acceleration
and stops were identified by the project, and the numbers asserted here were found by the independent solver. What the
text says of them is compared in experiments/paper, whose verdicts tests/experiments/test_figures.py asserts.
"""

import numpy as np
import pytest
from golden import OBJECT_VELOCITIES, SHAPES
from scenes import scene
from solvers import BOTH

import impact_gym as ig

RIGID, SPRING, LINEAR, BISTABLE = ig.Rigid(), ig.SpringDamper(150.0), ig.SpringDamper(50.0), ig.Bistable()
REDUCED_MASS = 0.125 * 0.25 / (0.125 + 0.25)  # kg, of two free masses
BRAKE = ig.Brake(threshold=1.0, delay=0.016, deceleration=8.0)  # printed, printed, identified


def approach(coupling, contact_stiffness, restitution, *, m_p=0.25, brake=BRAKE, simulate=ig.simulate, **options):
    paper = scene(contact_stiffness, restitution, coupling, m_p=m_p)
    return simulate(paper, ig.Trapezoid(1.0, 8.0, brake), 1.5, 1e-9, **options)


VELOCITIES = [  # figure, coupling, contact stiffness, restitution, contacts
    ("16, before the break", ig.SpringDamper(85.0), 1e5, 1.0, 1),
    ("16, at the break", ig.SpringDamper(90.0), 1e5, 1.0, 2),
    ("16, behind the break", ig.SpringDamper(92.0), 1e5, 1.0, 2),
    ("17a", SPRING, 1e5, 1.0, 2), ("17b", SPRING, 1e4, 1.0, 1), ("19a", SPRING, 1e5, 0.1, 1),
    ("19b", SPRING, 1e3, 0.1, 1), ("23a", BISTABLE, 1e3, 0.1, 1), ("23b", LINEAR, 1e3, 0.1, 1),
    ("25", RIGID, 1e3, 0.1, 1),
]  # fmt: skip


@pytest.mark.parametrize(("figure", "coupling", "contact_stiffness", "restitution", "contacts"), VELOCITIES)
@BOTH
def test_object_velocity_and_contacts_of_figure(simulate, figure, coupling, contact_stiffness, restitution, contacts):
    outcome = approach(coupling, contact_stiffness, restitution, simulate=simulate)
    assert outcome.object_velocity == pytest.approx(OBJECT_VELOCITIES[figure], rel=1e-5)
    assert len(outcome.contacts) == contacts


@pytest.mark.parametrize(
    ("name", "coupling", "contact_stiffness", "ours", "tolerance"),
    [
        ("object_velocity", RIGID, 1e5, 1.999867, 1e-6),  # Fig. 13a, where e = 1; 2 m/s without a brake
        ("object_velocity", SPRING, 1e4, 0.865, 5e-4),  # Fig. 18
        ("coupling_impulse", SPRING, 1e5, 0.1962, 5e-5),  # Fig. 20
        ("coupling_impulse", SPRING, 1e3, 0.1092, 5e-5),
        ("coupling_impulse", LINEAR, 1e3, 0.0791, 5e-5),  # Fig. 24
        ("coupling_impulse", BISTABLE, 1e3, 0.0058, 5e-5),
    ],
)
@BOTH
def test_number_of_figure(simulate, name, coupling, contact_stiffness, ours, tolerance):
    restitution = 1.0 if coupling is RIGID else 0.1
    outcome = approach(coupling, contact_stiffness, restitution, simulate=simulate)
    assert getattr(outcome, name) == pytest.approx(ours, abs=tolerance)


def test_contact_of_fig_13a_outlasts_the_delay_of_the_brake():
    (contact,) = approach(RIGID, 1e5, 1.0).contacts
    assert contact.end - contact.start == pytest.approx(0.0185, abs=5e-5)
    assert approach(RIGID, 1e5, 1.0, brake=None).object_velocity == pytest.approx(2.0, rel=1e-9)


def test_peak_force_of_fig_5_scales_with_the_mass_that_moves():
    # two free masses move relative to each other as one body of the reduced mass does against a wall
    masses = np.array([0.25, REDUCED_MASS])
    peaks = [approach(RIGID, 1e5, 0.5, m_p=mass, brake=None).peak_force for mass in masses]
    assert peaks == pytest.approx(SHAPES[0.5][2] * 1e5**0.4 * masses**0.6, rel=1e-8)  # F0 at 1 m/s
    assert peaks == pytest.approx([46.4611, 24.0335], abs=1e-4)


def test_damping_force_of_fig_5_turns_negative_once_where_it_is_printed():
    trace = approach(RIGID, 1e5, 0.5, brake=None, trace=True).trace
    damping = trace.contact_force - 1e5 * np.maximum(trace.tool_position - trace.object_position, 0.0) ** 1.5
    first_negative = trace.time[np.argmax(damping < -1e-9)]
    assert first_negative == pytest.approx(0.321, abs=5e-4)  # printed
    assert np.all(damping[trace.time < first_negative] >= -1e-9)


def test_slope_of_fig_16_breaks_where_a_second_contact_begins():
    stiffness = np.arange(70.0, 111.0, 1.0)
    runs = [approach(ig.SpringDamper(k_t), 1e5, 1.0) for k_t in stiffness]
    twice = np.array([len(run.contacts) for run in runs]) == 2
    onset = stiffness[np.argmax(twice)]
    assert onset == pytest.approx(90.0, abs=2.0)  # printed: about 90 N/m
    assert np.all(twice == (stiffness >= onset))
    slope = np.gradient([run.object_velocity for run in runs], stiffness)
    assert slope[stiffness > onset + 1].min() > 5 * slope[stiffness < onset - 1].max()


@BOTH
def test_mechanism_of_fig_23a_snaps_in_the_contact_wherever_its_rear_stop_is(simulate):
    bistable, rigid = (approach(coupling, 1e3, 0.1, simulate=simulate) for coupling in (BISTABLE, RIGID))
    assert 1 - bistable.object_velocity / rigid.object_velocity == pytest.approx(0.51, abs=5e-4)  # printed in Fig. 25
    (crossing,), (contact,) = bistable.snap_through, bistable.contacts
    assert contact.start < crossing < contact.end
    for rear_stop in (-0.01, -0.03):
        moved = approach(ig.Bistable(rear_stop=rear_stop), 1e3, 0.1, simulate=simulate)
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
