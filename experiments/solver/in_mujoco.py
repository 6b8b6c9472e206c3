"""The same bodies in MuJoCo: two sliders, the tool on the flange by a joint's spring or by a tendon.

MuJoCo has no Hertz contact. Its own law, a spring and damper on the acceleration that the constraint asks for, has two
numbers here (`solref` in its direct form, with a constant `solimp`); they are fitted to each scene, so that duration
and V_p come out right at the finest step. Everything else about the contact, such as its peak force, stays as its law
makes it. The flange is a slider so heavy that the tool does not slow it.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

import impact_gym as ig
from agents.jobs import Result
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.solver.approaches import Approach, approach_of
from experiments.solver.by_hand import BISTABLE, SPRING, command_of, flange, law_of
from experiments.solver.solutions import SHARED, Solution

HEAVY = 1e6  # kg, the flange
RADIUS = 0.05  # m, of the two spheres that touch
STEP = 1e-5  # s, at which the contact is fitted
GOOD = (1e-4, 1e-2)  # errors that weigh the same there: V_p in m/s, relative duration
IMPEDANCE = 1e-3  # -, of the constraints: so small that what pushes the bodies together is not taken out of the contact


@dataclass(frozen=True)
class Fit:
    """MuJoCo's contact: what the constraint asks for is -stiffness * penetration - damping * rate."""

    stiffness: float  # 1/s^2
    damping: float  # 1/s


def xml(approach: Approach, fit: Fit, step: float) -> str:
    """Return the model of an approach."""
    law, solimp = law_of(approach.scene), f"{IMPEDANCE} {IMPEDANCE} 1 0.5 1"
    joint, tendon, pivot, height = "", "", 0.0, 0.0
    if law.kind == SPRING:
        joint = f'stiffness="{law.k_t}" damping="{law.c_t}"'
    elif law.kind == BISTABLE:
        stops = f'solreflimit="-{law.k_s / law.m_t} -{law.c_s / law.m_t}" solimplimit="{solimp}"'
        joint = f'limited="true" range="{law.rear - law.x0} {law.front - law.x0}" {stops}'
        ends = '<site site="pivot"/><site site="end"/>'
        tendon = f'<tendon><spatial stiffness="{law.k_t}" springlength="{law.L0}">{ends}</spatial></tendon>'
        pivot, height = -law.x0, law.H
    else:
        raise NotImplementedError(f"experiments.solver: no coupling like {approach.scene.coupling!r} in MuJoCo")
    ball = f'type="sphere" size="{RADIUS}" contype="0" conaffinity="0"'
    return f"""
    <mujoco>
      <option timestep="{step}" gravity="0 0 0" integrator="Euler" jacobian="dense" tolerance="1e-12"/>
      <worldbody>
        <body name="flange">
          <inertial pos="0 0 0" mass="{HEAVY}" diaginertia="1 1 1"/>
          <joint type="slide" axis="1 0 0"/>
          <site name="pivot" pos="{pivot} {height} 0"/>
          <body name="tool">
            <joint name="coupling" type="slide" axis="1 0 0" {joint}/>
            <geom name="tool" pos="-{RADIUS} 0 0" mass="{law.m_t}" {ball}/>
            <site name="end"/>
          </body>
        </body>
        <body name="object" pos="{approach.scene.object.distance} 0 0">
          <joint type="slide" axis="1 0 0"/>
          <geom name="object" pos="{RADIUS} 0 0" mass="{law.m_p}" {ball}/>
        </body>
      </worldbody>
      <contact>
        <pair geom1="tool" geom2="object" condim="1" solref="-{fit.stiffness} -{fit.damping}" solimp="{solimp}"/>
      </contact>
      {tendon}
    </mujoco>"""


class Model:
    """An approach in MuJoCo at a step (s), over `window` (s) from `start` (flange, joint, object; m and m/s)."""

    def __init__(
        self, approach: Approach, fit: Fit, step: float, window: tuple[float, float] | None = None, start: Any = None
    ) -> None:
        import mujoco  # an extra

        self.model = mujoco.MjModel.from_xml_string(xml(approach, fit, step))
        self.data = mujoco.MjData(self.model)
        mujoco.set_mju_user_warning(lambda _: None)  # or it writes a file into the current folder; see `run`
        self._step, self._reset = mujoco.mj_step, mujoco.mj_resetData
        self.command, self.step, self.start = command_of(approach.motion), step, start
        self.window = window or (0.0, approach.duration)
        law = law_of(approach.scene)
        self.x0 = law.x0 if law.kind == BISTABLE else math.inf
        self.pushes: list[tuple[int, float]] = []  # steps, and the force on the flange in them, N

    def _begin(self) -> None:
        self._reset(self.model, self.data)
        if self.start is not None:
            self.data.qpos[:], self.data.qvel[:] = self.start

    def run(self) -> Solution:
        """Step by step, looking at the forces; remember what pushes the flange."""
        self._begin()
        begin, end = self.window
        h, data, command = self.step, self.data, self.command
        count = round((end - begin) / h)
        brake, detection, peak, touching, contacts, passes = math.inf, math.nan, 0.0, 0, 0, 0
        before = behind = False
        weight = HEAVY + float(self.model.body("tool").mass[0])
        forces = np.empty(count)
        for i in range(count):
            t = begin + i * h
            change = flange(command, brake, t + h)[1] - flange(command, brake, t)[1]
            data.qfrc_applied[0] = forces[i] = round(change / h, 9) * weight
            self._step(self.model, data)
            force, now, now_behind = data.qfrc_constraint[2], data.ncon > 0, self.x0 + data.qpos[1] < 0.0
            peak = max(peak, force)
            touching += now
            contacts += now and not before
            passes += now_behind != behind
            before, behind = now, now_behind
            if force > command.threshold and math.isnan(detection):
                detection, brake = t, t + command.delay
        starts = np.flatnonzero(np.diff(forces, prepend=np.nan) != 0.0)
        lengths = np.diff(starts, append=count)
        self.pushes = [(int(n), float(forces[i])) for i, n in zip(starts, lengths, strict=True)]
        # where it diverges, MuJoCo warns and starts afresh from rest
        velocity = math.nan if any(warning.number for warning in data.warning) else float(data.qvel[2])
        return Solution(velocity, float(peak), touching * h, detection, int(contacts), int(passes), count)

    def repeat(self) -> float:
        """Make the same steps again without looking; return V_p (m/s)."""
        self._begin()
        for count, force in self.pushes:
            self.data.qfrc_applied[0] = force
            self._step(self.model, self.data, count)
        return float(self.data.qvel[2])


def fitted(approach: Approach, truth: Solution, evaluations: int) -> Fit:
    """Return the contact with which duration and V_p come closest to the truth, by the simplex method of Nelder, Mead.

    Only the time from just before the first contact to just after the last is simulated.
    """
    outcome = ig.simulate(*approach.run)
    first, last = outcome.contacts[0], outcome.contacts[-1]
    length = (first.end or approach.duration) - first.start
    begin = first.start - 10 * STEP
    end = min((last.end or approach.duration) + 0.2 * truth.contact_duration, approach.duration)
    trace = ig.simulate(approach.scene, approach.motion, begin, trace=True).trace
    assert trace is not None  # asked for
    flange = np.array([trace.flange_position[-1], trace.flange_velocity[-1]])
    tool = np.array([trace.tool_position[-1], trace.tool_velocity[-1]])
    start = np.stack([flange, tool - flange, np.zeros(2)], axis=1)

    def cost(logarithms: Any) -> float:
        fit = Fit(*np.exp(logarithms).tolist())
        solution = Model(approach, fit, STEP, (begin, end), start).run()
        if not (math.isfinite(solution.velocity) and solution.contact_duration > 0.0):
            return 1e9
        misses = (solution.velocity - truth.velocity, math.log(solution.contact_duration / truth.contact_duration))
        wrong = abs(solution.contacts - truth.contacts) + abs(solution.passes - truth.passes)
        return sum(abs(miss) / good for miss, good in zip(misses, GOOD, strict=True)) + 10.0 * wrong

    # half a period of a free oscillation whose amplitude falls by the restitution of the first contact
    ratio = min(max(first.separation_velocity / first.approach_velocity, 1e-2), 0.999)
    frequency = math.hypot(math.pi, math.log(ratio)) / length
    guess = np.log([frequency**2, -2.0 * math.log(ratio) / length])
    simplex = guess + np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, -1.0]])
    best = minimize(cost, guess, method="Nelder-Mead", options={"maxfev": evaluations, "initial_simplex": simplex})
    return Fit(*np.exp(best.x).tolist())


def fit_row(approach: str, truth: Mapping[str, Any], evaluations: int) -> Result:
    """Return the row of MuJoCo's contact in a scene."""
    scene = approach_of(approach)
    fit = fitted(scene, Solution(**truth), evaluations)
    return result_of([{"scene": approach, "description": scene.description, **asdict(fit)}])


def fits(gather: Gather, truths: Mapping[str, Solution], evaluations: int) -> list[Row]:
    """Return the rows of MuJoCo's contact in these scenes."""
    depends = solver_and("experiments.solver.by_hand", __name__, *SHARED)
    jobs = [{"approach": name, "truth": truth.numbers, "evaluations": evaluations} for name, truth in truths.items()]
    return gather("fits of MuJoCo's contact", fit_row, jobs, depends)
