"""No statement agrees only because its tolerance is wide: a wrong model contradicts each."""

from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

import impact_gym as ig
from experiments.lab import scenes
from experiments.lab.study import frame_of
from experiments.studies.paper import MADE, STUDY
from experiments.studies.paper.statements import AGREEING, SAID, judged


def with_contact(factor=1.0, **change):
    def changed(scene, motion):
        contact = {"stiffness": factor * scene.contact.stiffness} | change
        return replace(scene, contact=replace(scene.contact, **contact)), motion

    return changed


def with_coupling(change):
    def changed(scene, motion):
        spring = isinstance(scene.coupling, ig.SpringDamper)
        return (replace(scene, coupling=change(scene.coupling)) if spring else scene), motion

    return changed


WRONG_MODELS = {
    "restitution of 0.5": with_contact(restitution=0.5),
    "contact stiffness of 1e4": with_contact(stiffness=1e4),
    "contact ten times as stiff": with_contact(factor=10.0),
    "a tenth as stiff": with_contact(factor=0.1),
    "no brake": lambda scene, motion: (scene, replace(motion, brake=None)),
    "brake even where the study has none": lambda scene, motion: (scene, replace(motion, brake=scenes.BRAKE)),
    "soft robot": lambda scene, motion: (
        replace(scene, robot=replace(scene.robot, stiffness=0.1 * scene.robot.stiffness))
        if isinstance(scene.robot, ig.Robot) else scene, motion,
    ),
    "half the speed": lambda scene, motion: (scene, replace(motion, speed=0.5 * motion.speed)),
    "heavy tool": lambda scene, motion: (replace(scene, tool=ig.Tool(4.0 * scene.tool.mass)), motion),
    "spring without damper": with_coupling(lambda coupling: replace(coupling, damping_ratio=0.02)),
    "mechanism for a spring": with_coupling(lambda coupling: ig.Bistable()),
    "spring for a mechanism": lambda scene, motion: (
        replace(scene, coupling=ig.SpringDamper(50.0)) if isinstance(scene.coupling, ig.Bistable) else scene, motion,
    ),
}  # fmt: skip
NO_SIMULATION = {"beyond_contact.equation_7", "figure_12.configuration"}  # judged by laws and data of a robot alone


def numbers_of(table):
    return MADE[f"_numbers_{table.name}"](frame_of([({}, table.measure())]))


def judged_names(numbers):
    """The statements about computed figures that are tests and do not only follow from others."""
    return {
        name for name, said in SAID.items()
        if name.partition(".")[0] in numbers and said.basis == "test" and not said.agree
    }  # fmt: skip


def agreeing(numbers):
    said = {name: SAID[name] for name in judged_names(numbers)}
    return {name for name, found in zip(said, judged(numbers, said)["verdict"], strict=True) if found in AGREEING}


def test_each_statement_that_agrees_is_contradicted_by_a_wrong_model(monkeypatch):
    """A figure that a wrong model cannot compute contradicts nothing."""
    right, contradicted = {"simulate": ig.simulate, "sweep": ig.sweep}, set()

    def wrong_simulate(change, scene, motion, *rest, **options):
        return right["simulate"](*change(scene, motion), *rest, **options)

    def wrong_sweep(change, scene, motion, varied, *rest, **options):
        varied = dict(varied)
        for name in ("contact.stiffness", "contact.restitution"):
            field = name.removeprefix("contact.")
            values = np.asarray(varied.get(name, np.nan), float)
            cases = [replace(scene, contact=replace(scene.contact, **{field: value})) for value in values.flat]
            wrong = [getattr(change(case, motion)[0].contact, field) for case in cases]
            varied |= {name: np.reshape(wrong, values.shape)} if name in varied else {}
        scene, motion = change(scene, motion)
        if motion.brake is None and "motion.brake.delay" in varied:
            varied["tool.mass"] = np.broadcast_to(scene.tool.mass, np.shape(varied.pop("motion.brake.delay")))
        return right["sweep"](scene, motion, varied, *rest, **options)

    agree = agreeing({table.name: numbers_of(table) for table in STUDY.measurements})
    for change in WRONG_MODELS.values():
        monkeypatch.setattr(ig, "simulate", partial(wrong_simulate, change))
        monkeypatch.setattr(ig, "sweep", partial(wrong_sweep, change))
        numbers = {}
        for table in STUDY.measurements:
            with suppress(LookupError, TypeError, ValueError):
                numbers[table.name] = numbers_of(table)
        contradicted |= judged_names(numbers) - agreeing(numbers)
    assert agree - contradicted == NO_SIMULATION
