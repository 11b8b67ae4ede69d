"""A sheet to draw on: smooth lines, discs and words, and a camera from metres to pixels.

Everything is drawn SUPERSAMPLING times as large as it is shown and averaged down, which smooths what the
primitives leave rough. Sizes and places are told in shown pixels, from the upper left corner, and need not
be whole. Needs pygame, but neither a display nor a window.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
import pygame
from numpy.typing import ArrayLike, NDArray

from flatgym.quadrotor import Array

Colour: TypeAlias = tuple[int, int, int]
Pixels: TypeAlias = NDArray[np.uint8]

SUPERSAMPLING = 2
RAMP = np.array([(58, 18, 128), (126, 3, 168), (190, 47, 130), (229, 92, 92), (246, 148, 60)], dtype=np.float64)
"""Colours of the thrust from least to greatest, evenly spaced: even in hue, rising in lightness."""


def ramp(share: float) -> Colour:
    """Return the colour of a share of the thrust, 0 the least and 1 the greatest."""
    return _ramp(round(100 * min(max(share, 0.0), 1.0)))


@lru_cache
def _ramp(percent: int) -> Colour:
    place = percent / 100 * (len(RAMP) - 1)
    red, green, blue = (round(float(np.interp(place, range(len(RAMP)), channel))) for channel in RAMP.T)
    return red, green, blue


def mix(colour: Colour, paper: Colour, share: float) -> Colour:
    """Return a colour as it looks through: `share` of it, the rest paper."""
    red, green, blue = (round(share * a + (1 - share) * b) for a, b in zip(colour, paper, strict=True))
    return red, green, blue


@dataclass(frozen=True)
class Camera:
    """Where a point of the world is seen.

    Attributes:
        scale: pixels of a metre.
        look_at: the point (x, z) in the middle of the view [m].
        view: left, top, width and height of the view [px].
    """

    scale: float
    look_at: tuple[float, float]
    view: tuple[float, float, float, float]

    @classmethod
    def fit(cls, box: Array, view: tuple[float, float, float, float], scale_most: float) -> Camera:
        """Return the camera that sees least x, least z, greatest x, greatest z of a box [m], shape (4,)."""
        wide, tall = max(box[2] - box[0], 1e-9), max(box[3] - box[1], 1e-9)
        scale = min(view[2] / wide, view[3] / tall, scale_most)
        return cls(float(scale), (float(box[0] + box[2]) / 2, float(box[1] + box[3]) / 2), view)

    def __call__(self, points: ArrayLike) -> Array:
        """Return where points (..., 2) [m] are seen [px], shape (..., 2)."""
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
        """Least x, least z, greatest x, greatest z that are seen [m]."""
        (x, z), half_x, half_z = self.look_at, self.view[2] / self.scale / 2, self.view[3] / self.scale / 2
        return x - half_x, z - half_z, x + half_x, z + half_z


class Canvas:
    """A sheet of width and height [px]; transparent where nothing is drawn if there is no `paper`."""

    def __init__(self, size: tuple[int, int], paper: Colour | None = None) -> None:
        self.size = size
        large = (size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING)
        self.surface = pygame.Surface(large, pygame.SRCALPHA if paper is None else 0, 32)
        self._shown = pygame.Surface(size, 0, 32)
        if paper is not None:
            self.surface.fill(paper)

    def put(self, other: Canvas, corner: ArrayLike = (0.0, 0.0), opacity: float = 1.0) -> None:
        """Lay another sheet on this one."""
        other.surface.set_alpha(None if opacity == 1 and not other.surface.get_flags() & pygame.SRCALPHA else round(
            255 * opacity
        ))
        self.surface.blit(other.surface, _large(corner))

    def line(self, points: ArrayLike, colour: Colour, width: float) -> None:
        """Draw a line through points (n, 2), with round joints and ends."""
        places, thick = _large(points), max(1, round(width * SUPERSAMPLING))
        for start, end in zip(places[:-1], places[1:], strict=True):
            pygame.draw.aaline(self.surface, colour, start, end, thick)
        if thick > 3:
            for place in places:
                pygame.draw.aacircle(self.surface, colour, place, thick / 2)

    def dashes(self, points: Array, colour: Colour, width: float, dash: float, gap: float) -> None:
        """Draw a line of dashes [px] through points (n, 2)."""
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        for begin in np.arange(0.0, along[-1], dash + gap):
            end = min(begin + dash, along[-1])
            at = np.concatenate([[begin], along[(along > begin) & (along < end)], [end]])
            self.line(np.stack([np.interp(at, along, axis) for axis in points.T], axis=-1), colour, width)

    def disc(self, centre: ArrayLike, radius: float, colour: Colour) -> None:
        """Draw a filled circle."""
        pygame.draw.aacircle(self.surface, colour, _large(centre), radius * SUPERSAMPLING)

    def ring(self, centre: ArrayLike, radius: float, colour: Colour, width: float) -> None:
        """Draw a circle whose line is centred on the radius."""
        thick = max(1, round(width * SUPERSAMPLING))
        pygame.draw.aacircle(self.surface, colour, _large(centre), radius * SUPERSAMPLING + thick / 2, thick)

    def area(self, points: ArrayLike, colour: Colour) -> None:
        """Fill a polygon with corners (n, 2)."""
        places = _large(points)
        pygame.draw.polygon(self.surface, colour, places)
        pygame.draw.aalines(self.surface, colour, True, places)

    def panel(self, left: float, top: float, width: float, height: float, colour: Colour, round_by: float = 0) -> None:
        """Fill a rectangle, its corners rounded by a radius."""
        corner, size = _large((left, top)), _large((width, height))
        pygame.draw.rect(self.surface, colour, pygame.Rect(*corner, *size), border_radius=round(round_by * SUPERSAMPLING))

    def words(self, text: str, place: ArrayLike, height: float, colour: Colour, anchor: str = "midleft") -> float:
        """Write a line of text so that its `anchor`, a name as of pygame's Rect, is at a place; return its width."""
        picture = _text(text, round(height * SUPERSAMPLING), colour)
        box = picture.get_rect(**{anchor: tuple(int(v) for v in _large(place))})
        self.surface.blit(picture, box)
        return box.width / SUPERSAMPLING

    def clip(self, view: tuple[float, float, float, float] | None) -> None:
        """Draw only within left, top, width and height from now on, or everywhere."""
        self.surface.set_clip(None if view is None else pygame.Rect(*(round(v * SUPERSAMPLING) for v in view)))

    def shown(self) -> pygame.Surface:
        """Return the sheet as it is shown; the next call draws over it."""
        return pygame.transform.smoothscale(self.surface, self.size, self._shown)

    def pixels(self) -> Pixels:
        """Return red, green and blue, shape (height, width, 3)."""
        flat = np.frombuffer(pygame.image.tobytes(self.shown(), "RGB"), dtype=np.uint8)
        return flat.reshape(self.size[1], self.size[0], 3).copy()


def text_width(text: str, height: float) -> float:
    """Return the width of a line of text [px]."""
    return _font(round(height * SUPERSAMPLING)).size(text)[0] / SUPERSAMPLING


def _large(places: ArrayLike) -> Any:
    return (np.asarray(places, dtype=np.float64) * SUPERSAMPLING).tolist()


@lru_cache(maxsize=32)
def _font(height: int) -> pygame.font.Font:
    pygame.font.init()
    return pygame.font.Font(None, max(height, 1))


@lru_cache(maxsize=512)
def _text(text: str, height: int, colour: Colour) -> pygame.Surface:
    return _font(height).render(text, True, colour)
