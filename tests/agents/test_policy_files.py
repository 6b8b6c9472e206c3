"""Files of policies: what they hold, what is refused."""

import gc
import io
import itertools
import json
import os
import pickle
import subprocess
import sys
import warnings
import zipfile

import numpy as np
import pytest
from policies import KINDS, made_up_policy, observations

from agents import archive, load_policy
from agents.policies.networks import to_arrays
from agents.policies.policy import FORMAT

DAMAGED = r"policy\.npz is no impact_gym policy 2 file, or is damaged"


@pytest.fixture
def path(tmp_path):
    """The file of a made-up policy."""
    return made_up_policy().save(tmp_path / "policy.npz")


def assert_same_weights(one, other):
    pair = to_arrays(one.network), to_arrays(other.network)
    assert list(pair[0]) == list(pair[1])
    for name in pair[0]:
        assert pair[0][name].dtype == pair[1][name].dtype
        assert np.array_equal(pair[0][name], pair[1][name])


@pytest.mark.parametrize("kind", KINDS)
def test_a_policy_survives_its_file_bit_for_bit(tmp_path, kind):
    policy = made_up_policy(**KINDS[kind])
    path = policy.save(tmp_path / "new" / "policy.npz")
    assert [file.name for file in path.parent.iterdir()] == ["policy.npz"]
    again = load_policy(path)
    for name in ("inputs", "provenance", "environment", "observation_table"):
        assert getattr(again, name) == getattr(policy, name)
    assert_same_weights(again, policy)
    seen = observations(policy, 100)
    assert np.array_equal(again.predict(seen)[0], policy.predict(seen)[0])


def test_a_policy_is_played_without_torch(tmp_path):
    for kind, arguments in KINDS.items():
        made_up_policy(**arguments).save(tmp_path / f"{kind}.npz")
    code = (
        "import sys, numpy, pathlib; from agents import load_policy\n"
        "for path in pathlib.Path(sys.argv[1]).iterdir():\n"
        "    policy = load_policy(path); policy.predict(numpy.zeros((3, policy.inputs), numpy.float32))\n"
        "print('torch' in sys.modules, 'stable_baselines3' in sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["False", "False"]


def test_a_file_says_what_is_seen_and_commanded_in_which_units(tmp_path):
    path = made_up_policy(environment={"range_noise": 0.01}).save(tmp_path / "policy.npz")
    content, _ = archive.read_archive(path, FORMAT)
    *_, weight, estimate = (entry["name"] for entry in content["observation"])
    assert (weight, estimate) == ("time weight", "distance estimate minus flange position")
    assert content["observation"][1] == {
        "name": "flange velocity", "unit": "m/s", "low": -0.5, "high": 1.5, "scaled_low": -1.0,
    }  # fmt: skip
    assert [(entry["low"], entry["high"], entry["unit"]) for entry in content["action"]] == [
        (-0.5, 1.5, "m/s"), (1.0, 20.0, "m/s^2"),
    ]  # fmt: skip


def test_a_policy_for_other_scales_is_refused(path):
    content, arrays = archive.read_archive(path, FORMAT)
    for table, field in (("observation", "high"), ("action", "low")):
        changed = json.loads(json.dumps(content))
        changed[table][1][field] += 0.5
        archive.write_archive(path, FORMAT, changed, arrays)
        with pytest.raises(ValueError, match=r"policy\.npz was made for other scales"):
            load_policy(path)
    archive.write_archive(path, FORMAT, {**content, "environment": {"range_noise": 0.01}}, arrays)
    with pytest.raises(ValueError, match="takes 8 numbers, the environment shows 9"):
        load_policy(path)


def arrays_of(path):
    with np.load(path) as file:
        return dict(file)


class Bomb:
    """Unpickled, it makes a folder."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_reading_a_policy_runs_no_code(path, tmp_path):
    mark, good = tmp_path / "code ran", arrays_of(path)
    np.savez(path, **good)
    assert load_policy(path).inputs == 8
    for name in good:
        np.savez(path, **{**good, name: np.array([Bomb(mark)], object)})
        with pytest.raises(ValueError, match="pickled objects, which are never loaded"):
            load_policy(path)
    pickled = pickle.dumps(Bomb(mark))
    path.write_bytes(pickled)
    with pytest.raises(ValueError, match=DAMAGED):
        load_policy(path)
    assert not mark.exists()
    pickle.loads(pickled)
    assert mark.exists()


def layers(**changed):
    """Return the content of a file with one layer, some of it changed, and its arrays."""
    network = {"activation": "tanh", "layers": ["mean", "log_std"]}
    content = {"network": network, "environment": {}, "provenance": {}}
    arrays = {"mean.weight": np.zeros((2, 8)), "mean.bias": np.zeros(2)}
    arrays |= {name.replace("mean", "log_std"): array for name, array in arrays.items()}
    arrays = {name: array.astype(np.float32) for name, array in arrays.items()}
    for name, value in changed.items():
        if name in content:
            content[name] = value
        elif name in network:
            network[name] = value
        else:
            arrays[name.replace("__", ".")] = value
    return content, arrays


@pytest.mark.parametrize(("changed", "message"), [
    ({"layers": ["mean"]}, "log_std"),
    ({"layers": ["mean", "log_std", "hidden_0"]}, "hidden_0"),
    ({"layers": []}, "mean"),
    ({"layers": 3}, ""),
    ({"network": {"squash": True, "layers": ["mean", "log_std"]}}, "squashed or recurrent"),
    ({"layers": ["gates", "mean", "log_std"]}, "squashed or recurrent"),
    ({"activation": "gelu"}, "activation must be one of"),
    ({"network": {}}, "layers"),
    ({"environment": {"range_noise": -1.0}}, "range_noise"),
    ({"environment": {"gravity": 9.8}}, "gravity"),
    ({"mean__weight": np.zeros((3, 8), np.float32)}, "fit"),
    ({"mean__weight": np.zeros(8, np.float32)}, "fit"),
    ({"mean__weight": np.zeros((2, 9), np.float32)}, "shape of mean"),
    ({"mean__bias": np.array([0.0, np.nan], np.float32)}, "finite"),
    ({"mean__bias": np.array(["a", "b"])}, "float32"),
    ({"mean__weight": np.zeros((2, 8), complex)}, "float32"),
], ids=itertools.count())  # fmt: skip
def test_an_archive_that_is_no_policy_is_refused(path, changed, message):
    archive.write_archive(path, FORMAT, *layers(**changed))
    with pytest.raises(ValueError, match=rf"policy\.npz is no policy: .*{message}"):
        load_policy(path)


def test_an_archive_of_another_kind_is_refused(path):
    archive.write_archive(path, "impact_gym policy 9", *layers())
    with pytest.raises(ValueError, match=r"policy 9.*policy 2"):
        load_policy(path)


def test_files_of_other_kinds_are_refused(path):
    stream, zipped = io.BytesIO(), io.BytesIO()
    np.save(stream, np.zeros(3))
    with zipfile.ZipFile(zipped, "w") as file:
        file.writestr("header.npy", "not an array")
    kinds = [b"", b"PK", b"text", b"\x80\x04", stream.getvalue(), zipped.getvalue(), bytes(range(256)) * 20]
    for content in kinds:
        path.write_bytes(content)
        with pytest.raises(ValueError, match=DAMAGED):
            load_policy(path)


def test_a_truncated_or_altered_file_is_refused_or_harmless(path):
    policy, whole, rng = load_policy(path), path.read_bytes(), np.random.default_rng(0)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for length in [*rng.integers(0, len(whole), 60), len(whole) - 1]:
            path.write_bytes(whole[:length])
            with pytest.raises(ValueError, match=DAMAGED):
                load_policy(path)
        gc.collect()
    refused = 0
    for place in range(0, len(whole), 3):
        altered = bytearray(whole)
        altered[place] ^= int(rng.integers(1, 256))
        path.write_bytes(altered)
        try:
            found = load_policy(path)
        except ValueError:
            refused += 1
        else:
            assert_same_weights(found, policy)
            assert found.provenance == policy.provenance
    assert refused > len(whole) / 6
    assert {str(warning.message) for warning in caught} == set()  # such as a file left open


def test_an_altered_file_that_is_whole_is_refused(path):
    """As zip sees it: what is inside was changed by somebody who wrote the archive anew."""
    arrays = arrays_of(path)
    header = str(arrays["header"])
    assert "by hand" in header
    for changed in ({"mean.bias": arrays["mean.bias"] * 2}, {"header": np.array(header.replace("by hand", "by foot"))}):
        np.savez(path, **{**arrays, **changed})
        with pytest.raises(ValueError, match="checksum"):
            load_policy(path)


def test_an_unknown_name_lists_what_is_shipped():
    with pytest.raises(FileNotFoundError, match=r"'linear-blnd'.*linear-blind"):
        load_policy("linear-blnd")
