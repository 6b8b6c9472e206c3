"""The task: its numbers, its rules, what an episode draws and what is observed.

`quantities`       the table of all numbers (in `impact_gym.quantities`, as scenes are checked by it, too)
`nested`           nested records and their dotted paths
`scenario`         ranges of scenarios, and their named sets
`task`             options of the environment, checked, and their record for the compiled program
`observation`      what the controller sees
`episodes`         what an episode draws, and how it is asked for again
`evaluation_sets`  frozen scenarios
`numbers`          writes the records of the compiled program
"""

from impact_gym.quantities import QUANTITIES, Quantity
from impact_gym.task.action import ActionSpec
from impact_gym.task.observation import ObservationSpec
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import Task

__all__ = ["QUANTITIES", "ActionSpec", "ObservationSpec", "Quantity", "ScenarioRanges", "Task"]
