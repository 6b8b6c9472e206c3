"""From a log and a scene's file to a set-up that agents.load_setup accepts."""

import numpy as np
import pytest
from blows import log, scene

from agents import load_setup
from impact_gym.identify.__main__ import main

SCENE = """
title = "Our arm"
[environment]
tool_mass = 0.125
coupling = { type = "SpringDamper", stiffness = 150.0, damping_ratio = 1.0 }
reaction_delay = [0.012, 0.020]
[environment.scenario]
object_mass = 1.0
contact_stiffness = 1e4
restitution = 0.8
distance = 0.2505
[motion]
speed = 1.0
acceleration = 8.0
brake = { threshold = 1.0, delay = 0.016 }
[sensor.force]
rate = 4000.0
"""


@pytest.fixture
def files(tmp_path):
    columns = np.column_stack(list(log(scene(1e5, 0.5)).values()))
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header="time,force", comments="")
    (tmp_path / "my.toml").write_text(SCENE)
    return tmp_path


def identify(files, *options):
    main([str(files / "log.csv"), "--scene", str(files / "my.toml"), *map(str, options)])


def test_main_makes_intervals_the_ranges_of_a_set_up(files, capsys):
    out = files / "setup.toml"
    identify(files, "--out", out, "--plot", files / "a.png")
    assert "contact.stiffness = " in capsys.readouterr().out
    setup = load_setup(out)
    scenario = setup.environment["scenario"]
    for name, truth in (("contact_stiffness", 1e5), ("restitution", 0.5), ("object_mass", 0.25)):
        low, high = scenario[name]
        assert 0.8 * truth < low < high < 1.25 * truth
    assert scenario["distance"] == 0.2505
    assert setup.environment["reaction_delay"] == [0.012, 0.020]
    assert setup.title == "Our arm"
    assert (files / "a.png").stat().st_size > 0


def test_main_prints_the_set_up_and_may_free_a_coupling(files, capsys):
    identify(files, "--free", "contact.stiffness", "coupling.stiffness")
    (files / "printed.toml").write_text(capsys.readouterr().out)
    stiffness = load_setup(files / "printed.toml").environment["coupling"]["stiffness"]
    assert stiffness == 150.0 or stiffness[0] < stiffness[1]


@pytest.mark.parametrize(("old", "new", "match"), [
    ("[motion]", "[moved]", r"must have a table \[motion\]"),
    ("speed = 1.0", "speeed = 1.0", "motion has no field 'speeed'"),
    ("distance = 0.2505", "distance = [0.2, 0.3]", r"environment\.scenario\.distance must be a number"),
    ("stiffness = 150.0", "stiffness = [100.0, 200.0]", r"environment\.coupling\.stiffness must be a number"),
    ("rate = 4000.0", "rate = 400.0", "Sensor.rate of force is 400 Hz"),
    ("title =", "title", "is not read as TOML"),
])  # fmt: skip
def test_main_says_in_one_line_what_is_wrong_with_the_file(files, old, new, match):
    (files / "my.toml").write_text(SCENE.replace(old, new))
    with pytest.raises(SystemExit, match=match) as refusal:
        identify(files)
    assert str(refusal.value).startswith("impact-gym identify: ")
    assert "\n" not in str(refusal.value)


def test_main_refuses_a_number_without_a_place_in_a_set_up(files):
    with pytest.raises(SystemExit, match=r"contact\.stiffness_exponent has no place in a set-up"):
        identify(files, "--free", "contact.stiffness_exponent")


def test_command_asks_for_the_scene(files, capsys):
    with pytest.raises(SystemExit) as refusal:
        main([str(files / "log.csv"), "--free", "object.mass"])
    assert refusal.value.code == 2
    assert "--scene" in capsys.readouterr().err
