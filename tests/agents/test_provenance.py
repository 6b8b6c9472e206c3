"""What a result was made with."""

import runpy
import shutil
import subprocess

import pytest

from agents import provenance


@pytest.fixture
def git(tmp_path):
    """Runs git in a repository of its own, and returns what it says."""

    def run(*command):
        author = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org")
        done = subprocess.run(["git", *author, *command], cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    run("init", "--quiet")
    return run


def test_revision_names_the_commit_of_sources_that_git_knows_and_none_of_others(tmp_path, git):
    file = tmp_path / "provenance.py"
    shutil.copy(provenance.__file__, file)
    git("commit", "--quiet", "--allow-empty", "--message=somebody else's")
    assert runpy.run_path(str(file))["revision"]() == {"commit": None, "changed since": None}
    git("add", file.name)
    git("commit", "--quiet", "--message=ours")
    assert runpy.run_path(str(file))["revision"]() == {"commit": git("rev-parse", "HEAD"), "changed since": ""}
    file.write_text(file.read_text() + "\n")
    changed = runpy.run_path(str(file))["revision"]()["changed since"]
    assert changed.split() == ["M", "provenance.py"]
