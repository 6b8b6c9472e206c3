"""Folders of results are whole or not there, and nothing that no run wrote is replaced."""

import os
from pathlib import Path

import pytest

from experiments.lab.results import whole_folder


def test_a_folder_is_replaced_whole_or_not_at_all(tmp_path):
    target = tmp_path / "latest"
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text("first")

    def break_off():
        with whole_folder(target) as unfinished:
            (unfinished / "page").write_text("half")
            raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        break_off()
    assert (target / "page").read_text() == "first"
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text("second")
    assert (target / "page").read_text() == "second"
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


def test_an_interrupted_swap_brings_the_old_folder_back(tmp_path, monkeypatch):
    target = tmp_path / "latest"
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text("first")
    move = os.replace

    def replace(source, destination):
        if Path(destination) == target and Path(source).name != target.name:
            raise KeyboardInterrupt
        move(source, destination)

    def swap():
        monkeypatch.setattr(os, "replace", replace)
        with whole_folder(target) as unfinished:
            (unfinished / "page").write_text("second")

    with pytest.raises(KeyboardInterrupt):
        swap()
    assert (target / "page").read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


def test_a_folder_that_no_run_wrote_is_left_alone(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter").write_text("dear")
    with pytest.raises(ValueError, match="mine is not replaced"), whole_folder(tmp_path / "mine"):
        pass
    assert (tmp_path / "mine" / "letter").read_text() == "dear"
