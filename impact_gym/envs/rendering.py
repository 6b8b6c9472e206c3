"""Pictures of an episode: what `render` of the environment gives, slowed down where something happens.

Every picture is drawn from the simulator's own trace, so an instant inside a control step is as good as one at its end.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.envs import render_canvas as look
from impact_gym.envs import render_chain, render_strips
from impact_gym.envs.batch import Batch
from impact_gym.envs.render_canvas import Canvas
from impact_gym.envs.render_history import FRAME_RATE, History, State
from impact_gym.scene import Bistable, SpringDamper
from impact_gym.task import Task

if TYPE_CHECKING:
    import pygame

HOLD = 1.0  # s, that the last picture of an episode stays

Frame = NDArray[np.uint8]


class Renderer:
    """Draws one environment; holds no more than a picture, a window if there is one, and what it showed last."""

    def __init__(self, task: Task, mode: str) -> None:
        """Draw episodes of `task`; nothing is imported or opened before the first picture."""
        self._task = task
        self._mode = mode
        self._canvas: Canvas | None = None
        self._window: pygame.Surface | None = None
        self._clock: Any = None
        self.begin()

    def begin(self) -> None:
        """Begin a new episode."""
        self._shown: float | None = None  # s, the instant of the last picture
        self._reached = 0.0  # s, how far the episode had come when last asked
        self._ended = False
        self._last: Frame | None = None

    def render(self, batch: Batch, row: int) -> Frame | list[Frame] | None:
        """Return what `render` of the environment returns, of the episode of `row` of `batch`."""
        ended, events = bool(batch.episodes["terminated"][row]), batch.episode_state(row)
        history = History(batch.trace(row), batch.info(row), self._task, events, ended)
        if self._mode == "rgb_array":
            return self._single(history).copy()
        if self._mode == "rgb_array_list":
            frames = [self.picture(history, time, factor) for time, factor in self.instants(history)]
            return frames + frames[-1:] * round(HOLD * FRAME_RATE if self._ends(history) and frames else 0)
        for time, factor in self.instants(history):
            self._show(history, time, factor)
        if self._ends(history):
            self._clock.tick(1.0 / HOLD)
        return None

    def close(self) -> None:
        """Close the window, if there is one; again does nothing."""
        if self._window is not None and self._canvas is not None:
            self._canvas.pygame.display.quit()
        self._window = self._clock = self._canvas = None

    def __getstate__(self) -> dict[str, Any]:
        """Leave pictures and window behind, which cannot be copied; they are made again when needed."""
        return self.__dict__ | {"_canvas": None, "_window": None, "_clock": None}

    def instants(self, history: History) -> Iterator[tuple[float, float]]:
        """Yield the instants not shown so far, each with how many times slower than life it runs."""
        if self._shown is None:
            self._shown = 0.0
            yield 0.0, history.factor(0.0)
        if history.now > self._reached:
            self._reached = history.now
            for time, factor in history.film(self._shown):
                self._shown = time
                yield time, factor

    def _ends(self, history: History) -> bool:
        """Whether these are the last pictures of the episode; says so once."""
        ends = history.ended and not self._ended
        self._ended = history.ended
        return ends

    def _single(self, history: History) -> Frame:
        """Return the picture of this moment; asked again, the same."""
        if self._last is None or history.now != self._shown:
            span = history.now - (self._shown or 0.0)
            self._shown = history.now
            self._last = self.picture(history, history.now, 1.0 / (FRAME_RATE * span) if span > 0.0 else 1.0)
        return self._last

    def picture(self, history: History, time: float, factor: float) -> Frame:
        """Return the picture (540, 960, 3) of an instant (s) that runs `factor` times slower than life."""
        return self._drawn(history, time, factor).pixels()

    def _show(self, history: History, time: float, factor: float) -> None:
        canvas = self._drawn(history, time, factor)
        pygame = canvas.pygame
        if self._window is None:
            try:
                pygame.display.init()
                self._window = pygame.display.set_mode((look.WIDTH, look.HEIGHT))
            except pygame.error as error:
                raise RuntimeError(
                    f"no window can be opened ({error}): without a display, use render_mode='rgb_array' or "
                    "'rgb_array_list', or set SDL_VIDEODRIVER=dummy to draw for nobody"
                ) from error
            pygame.display.set_caption("impact_gym")
            self._clock = pygame.time.Clock()
        self._window.blit(canvas.picture(), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(FRAME_RATE)

    def _drawn(self, history: History, time: float, factor: float) -> Canvas:
        """Draw one picture."""
        if self._canvas is None:
            self._canvas = Canvas()
        canvas, state = self._canvas, history.at(time)
        canvas.clear()
        render_chain.draw(canvas, history, state)
        render_strips.draw(canvas, history, state)
        _head(canvas, history, state, factor)
        _foot(canvas, history, state)
        return canvas


def _head(canvas: Canvas, history: History, state: State, factor: float) -> None:
    """Write time, slow motion and alarm, and below them what moves how fast."""
    canvas.text(f"t = {state.time:.4f} s", (14.0, 19.0), 26)
    canvas.text(pace(factor), (190.0, 19.0), 22, look.FAINT)
    words, colour = alarm(history, state)
    canvas.circle(LAMP, 9.0, colour)
    canvas.text(words, (LAMP[0] - 18.0, LAMP[1]), 20, look.INK, "midright")
    canvas.text(f"flange {state.flange_velocity:+.3f} m/s", (14.0, 47.0), 20, look.FLANGE)
    canvas.text(f"tool {state.tool_velocity:+.3f} m/s", (199.0, 47.0), 20, look.TOOL)
    canvas.text(f"object {state.object_velocity:+.3f} m/s", (384.0, 47.0), 20, look.OBJECT)
    canvas.text(f"contact force {state.contact_force:.3g} N", (569.0, 47.0), 20, look.FORCE)
    canvas.text(f"peak {history.peak_force(state):.3g} N", (784.0, 47.0), 20, look.FORCE)


LAMP = (look.WIDTH - 22.0, 19.0)
"""Where the alarm lamp is: grey, amber once the force exceeds the threshold, red once the controller knows."""


def alarm(history: History, state: State) -> tuple[str, str]:
    """Return the words for the alarm, and the colour of its lamp."""
    events, time = history.events, state.time
    if events.alarm <= time < events.alarm_over:
        words = f"ALARM at {events.alarm:.4f} s"
        if history.task.alarm == "reading":
            return f"{words}, by a reading above {history.threshold:g} N", look.ALARM
        return f"{words}, {1e3 * (events.alarm - events.detection):.1f} ms after {history.threshold:g} N", look.ALARM
    if events.detection <= time < events.alarm and history.task.alarm == "force":
        left = 1e3 * (events.alarm - time)
        return f"over {history.threshold:g} N; controller knows in {left:.1f} ms", look.WARNING
    return "no alarm", look.GRID


def pace(factor: float) -> str:
    """Return how fast the film runs, in words."""
    if factor > 1.0:
        return f"slow motion {round(factor, 1):g} x"
    return "real time" if factor == 1.0 else f"fast motion {1.0 / factor:.2g} x"


def _foot(canvas: Canvas, history: History, state: State) -> None:
    """Write the scenario, or at the end what came of the episode."""
    info, scenario = history.info, history.info["scenario"]
    if history.ended and state.time >= history.now:
        words = "missed: nothing was touched"
        if not info["missed"]:
            words = f"V_p = {info['object_velocity']:.3f} m/s   approach time {info['approach_time']:.3f} s   "
            words += f"peak force {info['peak_force']:.3g} N   contacts {info['contact_count']}"
        failed = "" if info["status"] == "ok" else f"   {info['status']}"
        canvas.text(words + failed + f"   return {sum(info['reward_terms'].values()):.3f}", (14.0, 520.0), 22)
        return
    words = f"object {scenario['object_mass']:.3g} kg at {1e3 * scenario['distance']:.0f} mm, "
    words += f"{scenario['contact_stiffness']:.3g} N/m^1.5, restitution {scenario['restitution']:.2f}   |   "
    words += f"{coupling_words(history.task)}   |   time weight {info['time_weight']:.3g} m/s per s"
    canvas.text(words, (14.0, 520.0), 17, look.FAINT)
    if history.ended and state.time >= history.events.end:
        canvas.text("settling", (look.WIDTH - 14.0, 520.0), 17, look.FAINT, "midright")


def coupling_words(task: Task) -> str:
    """Return a few words on what holds the tool."""
    coupling = task.coupling
    words = "rigid coupling"
    if isinstance(coupling, SpringDamper):
        words = f"spring {coupling.stiffness:.3g} N/m, damping ratio {coupling.damping_ratio:.2g}"
    elif isinstance(coupling, Bistable):
        words = f"bistable coupling, barrier {1e3 * coupling.barrier:.3g} mJ"
    return words if task.robot is None else f"{words}, compliant robot"
