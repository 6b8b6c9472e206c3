"""Atomic writing of files, through links, and never over anything but a file; locks."""

import os

import pytest

from impact_gym.files import locked, write_file


def test_write_file_writes_through_links_and_keeps_them(tmp_path):
    target, link = tmp_path / "there" / "it.txt", tmp_path / "link.txt"
    (tmp_path / "link to link").symlink_to(link)
    link.symlink_to("there/it.txt")  # does not exist yet
    for text in ("first", "second"):
        assert write_file(tmp_path / "link to link", text) == tmp_path / "link to link"
        assert (target.is_symlink(), target.read_text()) == (False, text)
    assert os.readlink(link) == "there/it.txt"
    assert sorted(os.listdir(tmp_path / "there")) == ["it.txt"]


@pytest.mark.parametrize("kind", ["pipe", "ring", "link to a pipe"])
def test_write_file_keeps_anything_but_a_file(tmp_path, kind):
    path = tmp_path / "it"
    if kind == "ring":
        path.symlink_to(path)
    else:
        os.mkfifo(tmp_path / "pipe" if kind.startswith("link") else path)
        if kind.startswith("link"):
            path.symlink_to("pipe")
    before = os.lstat(path)
    with pytest.raises(OSError, match=rf"{path} must be a file .*nothing is written"):
        write_file(path, "text")
    assert (os.lstat(path).st_ino, os.lstat(path).st_mode) == (before.st_ino, before.st_mode)
    assert {*os.listdir(tmp_path)} <= {"it", "pipe"}
    assert (tmp_path / "pipe").is_fifo() == kind.startswith("link")


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/null", path)])
def test_lock_that_is_no_regular_file_is_refused_at_once(tmp_path, make):
    make(tmp_path / ".lock")
    with pytest.raises(ValueError, match=r"\.lock must be a regular file"), locked(tmp_path / ".lock"):
        pass
