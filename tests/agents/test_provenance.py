"""What a result was made with."""

import runpy
import shutil
import subprocess

from agents import provenance


def test_revision_names_the_commit_of_sources_that_git_knows_and_none_of_others(tmp_path):
    def git(*command):
        author = ("-c", "user.name=Somebody", "-c", "user.email=somebody@example.org")
        return subprocess.check_output(["git", *author, *command], cwd=tmp_path, text=True).strip()

    def revision():
        return runpy.run_path(str(file))["revision"]()

    file = tmp_path / "provenance.py"
    shutil.copy(provenance.__file__, file)
    git("init", "--quiet")
    git("commit", "--quiet", "--allow-empty", "--message=somebody else's")
    assert revision() == {"commit": None, "changed since": None}
    git("add", file.name)
    git("commit", "--quiet", "--message=ours")
    assert revision() == {"commit": git("rev-parse", "HEAD"), "changed since": ""}
    file.write_text(file.read_text() + "\n")
    assert revision()["changed since"].split() == ["M", "provenance.py"]
