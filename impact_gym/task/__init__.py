"""The task: the environment's arguments, and action, observation, reward and random draws of an episode.

`nested`           nested records and their dotted paths
`scenario`         ranges of scenarios, and named sets of ranges
`task`             arguments of the environment, checked
`action`           numbers of the action, from [-1, 1] to SI units and back; compiled: `action.pxi`
`observation`      numbers of the observation, and their scales; compiled: `observation.pxi`
`episodes`         draws of an episode, and the options of `reset`; compiled: `draw.pxi`
`evaluation_sets`  frozen scenarios
`range_sensor`     the range sensor; compiled: `range_sensor.pxi`
`numbers`          writes `numbers.pxi`, structures of the compiled program

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
