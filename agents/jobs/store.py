"""Results on disk: one SQLite file in a folder, a row for each job, whole or not there, found by the job's key."""

import io
import sqlite3
from dataclasses import asdict
from pathlib import Path

from tqdm import tqdm

from agents.archive import DAMAGE, load, save
from agents.jobs.job import Failure, Job, Result
from impact_gym.files import writing

FORMAT = "impact_gym job result 1"
NAME = "results.sqlite"
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
PATIENCE = 60.0  # s, while another process writes


class Store:
    """The results in a folder; several processes may read and write them. To be closed."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / NAME
        with writing(f"results into {self.path}"):
            try:
                self._open()
            except sqlite3.DatabaseError as error:
                self._begin_anew(error)

    def _open(self) -> None:
        self._database = sqlite3.connect(self.path, PATIENCE, isolation_level=None, check_same_thread=False)
        # a power cut may cost the last results, a crash of this process none
        self._database.executescript("PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL")
        self._database.execute("CREATE TABLE IF NOT EXISTS results (key TEXT PRIMARY KEY, answer BLOB)")

    def _begin_anew(self, error: sqlite3.DatabaseError) -> None:
        """Put a file that is no database, or no longer, aside; raise any other error."""
        if error.sqlite_errorcode not in DAMAGED:
            raise error
        tqdm.write(f"computed anew: {self.path} is damaged ({error}), and now {NAME}.damaged")
        self.close()
        self.path.replace(self.path.with_name(f"{NAME}.damaged"))
        for beside in ("-wal", "-shm"):
            self.path.with_name(NAME + beside).unlink(missing_ok=True)
        self._open()

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def __len__(self) -> int:
        return int(self._database.execute("SELECT count(*) FROM results").fetchone()[0])

    def read(self, key: str) -> Result | Failure | None:
        """Return the result of a job, or its failure where that was kept; None where there is none or it is damaged."""
        try:
            row = self._database.execute("SELECT answer FROM results WHERE key = ?", (key,)).fetchone()
        except sqlite3.DatabaseError as error:
            self._begin_anew(error)
            return None
        if row is None:
            return None
        try:
            content, arrays = load(io.BytesIO(row[0]), FORMAT)
            if content["key"] != key:
                raise ValueError("it is the result of another job")
            return Failure(**content["failure"]) if "failure" in content else arrays
        except DAMAGE as error:
            tqdm.write(f"computed anew: {key} in {self.path}: {error}")
            return None

    def write(self, job: Job, answer: Result | Failure) -> None:
        """Keep a result, or a failure that counts as one."""
        content = {"key": job.key, "function": job.function}  # the key stands for the arguments, which may be large
        more, arrays = ({"failure": asdict(answer)}, {}) if isinstance(answer, Failure) else ({}, answer)
        packed = io.BytesIO()
        save(packed, FORMAT, content | more, arrays)
        with writing(f"a result of {job.function} into {self.path}"):
            self._database.execute("INSERT OR REPLACE INTO results VALUES (?, ?)", (job.key, packed.getbuffer()))
