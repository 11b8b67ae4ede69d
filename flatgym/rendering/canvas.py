"""A canvas with antialiased lines, discs and text, and a camera from metres to pixels.

Everything is drawn SUPERSAMPLING times as large as shown and averaged down, which antialiases all primitives. Sizes and
positions are in shown pixels from the upper left corner and need not be integers. The module needs pygame, but no
display or window.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import pygame
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array

Colour: TypeAlias = tuple[int, int, int]
Pixels: TypeAlias = NDArray[np.uint8]
View: TypeAlias = tuple[float, float, float, float]
"""Left, top, width and height [px]."""

SUPERSAMPLING = 2
RAMP = np.array([(58, 18, 128), (126, 3, 168), (190, 47, 130), (229, 92, 92), (246, 148, 60)], dtype=np.float64)
"""Colours of the thrust from minimum to maximum, evenly spaced, of increasing lightness."""


def ramp(share: float) -> Colour:
    """Return the colour of a relative thrust, 0 the minimum and 1 the maximum."""
    return _ramp(round(100 * min(max(share, 0.0), 1.0)))


@lru_cache
def _ramp(percent: int) -> Colour:
    place = percent / 100 * (len(RAMP) - 1)
    red, green, blue = (round(float(np.interp(place, range(len(RAMP)), channel))) for channel in RAMP.T)
    return red, green, blue


def mix(colour: Colour, paper: Colour, share: float) -> Colour:
    """Return the mixture of a share of `colour` and 1 - share of `paper`."""
    red, green, blue = (round(share * a + (1 - share) * b) for a, b in zip(colour, paper, strict=True))
    return red, green, blue


@dataclass(frozen=True)
class Camera:
    """The map from world coordinates to pixels.

    Attributes:
        scale: pixels per metre.
        look_at: the point (x, z) at the centre of the view [m].
        view: left, top, width and height of the view [px].
    """

    scale: float
    look_at: tuple[float, float]
    view: View

    @classmethod
    def fit(cls, box: Array, view: View, padding: float, scale_most: float) -> Camera:
        """Return the camera that shows a box (minimum x, minimum z, maximum x, maximum z) [m] with a padding [px]."""
        wide, tall = max(box[2] - box[0], 1e-9), max(box[3] - box[1], 1e-9)
        scale = min((view[2] - 2 * padding) / wide, (view[3] - 2 * padding) / tall, scale_most)
        return cls(float(scale), (float(box[0] + box[2]) / 2, float(box[1] + box[3]) / 2), view)

    def __call__(self, points: ArrayLike) -> Array:
        """Return the pixel coordinates of points (..., 2) [m], shape (..., 2)."""
        left, top, width, height = self.view
        x, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        return np.stack(
            [
                left + width / 2 + self.scale * (x - self.look_at[0]),
                top + height / 2 - self.scale * (z - self.look_at[1]),
            ],
            axis=-1,
        )

    @property
    def seen(self) -> tuple[float, float, float, float]:
        """Minimum x, minimum z, maximum x, maximum z of the view [m]."""
        (x, z), half_x, half_z = self.look_at, self.view[2] / self.scale / 2, self.view[3] / self.scale / 2
        return x - half_x, z - half_z, x + half_x, z + half_z


class Canvas:
    """A drawing surface of width and height [px], transparent if there is no `paper` colour.

    It tracks the regions drawn on, so that a canvas that starts from another is averaged down in these regions only.
    """

    def __init__(self, size: tuple[int, int], paper: Colour | None = None) -> None:
        self.size = size
        large = (size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING)
        self.surface = pygame.Surface(large, pygame.SRCALPHA if paper is None else 0, 32)
        self._shown = pygame.Surface(size, 0, 32)
        if paper is not None:
            self.surface.fill(paper)
        self._touched = [self.surface.get_rect()]
        self._strokes, self._averaged = 0, -1
        self._start: tuple[Canvas | None, int] = None, 0

    def start_from(self, other: Canvas) -> None:
        """Become a copy of another canvas of the same size."""
        start = (other, other._strokes)
        places = self._touched if self._start == start else [self.surface.get_rect()]
        shown = other.shown()
        for place in places:
            self.surface.blit(other.surface, place, place)
            small = _small(place, self._shown)
            self._shown.blit(shown, small, small)
        self._touched, self._start, self._averaged = [], start, -1

    def put(self, other: Canvas, corner: ArrayLike = (0.0, 0.0), opacity: float = 1.0) -> None:
        """Draw another canvas on this one."""
        other.surface.set_alpha(round(255 * opacity))
        self._touch(self.surface.blit(other.surface, _large(corner)))

    def line(self, points: ArrayLike, colour: Colour, width: float, smooth: bool = False) -> None:
        """Draw a line through points (n, 2) with round ends, and with round joints unless `smooth`."""
        places, thick = _large(points), max(1, round(width * SUPERSAMPLING))
        for start, end in pairwise(places):
            self._touch(pygame.draw.aaline(self.surface, colour, start, end, thick))
        if thick > 3:
            for place in (places[0], places[-1]) if smooth else places:
                self._touch(pygame.draw.aacircle(self.surface, colour, place, thick / 2 - 1))

    def dashes(self, points: Array, colour: Colour, width: float, dash: float, gap: float) -> None:
        """Draw a dashed line through points (n, 2); lengths in pixels."""
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        for begin in np.arange(0.0, along[-1], dash + gap):
            end = min(begin + dash, along[-1])
            at = np.concatenate([[begin], along[(along > begin) & (along < end)], [end]])
            self.line(np.stack([np.interp(at, along, axis) for axis in points.T], axis=-1), colour, width)

    def arrow(self, tail: Array, tip: Array, colour: Colour, width: float) -> None:
        """Draw an arrow from a point to another, each of shape (2,)."""
        along = (tip - tail) / max(np.hypot(*(tip - tail)), 1e-9)
        across, wing = along[::-1] * (-1, 1), 1.6 * width + 1
        neck = tip - 1.6 * wing * along
        self.line([tail, neck], colour, width)
        self.area([tip, neck + wing * across, neck - wing * across], colour)

    def disc(self, centre: ArrayLike, radius: float, colour: Colour) -> None:
        """Draw a filled circle."""
        self._touch(pygame.draw.aacircle(self.surface, colour, _large(centre), radius * SUPERSAMPLING))

    def ring(self, centre: ArrayLike, radius: float, colour: Colour, width: float) -> None:
        """Draw a circle; its line is centred on the radius."""
        thick = max(1, round(width * SUPERSAMPLING))
        outer = radius * SUPERSAMPLING + thick / 2
        self._touch(pygame.draw.aacircle(self.surface, colour, _large(centre), outer, thick))

    def area(self, points: ArrayLike, colour: Colour) -> None:
        """Fill a polygon with corners (n, 2)."""
        places = _large(points)
        pygame.draw.polygon(self.surface, colour, places)
        self._touch(pygame.draw.aalines(self.surface, colour, True, places))

    def panel(self, left: float, top: float, width: float, height: float, colour: Colour, round_by: float = 0) -> None:
        """Fill a rectangle with corners rounded by a radius."""
        box = pygame.Rect(*_large((left, top)), *_large((width, height)))
        self._touch(pygame.draw.rect(self.surface, colour, box, border_radius=round(round_by * SUPERSAMPLING)))

    def text(self, text: str, place: ArrayLike, height: float, colour: Colour, anchor: str = "midleft") -> float:
        """Draw a line of text with its `anchor`, an attribute of pygame.Rect, at a place; return its width [px]."""
        picture = _text(text, round(height * SUPERSAMPLING), colour)
        box = picture.get_rect(**{anchor: tuple(int(v) for v in _large(place))})
        self._touch(self.surface.blit(picture, box))
        return box.width / SUPERSAMPLING

    def clip(self, view: View | None) -> None:
        """Restrict drawing to a view; None removes the restriction."""
        self.surface.set_clip(None if view is None else pygame.Rect(*(round(v * SUPERSAMPLING) for v in view)))

    def shown(self) -> pygame.Surface:
        """Return the averaged surface; the next call overwrites it."""
        if self._averaged == self._strokes:
            return self._shown
        self._averaged = self._strokes
        for place in self._touched:
            small = _small(place, self._shown)
            large = pygame.Rect(*(v * SUPERSAMPLING for v in small))
            self._shown.blit(pygame.transform.smoothscale(self.surface.subsurface(large), small.size), small)
        return self._shown

    def pixels(self) -> Pixels:
        """Return the RGB values, shape (height, width, 3)."""
        flat = np.frombuffer(pygame.image.tobytes(self.shown(), "RGB"), dtype=np.uint8)
        return flat.reshape(self.size[1], self.size[0], 3).copy()

    def _touch(self, place: pygame.Rect) -> None:
        """Add a region to those drawn on; overlapping regions are merged."""
        self._strokes += 1
        if place.width == 0 or place.height == 0:
            return
        for i, other in enumerate(self._touched):
            if other.colliderect(place.inflate(2, 2)):
                self._touched[i] = other.union(place)
                return
        self._touched.append(place)


def _small(place: pygame.Rect, shown: pygame.Surface) -> pygame.Rect:
    """Return the shown pixels that cover a region of the large surface."""
    left, top = place.left // SUPERSAMPLING, place.top // SUPERSAMPLING
    right, bottom = -(-place.right // SUPERSAMPLING), -(-place.bottom // SUPERSAMPLING)
    return pygame.Rect(left, top, right - left, bottom - top).clip(shown.get_rect())


def text_width(text: str, height: float) -> float:
    """Return the width of a line of text [px]."""
    return _font(round(height * SUPERSAMPLING)).size(text)[0] / SUPERSAMPLING


def _large(places: ArrayLike) -> Any:
    """Return shown pixel coordinates as coordinates of the large surface."""
    return (np.asarray(places, dtype=np.float64) * SUPERSAMPLING).tolist()


def _font(height: int) -> pygame.font.Font:
    if not pygame.font.get_init():
        # pygame.quit() invalidates all fonts.
        pygame.font.init()
        _fonts.cache_clear()
    return _fonts(max(height, 1))


@lru_cache(maxsize=32)
def _fonts(height: int) -> pygame.font.Font:
    return pygame.font.Font(None, height)


@lru_cache(maxsize=512)
def _text(text: str, height: int, colour: Colour) -> pygame.Surface:
    return _font(height).render(text, True, colour)
