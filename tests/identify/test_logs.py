"""What a log may look like without being refused, and which one is too late."""

import numpy as np
import pytest
from quick_log import CLEAN, FLAT, FORCE, NOISE, SCENE, TIME, put
from recorder import MOTION

import impact_gym as ig
from impact_gym.identify.coordinates import free_coordinates
from impact_gym.identify.log import Log, check, read
from impact_gym.identify.model import IMPOSSIBLE, Model


def test_coarse_or_gently_rounded_sensor_is_not_taken_for_a_saturated_one():
    coarse = np.round(CLEAN + 0.002 * CLEAN.max() * NOISE)  # N: several equal values at the top
    assert np.sum(coarse == coarse.max()) >= 3
    bottom = np.where(FLAT == 2.5, 2.0, FLAT)  # beside it 3 resolutions away, no more
    for force in (coarse, bottom):
        check(Log("blow", TIME[: len(force)], {"force": force}), SCENE, MOTION, {"force": ig.Sensor()})


def test_sample_is_taken_for_another_blow_from_six_standard_deviations():
    noise = CLEAN.max() / 25.0

    def fit(height):
        log = {"time": TIME, "force": put(CLEAN, 9, height * noise)}  # before the touch
        ig.identify(log, SCENE, MOTION, ("contact.stiffness",), ig.Sensor(noise=noise))

    fit(5.5)
    with pytest.raises(ValueError, match=f"has 2 blows, at {TIME[9]:g}, .* the scene makes no more than 1"):
        fit(6.5)


def test_file_with_the_byte_order_mark_of_excel_is_read(tmp_path):
    for encoding in ("utf-8", "utf-8-sig"):
        lines = "\r\n".join(["time,force", *(f"{time},{force}" for time, force in zip(TIME, FORCE, strict=True))])
        (tmp_path / "log.csv").write_text(lines, encoding)
        assert np.array_equal(read(tmp_path / "log.csv", "").columns["force"], FORCE)


def test_start_so_early_that_the_log_ends_when_the_blow_is_over_is_impossible_and_not_simulated():
    coordinates = free_coordinates(SCENE, ("object.mass",))
    model = Model.of(
        [read({"time": TIME, "force": FORCE}, "blow")], SCENE, [MOTION], {"force": ig.Sensor()}, coordinates
    )
    latest, mass = TIME[-1] - model.latest(SCENE, 0), coordinates[0].start(SCENE)
    for start, impossible in ((latest - 0.01, True), (latest + 0.01, False)):
        assert (np.abs(model.predicted(np.array([mass, start]))[0]) == IMPOSSIBLE * np.ptp(FORCE)).all() == impossible
        assert model.simulations == (0 if impossible else 1)
