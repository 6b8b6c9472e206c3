"""The whole task once more, slow and obvious, for the tests of the environment."""

import math

import numpy as np
from scipy.integrate import solve_ivp


class SlowEnvironment:
    """The task once more, from the paper's equations with SciPy's integrator: every law written out, nothing shared.

    State: flange position and velocity, deflection and its rate, object position and velocity.
    """

    tool_mass, stiffness, damping = 0.125, 50.0, 2.0 * math.sqrt(50.0 * 0.125)

    def __init__(self, scenario):
        self.mass, self.k_c = scenario["object_mass"], scenario["contact_stiffness"]
        self.d = 1.5 * (1.0 - scenario["restitution"]) / scenario["restitution"]
        self.t, self.y = 0.0, np.array([0.0, 0.0, 0.0, 0.0, scenario["distance"], 0.0])
        self.v_in = None  # m/s, of the contact under way
        self.starts, self.detection = [], math.inf

    def gap(self, y):
        return y[0] + y[2] - y[4]

    def force(self, y):
        if self.v_in is None:
            return 0.0
        return self.k_c * max(self.gap(y), 0.0) ** 1.5 * max(1.0 + self.d * (y[1] + y[3] - y[5]) / self.v_in, 0.0)

    def advance(self, acceleration, until, stop_at_alarm=True):
        """Move under one acceleration to `until`, or to the instant of 1 N if that is new; True if that came."""
        while self.t < until:

            def rate(t, y):
                force = self.force(y)
                pull = -self.stiffness * y[2] - self.damping * y[3]
                tool = (pull - force) / self.tool_mass - acceleration
                return [y[1], acceleration, y[3], tool, y[5], force / self.mass]

            way = 1.0 if self.v_in is None else -1.0

            def touch(t, y, begun=self.t, way=way):
                return self.gap(y) if t > begun + 1e-9 else -way  # the event that one starts from is over

            def threshold(t, y):
                return self.force(y) - 1.0

            touch.terminal = threshold.terminal = True
            touch.direction = way
            threshold.direction = 1.0
            listening = self.v_in is not None and math.isinf(self.detection)
            run = solve_ivp(
                rate,
                (self.t, until),
                self.y,
                method="DOP853",
                rtol=1e-10,
                atol=1e-13,
                max_step=4e-3 if self.v_in is None else 1e-3,
                events=[touch, threshold] if listening else [touch],
            )
            self.t, self.y = run.t[-1], run.y[:, -1]
            if run.t_events[0].size:
                if self.v_in is None:
                    self.v_in = self.y[1] + self.y[3] - self.y[5]
                    self.starts.append(self.t)
                else:
                    self.v_in = None
                self.y[4] = self.y[0] + self.y[2]
            elif run.status == 1:
                self.detection = self.t
                return True
        return False

    def command(self, velocity, acceleration, until):
        """Ramp to `velocity`, then hold; True if the force crossed 1 N on the way."""
        change = velocity - self.y[1]
        ramp_end = min(self.t + abs(change) / acceleration, until)
        if self.t < ramp_end and self.advance(math.copysign(acceleration, change), ramp_end):
            return True
        return self.t < until and self.advance(0.0, until)

    def play(self, actions, period, delay):
        """Play `actions`; returns flange position, flange velocity and time at each observation, and V_p."""
        seen, alarm, heard = [[0.0, 0.0, 0.0]], math.inf, False
        for action in np.asarray(actions, float):
            velocity = round(-0.5 + (action[0] + 1.0), 6)
            acceleration = round(1.0 + 0.5 * (action[1] + 1.0) * 19.0, 6)
            period_end = self.t + period
            end = min(period_end, alarm + 0.15 if heard else alarm, 1.2 if math.isinf(alarm) else math.inf)
            while self.t < end - 1e-12:
                if self.command(velocity, acceleration, end):
                    alarm = self.detection + delay
                    end = min(period_end, alarm)
            heard = self.t >= alarm - 1e-12
            seen.append([self.y[0], self.y[1], self.t])
            if self.t >= (1.2 if math.isinf(alarm) else alarm + 0.15) - 1e-12:
                break
        self.velocity_at_end = self.y[5]
        if not self.starts:
            return np.array(seen), 0.0  # missed, whatever comes later
        self.command(0.0, 20.0, self.t + 1.0)
        return np.array(seen), self.y[5]
