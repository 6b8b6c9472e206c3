"""A picture with smooth edges, drawn by pygame; coordinates are in pixels from the upper left corner."""

import importlib
import os
import warnings
from collections.abc import Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from impact_gym.render.palette import INK, PAPER

if TYPE_CHECKING:
    import pygame

Point = tuple[float, float]
Box = tuple[float, float, float, float]  # left, top, width, height

WIDTH, HEIGHT = 960, 540
OVERSAMPLING = 2  # shapes are drawn larger by this factor, then scaled down, to smooth their edges
FARTHEST = 1 << 14  # pixels; coordinates are clipped to this absolute value, because far larger ones overflow in pygame


class Canvas:
    """A picture that is drawn anew for each frame."""

    def __init__(self) -> None:
        """Make an empty picture, without a display."""
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # pygame 2.6 uses a deprecated part of setuptools
                self.pygame: Any = importlib.import_module("pygame")
        except ImportError as error:
            raise DependencyNotInstalled("rendering needs pygame: pip install 'impact-gym[render]'") from error
        self.pygame.font.init()
        self._surface: pygame.Surface = self.pygame.Surface((WIDTH * OVERSAMPLING, HEIGHT * OVERSAMPLING), 0, 32)
        self._texts: list[tuple[str, Point, int, str, str]] = []
        self._font = cache(partial(self.pygame.font.Font, None))  # pygame's own font, the same on every machine

    def clear(self) -> None:
        """Remove all shapes and texts."""
        self._surface.fill(PAPER)
        self._texts.clear()

    def picture(self) -> "pygame.Surface":
        """Return the picture."""
        picture: pygame.Surface = self.pygame.transform.smoothscale(self._surface, (WIDTH, HEIGHT))
        for text, (x, y), size, colour, anchor in self._texts:
            image = self._font(size).render(text, True, colour)
            picture.blit(image, image.get_rect(**{anchor: (round(x), round(y))}))
        return picture

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture as a new array (height, width, 3)."""
        return np.ascontiguousarray(self.pygame.surfarray.array3d(self.picture()).transpose(1, 0, 2))

    def polygon(self, points: Sequence[Point], colour: str) -> None:
        """Fill a polygon."""
        self.pygame.draw.polygon(self._surface, colour, self._scaled(points))

    def rectangle(self, box: Box, colour: str) -> None:
        """Fill a rectangle; its edges are rounded to 1 / OVERSAMPLING pixel."""
        left, top, width, height = box
        (x0, y0), (x1, y1) = self._scaled([(left, top), (left + width, top + height)])
        self._surface.fill(colour, (x0, y0, max(x1 - x0, 1), max(y1 - y0, 1)))

    def circle(self, centre: Point, radius: float, colour: str) -> None:
        """Fill a circle."""
        self.pygame.draw.circle(self._surface, colour, self._scaled([centre])[0], radius * OVERSAMPLING)

    def lines(self, points: Sequence[Point], colour: str, width: float = 1.5) -> None:
        """Draw a line through `points`."""
        if len(points) > 1:
            thickness = max(1, round(width * OVERSAMPLING))
            self.pygame.draw.lines(self._surface, colour, False, self._scaled(points), thickness)

    def text(self, text: str, at: Point, size: int = 18, colour: str = INK, anchor: str = "midleft") -> None:
        """Write `text`; the point `anchor` of its bounding box is at `at`."""
        self._texts.append((text, at, size, colour, anchor))

    @staticmethod
    def _scaled(points: Sequence[Point]) -> list[tuple[int, int]]:
        """Return `points` in pixels of the oversampled surface, clipped at FARTHEST."""
        x, y = np.clip(np.transpose(points) * OVERSAMPLING, -FARTHEST, FARTHEST).round().astype(int).tolist()
        return list(zip(x, y, strict=True))
