"""The task: arguments, action, observation, reward and draws of an episode.

`quantities`       the table of all numbers (in `impact_gym.quantities`: scenes are checked by it, too)
`nested`           nested records and their dotted paths
`scenario`         ranges of scenarios, and their named sets
`task`             arguments of the environment, checked
`action`           numbers of the action, from [-1, 1] to SI units and back; compiled: `action.pxi`
`observation`      numbers of the observation, and their scales
`episodes`         draws of an episode, and the options of `reset`
`evaluation_sets`  frozen scenarios
`numbers`          writes the records of the compiled program

Compiled: `draw.pxi` draws an episode, `episode.pxi` plays its control steps, `alarm.pxi` raises the alarm, `reward.pxi`
rewards the steps, `settle.pxi` ends the episode, `records.pxi` and `numbers.pxi` hold its records.
"""

from impact_gym.quantities import QUANTITIES, Quantity
from impact_gym.task.action import ActionSpec
from impact_gym.task.observation import ObservationSpec
from impact_gym.task.scenario import ScenarioRanges
from impact_gym.task.task import Task

__all__ = ["QUANTITIES", "ActionSpec", "ObservationSpec", "Quantity", "ScenarioRanges", "Task"]
