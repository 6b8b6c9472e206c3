"""The paper's scenes by our solver and the independent one, with V_p computed once by the independent one.

The paper prints the speed of 1 m/s, the detection, and each scene's masses, stiffnesses and restitution. We identified
distance, acceleration and stops (docs/provenance.md). The study `paper` compares these scenes with the text.
"""

import pytest
from reference_table import table

import impact_gym as ig

SCENES = {  # V_p (m/s), contacts, impulse of the coupling (N s)
    "13a": (1.999867, 1, None), "16, before the break": (0.739806, 1, None), "16, at the break": (0.747012, 2, None),
    "16, behind the break": (0.757929, 2, None), "17a": (0.903164, 2, None), "17b": (0.936088, 1, None),
    "18": (0.865, 1, None), "19a": (0.872899, 1, 0.1962), "19b": (0.794273, 1, 0.1092), "23a": (0.45074, 1, 0.0058),
    "23b": (0.692859, 1, 0.0791), "25": (0.920628, 1, None),
}  # fmt: skip
FIGURES = {run.name: (run.outcome, ig.simulate(*run.approach, rtol=1e-12)) for run in table()["figure"]}


@pytest.mark.parametrize("figure", SCENES)
def test_scene_of_figure_has_its_velocity_contacts_and_impulse(figure):
    velocity, contacts, impulse = SCENES[figure]
    for outcome in FIGURES[figure]:
        assert outcome.object_velocity == pytest.approx(velocity, abs=5e-4 if figure == "18" else 5e-6)
        assert len(outcome.contacts) == contacts
        assert impulse is None or outcome.coupling_impulse == pytest.approx(impulse, abs=5e-5)


@pytest.mark.parametrize("solver", [0, 1], ids=["independent", "ours"])
def test_mechanism_of_fig_23a_snaps_in_the_contact(solver):
    stops = "23a", "23a, rear stop at -10 mm", "23a, rear stop at -30 mm"
    bistable, *moved, rigid = (FIGURES[figure][solver] for figure in (*stops, "25"))
    assert 1 - bistable.object_velocity / rigid.object_velocity == pytest.approx(0.51, abs=5e-4)  # printed in Fig. 25
    (crossing,), (contact,) = bistable.snap_through, bistable.contacts
    assert contact.start < crossing < contact.end
    assert [each.object_velocity for each in moved] == pytest.approx([bistable.object_velocity] * 2, rel=1e-12)
