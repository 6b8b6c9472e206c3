"""A job as plain data: what its key depends on, and what is no job."""

import re
from pathlib import Path

import numpy as np
import pytest

from agents.jobs import Job, digest_of


def test_the_key_is_that_of_all_that_determines_the_result():
    job = Job("cluster_work:numbers", {"log": "x", "number": 1})
    function = Job("cluster_work:fails_on", {"log": "x", "number": 1, "bad": []})
    arguments = Job("cluster_work:numbers", {"log": "x", "number": 2})
    sources = Job("cluster_work:numbers", {"log": "x", "number": 1}, depends=digest_of("impact_gym.files"))
    assert len({one.key for one in (job, function, arguments, sources)}) == 4
    assert Job("cluster_work:numbers", {"number": 1, "log": "x"}).key == job.key
    given = {"log": "x", "number": 1, "bad": [1]}
    later = Job("cluster_work:fails_on", given)
    key = later.key
    given["bad"].append(2)
    assert later.key == key


def test_a_digest_changes_with_any_source_of_the_module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    inner = tmp_path / "package_of_jobs" / "inner"
    inner.mkdir(parents=True)
    (inner.parent / "__init__.py").touch()
    (inner / "__init__.py").write_text("ONE = 1\n")
    before = digest_of("package_of_jobs"), digest_of("package_of_jobs.inner")
    assert digest_of("package_of_jobs") == before[0]
    (inner / "data.json").write_text("{}")
    assert digest_of("package_of_jobs") != before[0]
    assert digest_of("package_of_jobs.inner") != before[1]
    with pytest.raises(ValueError, match="no module 'not_there'"):
        digest_of("not_there")


@pytest.mark.parametrize(("function", "arguments", "kind", "said"), [
    ("cluster_work", {}, ValueError, "'module:name'"),
    ("cluster_work:", {}, ValueError, "'module:name'"),
    (7, {}, TypeError, "'module:name'"),
    ("not_there:play", {}, ValueError, "not importable"),
    ("cluster_work:not_there", {}, ValueError, "not importable"),
    ("cluster_work:__doc__", {}, ValueError, "no function"),
    ("__main__:play", {}, ValueError, "put it into a module"),
    ("cluster_work:numbers", [], TypeError, "must be a mapping"),
    ("cluster_work:numbers", {"log": "x"}, TypeError, "missing a required argument: 'number'"),
    ("cluster_work:numbers", {"log": "x", "number": 1, "more": 1}, TypeError, "'more'"),
    ("cluster_work:numbers", {"log": "x", "number": float("nan")}, ValueError, "finite"),
    ("cluster_work:numbers", {"log": "x", "number": (1, 2)}, TypeError, "what JSON holds"),
    ("cluster_work:numbers", {"log": "x", "number": {1: 2}}, TypeError, "what JSON holds"),
    ("cluster_work:numbers", {"log": Path("x"), "number": 1}, TypeError, "what JSON holds"),
    ("cluster_work:numbers", {"log": "x", "number": np.array([1.0])}, TypeError, "what JSON holds"),
])  # fmt: skip
def test_what_is_no_job_is_refused_with_the_reason(function, arguments, kind, said):
    with pytest.raises(kind, match=re.escape(said)):
        Job(function, arguments)
