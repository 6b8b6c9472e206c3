"""A callback that validates, logs, and saves policies and checkpoints."""

import csv
import io
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from agents.evaluate.scenario_batch import Validation
from agents.policies.policy import Policy
from agents.setups import Setup, Training
from agents.train import checkpoint
from impact_gym.support.files import write_file

STEPS = "time/total_timesteps"
OBJECTIVES = ("object_velocity", "approach_time", "peak_force", "missed")
ROWS = 200  # approximate largest number of rows of progress.csv
NEARLY_ALL = 0.99  # fraction of the objects; a policy that misses this fraction touches objects only by accident
COLLAPSED = 3  # a training ends after this many successive validations that missed nearly all objects
BEGINNING = 0.1  # in this first fraction of a training, a policy may miss all objects


class CollapsedError(RuntimeError):
    """A training collapsed: its policy misses nearly all objects, or its weights are not finite."""


class TrainingCallback(BaseCallback):
    """Callback of stable-baselines3."""

    def __init__(self, folder: Path, setup: Setup, training: Training, policy: Callable[[], Policy]) -> None:
        """Make a callback that writes into `folder`; `policy` returns a copy of the model's policy."""
        super().__init__()
        self._folder, self._setup, self._training, self._policy = folder, setup, training, policy
        self.validation = Validation(
            setup.task, setup.evaluation.weights, training.validation_scenarios, threads=training.simulation_threads
        )
        self.bar: Any = None  # see `impact_gym.support.command_line.progress`
        self.writer: Any = None  # writer of TensorBoard's events
        self._begun = time.perf_counter()
        self.kept: dict[str, Any] = {  # state that a checkpoint keeps
            "sums": dict.fromkeys(OBJECTIVES, 0.0),
            "episodes": 0,
            "last": {"row": 0, "validation": 0, "checkpoint": 0},
            "best": math.inf,
            "curve": [],  # [steps, score] of each validation
            "rows": [],  # rows of progress.csv
            "collapsed": 0,  # number of successive validations, after BEGINNING, that missed nearly all objects
            "seconds": 0.0,  # s, training time of earlier processes; after the training, total training time
        }

    def _on_step(self) -> bool:
        for row in np.flatnonzero(self.locals["dones"]).tolist():
            info = self.locals["infos"][row]
            for name in OBJECTIVES:
                self.kept["sums"][name] += float(info[name])
            self.kept["episodes"] += 1
        if self.bar is not None:
            self.bar.update(self.num_timesteps - self.bar.n)
        return True

    def _on_rollout_start(self) -> None:
        training = self._training
        self._refuse_collapse()
        if self._due("validation", training.validate_every):
            self.validate()
        if self._due("row", max(training.round, training.whole_steps // ROWS)):
            self._write_row()
        if self._due("checkpoint", training.checkpoint_every):
            kept = self.kept | {"seconds": self.kept["seconds"] + time.perf_counter() - self._begun}
            checkpoint.write(self._folder / "checkpoint.npz", self.model, kept, training)

    def _on_training_end(self) -> None:
        self._refuse_collapse()
        self.validate().save(self._folder / "final.npz")
        self._write_row()
        self.kept["seconds"] += time.perf_counter() - self._begun

    def _due(self, what: str, every: int) -> bool:
        if self.num_timesteps // every == self.kept["last"][what] // every:
            return False
        self.kept["last"][what] = self.num_timesteps
        return True

    def validate(self) -> Policy:
        """Play the validation set, save the policy if it is the best so far, and return the policy."""
        steps, policy = self.num_timesteps, self._policy()
        result = self.validation.score(policy)
        policy.provenance |= {"steps": steps, "validation": result}
        self.kept["curve"].append([steps, result["score"]])
        self.logger.record("validation/score", result["score"])
        for name in ("object_velocity", "approach_time"):
            for weight, mean in zip(result["time_weight"], result[name], strict=True):
                self.logger.record(f"validation/{name} at weight {weight:g}", mean)
        if result["score"] < self.kept["best"]:
            self.kept["best"] = result["score"]
            policy.save(self._folder / "best.npz")
        again = np.mean(result["missed"]) >= NEARLY_ALL and steps > BEGINNING * self._training.whole_steps
        self.kept["collapsed"] = self.kept["collapsed"] + 1 if again else 0
        self._refuse_collapse()
        return policy

    def _refuse_collapse(self) -> None:
        reason = f"at least {NEARLY_ALL:.0%} of the objects missed in {COLLAPSED} successive validations"
        if not torch.nn.utils.parameters_to_vector(self.model.policy.parameters()).isfinite().all():
            reason = "the weights are no longer finite"
        elif self.kept["collapsed"] < COLLAPSED:
            return
        training = self._training
        raise CollapsedError(
            f"the training collapsed after {self.num_timesteps:,} of {training.whole_steps:,} steps: {reason}. Try a"
            f" learning_rate below {training.learning_rate:g} or log_std below {training.log_std:g}, and see with"
            f" `impact-gym check {self._setup.cli_name}` whether the objects can be reached at all"
        )

    def _write_row(self) -> None:
        if self.kept["episodes"]:  # without episodes, there is no mean
            for name in OBJECTIVES:
                self.logger.record(f"objectives/{name}", self.kept["sums"][name] / self.kept["episodes"])
        self.kept |= {"sums": dict.fromkeys(OBJECTIVES, 0.0), "episodes": 0}
        row = {name: float(value) for name, value in self.logger.name_to_value.items()}
        self.logger.dump()  # this call also clears the logger
        self.kept["rows"].append({STEPS: self.num_timesteps, **row})
        columns = {name for each in self.kept["rows"] for name in each}
        table = csv.DictWriter(text := io.StringIO(newline=""), sorted(columns))
        table.writeheader()
        table.writerows(self.kept["rows"])
        write_file(self._folder / "progress.csv", text.getvalue())
        for name, value in row.items() if self.writer else ():
            self.writer.add_scalar(name, value, self.num_timesteps)
