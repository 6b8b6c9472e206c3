"""The environment's arguments; action, observation, reward and random draws of an episode."""

from impact_gym.quantities import QUANTITIES, Quantity
from impact_gym.task import evaluation_sets
from impact_gym.task.action import ActionSpec
from impact_gym.task.observation import ObservationSpec
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import Task

__all__ = ["QUANTITIES", "ActionSpec", "ObservationSpec", "Quantity", "ScenarioRanges", "Task", "evaluation_sets"]
