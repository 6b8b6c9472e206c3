"""A chain whose flange is told what to do on the way, moved from one instant that matters to the next."""

from __future__ import annotations

from collections.abc import Sequence
from math import copysign, inf, sqrt
from types import SimpleNamespace as Record
from typing import Any

import numpy as np

from experiments.reference import motion
from experiments.reference.chain import Chain, StiffError
from experiments.reference.command import Command
from experiments.reference.phases import Switch, Vector

PATIENCE = 3000  # evaluations an explicit method is given in a phase of a contact; one that needs more is stiff
STIFF_RTOL = 1e-8  # at least, of the implicit method: it is of lower order, and what is stiff changes slowly


class Steered(Command):
    """The imposed motion as it is commanded."""

    def __init__(self, nodes: Sequence[float], threshold: float) -> None:
        brake = Record(threshold=threshold, delay=0.0, deceleration=None)
        super().__init__(Record(speed=0.0, acceleration=1.0, brake=brake), tuple(nodes))

    def at(self, t: float) -> tuple[float, float, float, float]:
        """As `Command.at`; on its way back the motion is not cut at nodes, which `Command` only meets going ahead."""
        x, v, a, cut = super().at(t)
        return x, v, a, cut if cut > t else min((p[0] for p in self.pieces if p[0] > t), default=inf)

    def steer(self, t: float, velocity: float, acceleration: float) -> None:
        """From t (s) on go to `velocity` (m/s) at `acceleration` (m/s^2), then hold it."""
        x, v, _, _ = self.at(t)
        ramp = abs(velocity - v) / acceleration
        there = (t + ramp, x + (v + velocity) / 2 * ramp, velocity, 0.0)
        self.pieces = [(t, x, v, copysign(acceleration, velocity - v)), there]

    def detect(self, t: float) -> None:
        """The force passed the threshold at t; what follows from it is for others to say."""
        self.detection_time = t

    def rests(self, t: float) -> bool:
        """Whether the flange stands still from t on, as far as is known."""
        _, v, a, cut = self.at(t)
        return v == 0 and a == 0 and cut == inf


class Motion(motion.Motion):
    """The chain under way; what of it is stiff is found out on the way."""

    flight_stride = 2
    floor = 1e-12  # m/s, as in the environment

    def __init__(self, scene: Any, threshold: float, rtol: float) -> None:
        chain = Chain(scene, Record(speed=0.0, acceleration=1.0, brake=None))
        chain.command = Steered(chain.command.nodes.tolist(), threshold)
        super().__init__(chain, scene.object.distance, rtol)

    @property
    def contacts(self) -> int:
        """How many have begun."""
        return len(self.records) + self.touching

    @property
    def first_contact(self) -> float:
        """When it began, s; inf: not yet."""
        return self.records[0].start if self.records else self._onset[0] if self.touching else inf

    @property
    def deflection(self) -> float:
        """Tool minus flange, from rest, m."""
        return -float(self.state[2])

    def over(self) -> bool:
        """Whether nothing touches, and nothing will: the energy behind the tool cannot take it to the object's speed.

        Behind a flange that stands still it only falls.
        """
        if self.touching or not self.command.rests(self.t):
            return False
        chain, law = self.chain, self.chain.bistable
        _, _, u, u_dot, w, w_dot = self.state.tolist()
        m_r, k_r, _ = (0.0, 0.0, 0.0) if chain.robot is None else chain.robot(self.command.at(self.t)[0])
        m_t = chain.m_t + m_r if chain.rigid else chain.m_t
        energy = chain.m_t * (u_dot + w_dot) ** 2 / 2 + m_r * w_dot**2 / 2 + k_r * w**2 / 2 + chain.k_t * u**2 / 2
        if law is not None:
            energy += law.energy(u)
            sides = (law.position(u) > 0,) if energy < law.energy(law.x0) else (True, False)
            energy -= min(law.energy(law.rest(front)) for front in sides)
        return self.object_velocity >= sqrt(2 * max(energy, 0.0) / m_t)

    def _touch(self) -> None:
        super()._touch()
        self._stiff = False

    def _integrate(self, end: float) -> tuple[float, Vector, Switch | None]:
        """Integrate up to `end` or to a switch; a stiff contact implicitly."""
        if self.touching and not self._stiff:
            self._system.patience = PATIENCE
            try:
                return super()._integrate(end)
            except StiffError:
                self._stiff, self._system.patience = True, inf
        if not self.touching:
            return super()._integrate(end)
        rtol = max(self.rtol, STIFF_RTOL)
        return self._by("Radau", end, rtol, np.full(8, rtol / 100))
