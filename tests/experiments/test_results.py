"""Folders of results are whole or not there, and nothing that no run wrote is replaced."""

import os
from pathlib import Path

import pytest

from experiments.lab.results import whole_folder


def write(target, text, problem=None):
    with whole_folder(target) as unfinished:
        (unfinished / "page").write_text(text)
        if problem:
            raise problem


def test_whole_folder_is_replaced_whole_or_not_at_all(tmp_path):
    target = tmp_path / "latest"
    write(target, "first")
    with pytest.raises(OSError, match="no room"):
        write(target, "half", OSError("no room"))
    assert (target / "page").read_text() == "first"
    write(target, "second")
    assert (target / "page").read_text() == "second"
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


def test_whole_folder_brings_the_old_one_back_when_interrupted(tmp_path, monkeypatch):
    target, move = tmp_path / "latest", os.replace
    write(target, "first")

    def replace(source, destination):
        if Path(destination) == target and Path(source).name != target.name:
            raise KeyboardInterrupt
        move(source, destination)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(KeyboardInterrupt):
        write(target, "second")
    assert (target / "page").read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


def test_whole_folder_leaves_alone_what_no_run_wrote(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter").write_text("dear")
    with pytest.raises(ValueError, match="mine is not replaced"):
        write(tmp_path / "mine", "first")
    assert (tmp_path / "mine" / "letter").read_text() == "dear"
