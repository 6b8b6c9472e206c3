"""One episode, one row: how it begins, what a control step does, how it ends. Every front end runs these kernels."""

import math

from impact_gym.envs.observation import observe
from impact_gym.envs.records import hashed, normal
from impact_gym.envs.rows import Episode
from impact_gym.envs.scenario import draw
from impact_gym.envs.task import (
    ACCELERATION_RANGE,
    AFTER_ALARM,
    COMMAND_RESOLUTION,
    FULL_DECELERATION,
    HORIZON,
    MAX_STEPS,
    MISSED_COST,
    SETTLE_LIMIT,
    VELOCITY_RANGE,
    TaskConstants,
    samples_under_way,
)
from impact_gym.kernel import inner_kernel, kernel
from impact_gym.physics.contact import Hertz
from impact_gym.physics.coupling import Law
from impact_gym.physics.dissipation import exact, hu_guo
from impact_gym.solver import coupled, stepper
from impact_gym.solver.advance import command, reset
from impact_gym.solver.contact import DETECTED, sensed_force
from impact_gym.solver.recording import close_contact, object_velocity
from impact_gym.solver.state import Array, Bodies, Chain, Recorder, Run, Tolerance

ROUNDING = 1e-9  # s, spans shorter than this are rounding of the clock


@inner_kernel
def begin(
    law: Law,
    task: TaskConstants,
    table: Array,
    uniforms: Array,
    fixed: Array,
    chain: Chain,
    episode: Episode,
    readings: Array,
    out: Array,
) -> None:
    """Draw a scenario from `table` with `uniforms`, but for what is `fixed`, and put everything at rest at t = 0."""
    episode.object_mass = draw(table[0, 0], table[0, 1], True, uniforms[0])
    episode.contact_stiffness = draw(table[1, 0], table[1, 1], True, uniforms[1])
    episode.restitution = draw(table[2, 0], table[2, 1], False, uniforms[2])
    episode.distance = draw(table[3, 0], table[3, 1], False, uniforms[3])
    episode.time_weight = draw(table[4, 0], table[4, 1], True, uniforms[4])
    if not math.isnan(fixed[0]):
        episode.object_mass = fixed[0]
    if not math.isnan(fixed[1]):
        episode.contact_stiffness = fixed[1]
    if not math.isnan(fixed[2]):
        episode.restitution = fixed[2]
    if not math.isnan(fixed[3]):
        episode.distance = fixed[3]
    if not math.isnan(fixed[4]):
        episode.time_weight = fixed[4]
    episode.distance_estimate = episode.distance + max(task.range_noise, 0.0) * normal(uniforms[5], uniforms[6])
    if not math.isnan(fixed[5]):
        episode.distance_estimate = fixed[5]
    episode.reaction_delay = draw(table[5, 0], table[5, 1], False, uniforms[7])
    if not math.isnan(fixed[6]):
        episode.reaction_delay = fixed[6]
    episode.force_bias = task.force_bias * normal(uniforms[8], uniforms[9])
    if not math.isnan(fixed[7]):
        episode.force_bias = fixed[7]
    episode.noise_seed = math.floor(uniforms[10] * 2.0**53)
    if not math.isnan(fixed[8]):
        episode.noise_seed = fixed[8]
    episode.alarm = math.inf
    readings[:] = 0.0
    episode.pushed = samples_under_way(episode.reaction_delay, task.control_period)
    for k in range(episode.pushed):
        readings[k, 3] = (k + 1) * task.control_period - episode.reaction_delay
    episode.popped = 0
    episode.next_sample = (episode.pushed + 1) * task.control_period - episode.reaction_delay
    episode.sensed_force = 0.0
    episode.sensed_peak = 0.0
    episode.sensed_deflection = 0.0
    episode.control_steps = 0
    episode.terminated = 0
    episode.truncated = 0
    episode.status = 0
    episode.time_cost = 0.0
    episode.velocity_cost = 0.0
    episode.force_cost = 0.0
    episode.missed_cost = 0.0
    episode.object_velocity = 0.0
    episode.approach_time = HORIZON
    reset(chain, episode.distance)
    observe(task, chain, episode, out)


@kernel
def decode(action: float, low: float, high: float) -> float:
    """Physical command of an action, clipped to [-1, 1], on the grid of COMMAND_RESOLUTION."""
    value = low + 0.5 * (min(1.0, max(-1.0, action)) + 1.0) * (high - low)
    return round(value / COMMAND_RESOLUTION) * COMMAND_RESOLUTION


@inner_kernel
def snap(time: float, onto: float) -> float:
    """The earlier of `time` and `onto`; `onto` too if only rounding would lie between them."""
    return onto if time > onto - ROUNDING else time


@inner_kernel
def sample(run: Run, task: TaskConstants, chain: Chain, episode: Episode, readings: Array) -> None:
    """Read the sensors now; the controller gets the reading `reaction_delay` later.

    There is a reading one delay before each observation that may come, at times known a delay ahead, because the alarm,
    which shifts the clock, comes a delay after its cause. Each carries its time: an observation gets the last one that
    is due, and one for an observation that did not come (at the horizon, with an alarm under way) is passed over.
    """
    slot = episode.pushed % readings.shape[0]
    readings[slot, 0] = sensed_force(run, chain)
    readings[slot, 1] = chain.peak_force
    readings[slot, 2] = chain.deflection - chain.flange_offset
    readings[slot, 3] = chain.time
    episode.pushed += 1
    if math.isinf(chain.detection):
        periods = math.floor((chain.time + episode.reaction_delay + ROUNDING) / task.control_period)
        following = (periods + 1) * task.control_period - episode.reaction_delay
        last = HORIZON - episode.reaction_delay  # where an observation is one of its own, if there is no alarm by then
        beyond = chain.time < last - ROUNDING and last < following - ROUNDING
        episode.next_sample = last if beyond else following
    else:
        last = chain.detection + AFTER_ALARM
        following = snap(max(episode.next_sample, chain.detection) + task.control_period, last)
        episode.next_sample = following if chain.time < last else math.inf


@inner_kernel
def receive(task: TaskConstants, episode: Episode, readings: Array) -> None:
    """Let the oldest reading under way reach the controller, with the sensor's errors; forces never fall below zero."""
    slot = episode.popped % readings.shape[0]
    error = episode.force_bias
    if task.force_noise > 0.0:
        first = hashed(episode.noise_seed, 2 * episode.popped)
        error += task.force_noise * normal(first, hashed(episode.noise_seed, 2 * episode.popped + 1))
    episode.sensed_force = max(readings[slot, 0] + error, 0.0)
    episode.sensed_peak = max(episode.sensed_peak, readings[slot, 1] + error)
    episode.sensed_deflection = readings[slot, 2]
    episode.popped += 1


@inner_kernel
def step(
    law: Law,
    task: TaskConstants,
    action: Array,
    chain: Chain,
    episode: Episode,
    readings: Array,
    work: Array,
    recorder: Recorder,
    out: Array,
) -> float:
    """Play one control step: command, advance, sense, and at the end settle. Returns the reward."""
    velocity = decode(action[0], VELOCITY_RANGE[0], VELOCITY_RANGE[1])
    acceleration = decode(action[1], ACCELERATION_RANGE[0], ACCELERATION_RANGE[1])
    damping = exact(episode.restitution) if task.exact == 1 else hu_guo(episode.restitution)
    bodies = Bodies(episode.object_mass, Hertz(episode.contact_stiffness, damping))
    run = Run(law, bodies, task.alarm_threshold, Tolerance(task.tolerance, MAX_STEPS), recorder, work)
    begun = min(chain.time, chain.first_contact)
    period_end = chain.time + task.control_period
    alarm = chain.detection + episode.reaction_delay
    if math.isinf(alarm):
        end = snap(period_end, HORIZON)
    elif math.isinf(episode.alarm):
        end = snap(period_end, alarm)
    else:
        end = snap(period_end, alarm + AFTER_ALARM)

    while chain.time < end:
        until = min(end, max(episode.next_sample, chain.time))
        status = 0
        if until > chain.time:
            status = command(run, chain, velocity, acceleration, until)
        if status < 0:
            episode.status = status
            break
        if status == DETECTED:
            alarm = chain.detection + episode.reaction_delay
            end = snap(period_end, alarm)
            episode.next_sample = chain.time
        if chain.time >= episode.next_sample:
            sample(run, task, chain, episode, readings)

    if math.isinf(episode.alarm) and chain.time >= alarm:
        episode.alarm = alarm
    due = chain.time - episode.reaction_delay + ROUNDING
    while episode.popped < episode.pushed and readings[episode.popped % readings.shape[0], 3] <= due:
        receive(task, episode, readings)
    episode.control_steps += 1
    observe(task, chain, episode, out)

    episode.approach_time = min(chain.first_contact, HORIZON)
    episode.object_velocity = object_velocity(chain)
    time_cost = episode.time_weight * (min(chain.time, chain.first_contact) - begun)
    episode.time_cost += time_cost
    if episode.status < 0 or chain.time >= min(alarm + AFTER_ALARM, HORIZON if math.isinf(alarm) else math.inf):
        episode.terminated = 1
    if task.max_steps > 0 and episode.control_steps >= task.max_steps:
        episode.truncated = 1
    if episode.terminated == 1:
        return finish(run, task, chain, episode) - time_cost
    return -time_cost


@inner_kernel
def finish(run: Run, task: TaskConstants, chain: Chain, episode: Episode) -> float:
    """Settle and close the books of an episode that terminates; returns the reward for what it left behind."""
    if episode.status == 0 and chain.contacts > 0:
        episode.status = min(settle(run, chain), 0)
    if chain.contacts == 0 or episode.status < 0:
        episode.missed_cost = MISSED_COST
        episode.object_velocity = 0.0
    else:
        episode.object_velocity = object_velocity(chain)
        episode.velocity_cost = episode.object_velocity
        episode.force_cost = task.force_weight * chain.peak_force
    return -(episode.missed_cost + episode.velocity_cost + episode.force_cost)


@inner_kernel
def settle(run: Run, chain: Chain) -> int:
    """Brake the flange to rest at full deceleration and go on until no contact is left or to come."""
    limit = chain.time + SETTLE_LIMIT
    while chain.time < limit:
        if chain.flange_velocity == 0.0 and chain.touching == 0 and coupled.cannot_touch(run.law, chain):
            break
        brake_end = chain.time + abs(chain.flange_velocity) / FULL_DECELERATION
        until = min(limit, max(brake_end, chain.time + 0.05))
        status = command(run, chain, 0.0, FULL_DECELERATION, until)
        if status < 0:
            return status
    if chain.touching == 1:
        close_contact(run, chain, math.nan)
    return 0


@kernel
def begin_rows(
    law: Law,
    task: TaskConstants,
    table: Array,
    uniforms: Array,
    fixed: Array,
    rows: Array,
    chains: Array,
    episodes: Array,
    readings: Array,
    out: Array,
) -> None:
    """Begin an episode in each of `rows`."""
    for k in range(rows.shape[0]):
        i = rows[k]
        begin(law, task, table, uniforms[k], fixed[k], chains[i], episodes[i], readings[i], out[i])


@kernel
def step_rows(
    law: Law,
    task: TaskConstants,
    actions: Array,
    skip: Array,
    first: int,
    last: int,
    chains: Array,
    episodes: Array,
    readings: Array,
    recorder: Recorder,
    out: Array,
    rewards: Array,
) -> None:
    """Play a control step in rows `first` to `last`, but where `skip` is set."""
    work = stepper.workspace(law)
    for i in range(first, last):
        if not skip[i]:
            rewards[i] = step(law, task, actions[i], chains[i], episodes[i], readings[i], work, recorder, out[i])
