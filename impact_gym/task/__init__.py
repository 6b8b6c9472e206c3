"""The task: the environment's arguments, and action, observation, reward and random draws of an episode.

Each file is named after what it contains; `nested` has nested records and their dotted paths, `numbers` writes
`numbers.pxi`, and `evaluation_sets` has frozen scenarios.

Compiled files: `episode.pxi` plays the control steps, `alarm.pxi` raises the alarm, `reward.pxi` computes the reward,
`settle.pxi` ends the episode, `records.pxi` has the other structures. The table of all numbers is in
`impact_gym.quantities`.
"""

from impact_gym.quantities import QUANTITIES, Quantity
from impact_gym.task.action import ActionSpec
from impact_gym.task.observation import ObservationSpec
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import Task

__all__ = ["QUANTITIES", "ActionSpec", "ObservationSpec", "Quantity", "ScenarioRanges", "Task"]
