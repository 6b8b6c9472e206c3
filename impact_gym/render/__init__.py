"""Draw pictures of an episode for the environment's `render`, in slow motion except for the mode "rgb_array"."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.render import chain
from impact_gym.render.canvas import HEIGHT, WIDTH, Canvas
from impact_gym.render.film import FRAME_RATE, History, State
from impact_gym.render.palette import ALARM, FAINT, GRID, INK, WARNING

if TYPE_CHECKING:
    import pygame

HOLD = 2.0  # s, time for which the last picture of an episode is shown
LAMP = (WIDTH - 22.0, 30.0)  # pixels, centre of the lamp that shows the alarm

Frame = NDArray[np.uint8]


class Renderer:
    """A renderer of the episodes of one environment."""

    def __init__(self, mode: str, rate: float = FRAME_RATE) -> None:
        """`mode`: the `render_mode`; `rate`: pictures per second of a film that the caller makes with "rgb_array"."""
        self._mode, self._rate = mode, rate
        self._canvas: Canvas | None = None
        self._window: pygame.Surface | None = None
        self._clock: Any = None
        self.begin()

    def begin(self) -> None:
        """Begin a new episode."""
        self._shown: float | None = None  # s, the instant that the last picture shows
        self._reached = 0.0  # s, time of the episode at the last call of `instants`
        self._ended = False

    def render(self, history: History) -> Frame | list[Frame] | None:
        """Return what `ImpactApproachEnv.render` returns for the episode so far."""
        if self._mode == "rgb_array":
            return self.draw(history, history.now, 1.0 / (self._rate * history.task.control_period)).pixels()
        newly_ended, self._ended = history.ended and not self._ended, history.ended
        if self._mode == "rgb_array_list":
            frames = [self.draw(history, time, factor).pixels() for time, factor in self.instants(history)]
            return frames + frames[-1:] * round(HOLD * FRAME_RATE * newly_ended)
        for time, factor in self.instants(history):
            self._show(history, time, factor)
        if newly_ended:
            self._clock.tick(1.0 / HOLD)
        return None

    def close(self) -> None:
        """Close the window, if one is open."""
        if self._window is not None and self._canvas is not None:
            self._canvas.pygame.display.quit()
        self._window = self._clock = self._canvas = None

    def __getstate__(self) -> dict[str, Any]:
        """Leave out canvas, window and clock, which cannot be copied."""
        return self.__dict__ | {"_canvas": None, "_window": None, "_clock": None}

    def instants(self, history: History) -> Iterator[tuple[float, float]]:
        """Yield the instants (s) of pictures not shown yet, each with its slow-motion factor."""
        if self._shown is None:
            self._shown = 0.0
            yield 0.0, history.factor(0.0)
        if history.now > self._reached:
            self._reached = history.now
            for time, factor in history.film(self._shown):
                self._shown = time
                yield time, factor

    def _show(self, history: History, time: float, factor: float) -> None:
        canvas = self.draw(history, time, factor)
        pygame = canvas.pygame
        if self._window is None:
            try:
                pygame.display.init()
                self._window = pygame.display.set_mode((WIDTH, HEIGHT))
            except pygame.error as error:
                raise RuntimeError(
                    f"no window can be opened ({error}): without a display, use render_mode='rgb_array' or "
                    "'rgb_array_list', or set SDL_VIDEODRIVER=dummy to draw without one"
                ) from error
            pygame.display.set_caption("impact_gym")
            self._clock = pygame.time.Clock()
        self._window.blit(canvas.picture(), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(FRAME_RATE)

    def draw(self, history: History, time: float, factor: float) -> Canvas:
        """Draw the picture of the instant `time` (s), with the slow-motion `factor` in words."""
        if self._canvas is None:
            self._canvas = Canvas()
        canvas, state = self._canvas, history.at(time)
        canvas.clear()
        chain.draw(canvas, history, state)
        _head(canvas, history, state, factor)
        _foot(canvas, history, state)
        return canvas


def _head(canvas: Canvas, history: History, state: State, factor: float) -> None:
    over = history.ended and state.time >= history.now
    canvas.text(verdict(history) if over else f"object {state.object_velocity:.2f} m/s", (14.0, 34.0), 58)
    pace = f"{round(factor, 1):g} x slower" if factor > 1.0 else f"{1.0 / factor:.2g} x faster"
    canvas.text(f"{state.time:.3f} s", (14.0, 86.0), 36, FAINT)
    canvas.text("real time" if factor == 1.0 else pace, (140.0, 86.0), 30, FAINT)
    words, colour = alarm(history, state.time)
    canvas.circle(LAMP, 12.0, colour)
    if not over:
        canvas.text(words, (LAMP[0] - 22.0, LAMP[1]), 30, INK, "midright")
    forces = history.columns["contact_force"][: np.searchsorted(history.time, state.time, side="right")]
    if (largest := max(float(forces.max()), state.contact_force)) > 0.0:
        canvas.text(f"largest force {largest:.3g} N", (WIDTH - 14.0, 86.0), 30, FAINT, "midright")


def verdict(history: History) -> str:
    """Return the result of an ended episode in words."""
    info = history.info
    if info["missed"]:
        return "missed: the object was never touched"
    if "slide" in info:
        return f"object slides {chain.length(info['slide'])}"
    return f"object leaves at {info['object_velocity']:.2f} m/s"


def alarm(history: History, time: float) -> tuple[str, str]:
    """Return the state of the alarm at `time` (s) in words, and the colour of the lamp."""
    events = history.events
    if events.alarm <= time < events.alarm_over:
        if history.task.alarm == "reading":
            return "alarm by a reading", ALARM
        late = 1e3 * (events.alarm - events.detection)  # ms
        return f"alarm, {late:.0f} ms after {history.task.alarm_threshold:g} N", ALARM
    if events.detection <= time < events.alarm < np.inf and history.task.alarm == "force":
        return f"detected; alarm in {1e3 * (events.alarm - time):.1f} ms", WARNING
    return "no alarm", GRID


def _foot(canvas: Canvas, history: History, state: State) -> None:
    info, scenario, task = history.info, history.info["scenario"], history.task
    if history.ended and state.time >= history.now:
        words = f"return {sum(info['reward_terms'].values()):.2f}"
        if not info["missed"]:
            contacts = f"{info['contact_count']} contact{'s'[: info['contact_count'] != 1]}"
            words = f"touched after {info['approach_time']:.3f} s, {contacts}, {words}"
        canvas.text(words + ("" if info["status"] == "ok" else f", {info['status']}"), (14.0, 520.0), 30)
        return
    words = f"object {scenario['object_mass']:.2g} kg, {scenario['contact_stiffness']:.2g} N/m^1.5, "
    words += f"restitution {scenario['restitution']:.2f}" + ("" if task.robot is None else ", compliant robot")
    canvas.text(words, (14.0, 520.0), 26, FAINT)
    if history.ended and state.time >= history.events.end:
        canvas.text("settling", (WIDTH - 14.0, 520.0), 26, FAINT, "midright")
