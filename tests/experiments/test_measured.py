"""Measured hits, blows and tosses: made up with known numbers, and files that are none."""

import csv
import tomllib

import numpy as np
import pytest
from blows import MOTION, log, scene
from pages import text_of_a_page_that_stands_on_its_own
from scipy.spatial.transform import Rotation

from experiments.lab import experiment
from experiments.measured import __main__ as measured
from experiments.measured import blows, hits, tosses
from impact_gym.physics.impact import GRAVITY, free_tool, sliding_distance

E, MU = 0.6, 0.25
COLUMNS = {"distance": "way", "flux": "phi", "by": ["arm"], "repeat": ["asked"], "at_least": {"way": 0.01}}
SCENE = """
[environment]
tool_mass = 0.125
coupling = { type = "SpringDamper", stiffness = 150.0, damping_ratio = 1.0 }
[environment.scenario]
object_mass = 1.0
contact_stiffness = 1e4
restitution = 0.8
distance = 0.2505
[motion]
speed = 1.0
acceleration = 8.0
brake = { threshold = 1.0, delay = 0.016 }
"""
FREE = ("contact.stiffness", "contact.restitution", "object.mass")


def written(folder, count=400, noise=0.1, seed=0, bad=()):
    """A table of hits that our closed forms make, distances off by a share; rows that are none on top."""
    rng, path = np.random.default_rng(seed), folder / "hits.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["arm", "asked", "phi", "way"])
        for k in range(count):
            asked = 0.5 + 0.1 * (k // 2 % 5)
            speed, mass, target = 2.0 * asked * rng.normal(1.0, 0.02), 4.0, 1.2
            kept = float(free_tool(mass, target, speed, 0.0, E)[1])
            way = float(sliding_distance(kept, MU)) * np.exp(rng.normal(0.0, noise))
            writer.writerow([k % 2, f"{asked:.1f}", mass * speed / (mass + target), way])
        writer.writerows(bad)
    return path


def page(folder, compute, show, figures):
    """The tables, and the text of the page that is made of them."""
    made = {}
    tables = lambda gather: made.setdefault("tables", compute(gather))  # noqa: E731
    experiment.run("measured", folder, "test", tables, show, processes=0)
    return made["tables"], text_of_a_page_that_stands_on_its_own(folder, figures=figures)


def test_one_number_is_found_and_its_error_on_other_hits_is_that_of_repeats(tmp_path):
    none = [[0, "x", "nan", 1.0], [0, "x", 0.5, ""], [0, "x", 0.5, -1.0]]
    one, two = hits.read(written(tmp_path, 2000, bad=none), **COLUMNS)
    assert (one.name, len(one.flux), one.left_out, two.left_out) == ("hits arm 0", 1000, 3, 0)
    assert hits.number_of(one) == pytest.approx((1 + E) ** 2 / (2 * MU * 9.80665), rel=0.02)
    middle, most, held = hits.errors(one, hits.BLOW)
    assert middle == pytest.approx(0.06745, rel=0.1)  # of exp(N(0, 0.1))
    assert most == pytest.approx(0.196, rel=0.15)
    assert held == pytest.approx(0.95, abs=0.02)
    # the speeds of equal hits differ by 2 %, which moves a distance by 4 %
    assert hits.errors(one, hits.EQUAL)[0] == pytest.approx(0.06745 * np.hypot(1.0, 0.4), rel=0.1)
    assert hits.errors(one, hits.BLOW, two)[0] == pytest.approx(middle, rel=0.15)
    nothing_equal = hits.Hits("", one.flux, one.distance, np.full(1000, ""))
    assert all(np.isnan(hits.errors(nothing_equal, hits.EQUAL)))


def test_page_of_hits_stands_on_its_own(tmp_path):
    sets = hits.read(written(tmp_path), **COLUMNS)
    tables, text = page(tmp_path / "page", lambda gather: measured.hits_computed(sets, gather),
                        lambda tables: measured.hits_shown(sets, tables), 1)  # fmt: skip
    assert all(each.name in text for each in sets)
    assert all(0.5 < row["over_repeats"] < 1.2 for row in tables["sets"])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Blows of the independent solver at one speed, in CSV files, and in one HDF5 file."""
    h5py = pytest.importorskip("h5py")
    folder = tmp_path_factory.mktemp("blows")
    logs = [log(scene(2e5, 0.4), seed=seed, columns=("force", "object_velocity")) for seed in range(8)]
    with h5py.File(folder / "blows.h5", "w") as file:
        for k, columns in enumerate(logs):
            np.savetxt(folder / f"{k}.csv", np.column_stack(list(columns.values())), delimiter=",",
                       header=",".join(columns), comments="")  # fmt: skip
            for name, values in columns.items():
                file.create_dataset(f"blow {k}/{name}", data=values)
    return folder


def test_other_half_of_blows_is_predicted_by_the_chain_that_made_them_and_not_by_a_fixed_tool(recorded, tmp_path):
    made = blows.read_blows([recorded / "blows.h5"], tomllib.loads(SCENE), FREE)
    assert [motion.speed for motion in made.motions] == [MOTION.speed] * 8
    tables, text = page(tmp_path, lambda gather: measured.blows_computed(made, gather), measured.blows_shown, 1)
    found = {(row["model"], row["measure"]): row for row in tables["models"]}
    assert list(blows.models(made)) == [name for name in blows.MODELS if name != "robot rigid"]  # there is none
    assert f"<b>{blows.AS_IT_IS}</b>" in text
    (unfit,) = tables["unfit"]
    assert unfit["model"] == "tool fixed to a rigid flange"
    assert "has 2 blows" in unfit["reason"]
    assert found[blows.AS_IT_IS, "object_velocity"]["error"] < 0.01  # noise of 2 % over 40 samples
    assert found[blows.AS_IT_IS, "impulse"]["error"] < 0.02
    held = [found[blows.AS_IT_IS, measure]["held"] for measure in blows.MEASURES]
    assert np.mean(held) > 0.8  # of 32; 95 % are expected
    for row in tables["fits"]:
        if row["model"] == blows.AS_IT_IS:
            truth = dict(zip(FREE, (2e5, 0.4, 0.25), strict=True))[row["number"]]
            assert row["value"] == pytest.approx(truth, rel=0.1)


def test_files_of_blows_are_the_same_blows_whatever_their_format(recorded):
    content = tomllib.loads(SCENE.replace("speed = 1.0", "speed = [1.0, 1.0, 0.9, 1.0]"))
    made = blows.read_blows([recorded / f"{k}.csv" for k in range(4)], content, FREE)
    assert [motion.speed for motion in made.motions] == [1.0, 1.0, 0.9, 1.0]
    other = blows.read_blows([recorded / "blows.h5"], tomllib.loads(SCENE), FREE)
    for one, two in zip(made.logs, other.logs, strict=False):
        np.testing.assert_allclose(one.columns["force"], two.columns["force"], rtol=1e-15)


@pytest.mark.parametrize(("files", "scene_text", "message"), [
    (["0.csv"], SCENE, "4 logs of blows or more are needed, half of them to fit, got 1"),
    (["blows.h5"], SCENE.replace("speed = 1.0", "speed = [1.0]"), "must be one number or one for each of 8"),
    (["blows.h5"], SCENE.replace("speed = 1.0", "speed = -1.0"), "speed must be"),
    (["scene.h5"], SCENE, "scene.h5 is not read as HDF5"),
])  # fmt: skip
def test_blows_that_are_none_are_refused_in_one_line(files, scene_text, message, recorded):
    (recorded / "scene.h5").write_text("no HDF5")
    with pytest.raises(ValueError, match=message) as refusal:
        blows.read_blows([recorded / name for name in files], tomllib.loads(scene_text), FREE)
    assert "\n" not in str(refusal.value)


def toss(restitution, seed):
    """Frames of a cube that flies, strikes a corner, whose vertical velocity turns by the restitution, flies on.

    By an impulse along z: of a cube of mass 1, tensor (edge^2 / 6), at the lever of the corner.
    """
    rng, edge = np.random.default_rng(seed), 2.0 * tosses.HALF_EDGE
    down = Rotation.align_vectors([[0.0, 0.0, -1.0]], [tosses.CORNERS[0]])[0]
    turn, rate = Rotation.from_rotvec(rng.normal(size=3) * 0.1) * down, rng.normal(size=3) * 2.0
    lever = turn.apply(tosses.CORNERS)[turn.apply(tosses.CORNERS)[:, 2].argmin()]
    height, speed, begin = -lever[2], -rng.uniform(0.8, 1.4), 10.4 * tosses.STEP
    corner = speed + np.cross(rate, lever)[2]
    arm = np.cross(lever, [0.0, 0.0, 1.0]) * 6.0 / edge**2
    impulse = -(1.0 + restitution) * corner / (1.0 + np.cross(arm, lever)[2])
    rows = []
    for k in range(16):
        time = k * tosses.STEP - begin
        after = time > 0.0
        v, w = (speed + impulse, rate + impulse * arm) if after else (speed, rate)
        quaternion = np.roll((Rotation.from_rotvec(w * time) * turn).as_quat(), 1)
        rows.append([0.0, 0.0, height + v * time - 0.5 * GRAVITY * time**2, *quaternion])
    return np.array(rows)


def test_restitution_of_a_corner_is_that_of_the_impulse_that_turned_it():
    for seed in range(5):
        approach, separation = tosses.touch(toss(0.4, seed))
        assert separation / approach == pytest.approx(0.4, abs=0.01)  # the instant of the touch is found to 34 us
    flat = toss(0.4, 0)
    flat[:, 3:7] = [1.0, 0.0, 0.0, 0.0]
    assert tosses.touch(flat) is None  # four corners at once


def test_page_of_tosses_stands_on_its_own_and_other_files_are_refused(tmp_path):
    torch = pytest.importorskip("torch")
    paths = [tmp_path / f"{k}.pt" for k in range(3)]
    for k, path in enumerate(paths):
        frames = toss(0.3, k)
        frames[:, :3] /= tosses.HALF_EDGE
        torch.save(torch.tensor(frames), path)
    rows = tosses.restitutions(paths)
    _, text = page(tmp_path / "page", lambda gather: {"restitution": rows}, measured.tosses_shown, 0)
    assert f"{rows[0]['e']:.3f}" in text
    (tmp_path / "bad.pt").write_text("no tensor")
    torch.save(torch.zeros(3), tmp_path / "short.pt")
    for name, message in (("bad", "bad.pt is not read as a tensor"), ("short", "must have frames of 7 finite numbers")):
        with pytest.raises(ValueError, match=message) as refusal:
            tosses.read(tmp_path / f"{name}.pt")
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("change", "message"), [
    ({"flux": "speed"}, r"hits.csv has no column 'speed', there are \['arm'"),
    ({"by": ["asked", "arm", "phi"]}, "hits.csv has sets of .* hits, 20 or more are needed"),
    ({"at_least": {"way": 1e9}}, r"hits.csv has sets of \[0, 0\] hits"),
])  # fmt: skip
def test_tables_that_are_none_are_refused_in_one_line(change, message, tmp_path):
    with pytest.raises(ValueError, match=message) as refusal:
        hits.read(written(tmp_path), **COLUMNS | change)
    assert "\n" not in str(refusal.value)


def test_log_of_one_blow_needs_its_scene(tmp_path):
    (tmp_path / "log.csv").write_text("time,force\n0,1\n1,2\n")
    with pytest.raises(ValueError, match=r"is the log of one blow, not a table of hits: give what is known .* --scene"):
        hits.read(tmp_path / "log.csv", **COLUMNS)
    for text in ("way", "=3", "way=x", "way=inf"):
        with pytest.raises(ValueError, match="at_least must be COLUMN=NUMBER"):
            hits.least([text])
