"""The record of an episode: one row of a batch, beside the row of its chain."""

from typing import Protocol

from impact_gym.solver.state import record


class Episode(Protocol):
    """State of an episode beside its chain."""

    object_mass: float  # kg
    contact_stiffness: float  # N/m^1.5
    restitution: float
    distance: float  # m
    time_weight: float  # m/s per s
    distance_estimate: float  # m
    reaction_delay: float  # s
    force_bias: float  # N
    noise_seed: float  # a whole number, names the stream of the force noise
    alarm: float  # s, when it reaches the controller; inf if it has not
    next_sample: float  # s, when the force is read next; inf if never again
    pushed: int  # force readings taken so far, those under way at t = 0 included
    popped: int  # of these, how many have reached the controller
    sensed_force: float  # N, at the controller
    sensed_peak: float  # N, at the controller
    sensed_deflection: float  # m, at the controller
    control_steps: int
    terminated: int
    truncated: int
    status: int  # of the solver; negative: failed
    time_cost: float  # terms of the reward, m/s
    velocity_cost: float
    force_cost: float
    missed_cost: float
    object_velocity: float  # m/s, so far; once terminated, what it keeps
    approach_time: float  # s, so far


EPISODE = record(Episode)
