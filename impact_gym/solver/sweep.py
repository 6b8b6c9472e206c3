"""Many approaches, one after the other: each row restores its law from plain numbers and runs as a single one does."""

import math

from impact_gym.kernel import by_type, inner_kernel, kernel
from impact_gym.physics.contact import Force, Hertz, Power
from impact_gym.physics.coupling import (
    Law,
    Mechanism,
    MechanismLaw,
    RigidLaw,
    RobotLaw,
    Spring,
    SpringDamperLaw,
    VaryingLaw,
)
from impact_gym.physics.robot import LumpedRobot, VaryingRobot
from impact_gym.solver import stepper
from impact_gym.solver.approach import Profile, play
from impact_gym.solver.state import Array, Bodies, Recorder, Run, Status, Tolerance

NOT_FINITE = int(Status.NOT_FINITE)


@inner_kernel
def _spring(like: Spring, row: Array) -> Spring:
    return Spring(row[1], row[2])


@inner_kernel
def _mechanism(like: Mechanism, row: Array) -> Mechanism:
    return Mechanism(row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8])


_coupling = by_type({Spring: _spring, Mechanism: _mechanism})


@inner_kernel
def _lumped(like: LumpedRobot, row: Array) -> LumpedRobot:
    return LumpedRobot(row[-3], row[-2], row[-1])


@inner_kernel
def _varying(like: VaryingRobot, row: Array) -> VaryingRobot:
    return like


_robot = by_type({LumpedRobot: _lumped, VaryingRobot: _varying})


@inner_kernel
def _rigid_law(like: RigidLaw, row: Array) -> RigidLaw:
    return RigidLaw(row[0])


@inner_kernel
def _spring_damper_law(like: SpringDamperLaw, row: Array) -> SpringDamperLaw:
    return SpringDamperLaw(row[0], row[1], row[2])


@inner_kernel
def _mechanism_law(like: MechanismLaw, row: Array) -> MechanismLaw:
    return MechanismLaw(row[0], _mechanism(like.coupling, row))


@inner_kernel
def _robot_law(like: RobotLaw, row: Array) -> RobotLaw:
    return RobotLaw(row[0], _coupling(like.coupling, row), _robot(like.robot, row))


@inner_kernel
def _varying_law(like: VaryingLaw, row: Array) -> VaryingLaw:
    return VaryingLaw(row[0], like.robot)


restored = by_type(
    {
        RigidLaw: _rigid_law,
        SpringDamperLaw: _spring_damper_law,
        MechanismLaw: _mechanism_law,
        RobotLaw: _robot_law,
        VaryingLaw: _varying_law,
    }
)
"""A law like another, its numbers (but a table's) from a row: those of the tool, the coupling, the robot."""


@inner_kernel
def _hertz(like: Hertz, row: Array) -> Hertz:
    return Hertz(row[0], row[1])


@inner_kernel
def _power(like: Power, row: Array) -> Power:
    return Power(row[0], row[1], row[2], row[3])


restored_contact = by_type({Hertz: _hertz, Power: _power})
"""A contact law like another, its numbers from a row."""


@kernel
def sweep_rows(
    law: Law,
    contact: Force,
    laws: Array,
    contacts: Array,
    objects: Array,
    profiles: Array,
    first: int,
    last: int,
    tolerance: Tolerance,
    recorder: Recorder,
    chains: Array,
    statuses: Array,
) -> None:
    """Run rows `first` to `last`; `law` and `contact` tell the types, the tables have a row for each approach.

    Columns of `objects`: mass, distance; of `profiles`: those of `Profile`, then the duration.
    """
    work = stepper.workspace(law)
    for i in range(first, last):
        bodies = Bodies(objects[i, 0], restored_contact(contact, contacts[i]))
        p = profiles[i]
        run = Run(restored(law, laws[i]), bodies, p[2], tolerance, recorder, work)
        status = play(run, chains[i], objects[i, 1], Profile(p[0], p[1], p[2], p[3], p[4]), p[5])
        if status >= 0 and not math.isfinite(chains[i].penetration_rate + chains[i].deflection_rate):
            status = NOT_FINITE
        statuses[i] = status
