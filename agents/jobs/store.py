"""Results on disk: one archive for each job, whole or not there, named by the job's key."""

from pathlib import Path

from tqdm import tqdm  # type: ignore[import-untyped]

from agents.archive import read_archive, write_archive
from agents.jobs.job import Job, Result

FORMAT = "impact_gym job result 1"


class Store:
    """A folder of results; only the process that gathers writes to it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def path(self, key: str) -> Path:
        """Return where the result of a job is kept."""
        return self.folder / f"{key}.npz"

    def read(self, key: str) -> Result | None:
        """Return the result of a job, None where there is none or a damaged one."""
        path = self.path(key)
        if not path.is_file():
            return None
        try:
            content, arrays = read_archive(path, FORMAT)
            if content["key"] != key:
                raise ValueError(f"{path} is the result of another job")
        except (LookupError, ValueError) as error:
            tqdm.write(f"computed anew: {error}")
            return None
        return arrays

    def write(self, job: Job, result: Result) -> None:
        """Keep a result."""
        content = {"key": job.key, "function": job.function, "arguments": job.arguments, "depends": job.depends}
        write_archive(self.path(job.key), FORMAT, content, result)
