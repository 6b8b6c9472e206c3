"""Learning curves as CSV and for TensorBoard, which a resumed run goes on with."""

import csv
import os
from pathlib import Path

from stable_baselines3.common.logger import CSVOutputFormat, KVWriter, TensorBoardOutputFormat
from torch.utils.tensorboard.writer import SummaryWriter

from impact_gym.files import write_file

STEPS = "time/total_timesteps"


class _Csv(CSVOutputFormat):
    """Goes on behind what a file holds up to `steps`; what was logged behind a checkpoint will be logged again."""

    def __init__(self, path: Path, steps: int) -> None:
        lines = path.read_text().splitlines(keepends=True) if path.is_file() else []
        columns = next(csv.reader(lines[:1]), [])
        kept = [line for line in lines[1:] if line.endswith("\n") and _steps(line, columns) <= steps]
        write_file(path, "".join(lines[:1] + kept))
        super().__init__(os.devnull)  # which would empty the file
        self.file.close()
        self.file, self.keys = path.open("r+"), columns
        self.file.seek(0, os.SEEK_END)


def _steps(line: str, columns: list[str]) -> float:
    """Return after how many steps a line was logged; a broken one: never."""
    row = dict(zip(columns, next(csv.reader([line])), strict=False))
    return float(row.get(STEPS) or "inf")


class _TensorBoard(TensorBoardOutputFormat):
    """Tells TensorBoard to forget what an interrupted run logged behind its checkpoint."""

    def __init__(self, folder: Path, steps: int) -> None:
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=steps + 1 if steps else None)
        self._is_closed = False


def outputs(folder: Path, steps: int) -> list[KVWriter]:
    """Return writers into `folder` for a run that has made `steps` steps."""
    return [_Csv(folder / "progress.csv", steps), _TensorBoard(folder, steps)]
