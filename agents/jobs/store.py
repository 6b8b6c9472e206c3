"""Results on disk: one archive for each job, whole or not there, named by the job's key."""

from dataclasses import asdict
from pathlib import Path

from tqdm import tqdm  # type: ignore[import-untyped]

from agents.archive import read_archive, write_archive
from agents.jobs.job import Job
from agents.jobs.work import Answer, Failure

FORMAT = "impact_gym job result 1"


class Store:
    """A folder of results; only the process that gathers writes to it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def path(self, key: str) -> Path:
        """Return where the result of a job is kept."""
        return self.folder / f"{key}.npz"

    def read(self, key: str) -> Answer | None:
        """Return the result of a job, or its failure where that was kept; None where there is none or it is damaged."""
        path = self.path(key)
        if not path.is_file():
            return None
        try:
            content, arrays = read_archive(path, FORMAT)
            if content["key"] != key:
                raise ValueError(f"{path} is the result of another job")
            return Failure(**content["failure"]) if "failure" in content else arrays
        except (LookupError, ValueError) as error:
            tqdm.write(f"computed anew: {error}")
            return None

    def write(self, job: Job, answer: Answer) -> None:
        """Keep a result, or a failure that counts as one; what a power cut damages will be computed anew."""
        content = {"key": job.key, "function": job.function, "arguments": job.arguments, "depends": job.depends}
        failed = isinstance(answer, Failure)
        more, arrays = ({"failure": asdict(answer)}, {}) if failed else ({}, answer)
        write_archive(self.path(job.key), FORMAT, content | more, arrays, durable=False)
