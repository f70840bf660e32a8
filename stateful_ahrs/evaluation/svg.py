"""Axes and curves as SVG: text stays text, colours are the page's."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape

import numpy as np

from ..filters.samples import Array

Tick = tuple[float, str]


class Scale:
    """From values to places between 0 and 1; beyond its ends a value is drawn at the end."""

    def __init__(self, low: float, high: float, *, log: bool = False) -> None:
        self.low, self.high, self.log = low, high, log

    def __call__(self, values: Array | float) -> Array:
        """Places of values; NaN where a value is."""
        low, high = sorted((self.low, self.high))
        found: Array = np.clip(np.asarray(values, dtype=np.float64), low, high)
        if self.log:
            return np.asarray(np.log(found / self.low) / math.log(self.high / self.low))
        return (found - self.low) / (self.high - self.low)

    def ticks(self, most: int = 8) -> list[Tick]:
        """Round values with their names: powers of ten, or steps of 1, 2 or 5 of one."""
        if self.log:
            return [(value, f"{value:g}") for value in self._decades()]
        width = abs(self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(width))
        step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= width * 0.999)
        first, last = sorted((self.low, self.high))
        numbers = range(math.ceil(first / step - 1e-6), math.floor(last / step + 1e-6) + 1)
        return [(n * step, f"{n * step:.10g}".replace("-", "−")) for n in numbers]

    def _decades(self) -> list[float]:
        first, last = sorted((self.low, self.high))
        powers = range(math.floor(math.log10(first)), math.ceil(math.log10(last)) + 1)
        ratio = last / first
        parts = (1, 2, 3, 5, 7) if ratio < 8.0 else (1, 2, 5) if ratio < 150.0 else (1,)
        found = (part * 10.0**power for power in powers for part in parts)
        return [value for value in found if 0.999 * first <= value <= 1.001 * last]


class Chart:
    """A picture of ``width`` × ``height`` pixels with axes inside its margins."""

    def __init__(
        self,
        size: tuple[int, int],
        x: Scale,
        y: Scale,
        margins: tuple[int, int, int, int] = (8, 24, 26, 34),
    ) -> None:
        self.x, self.y = x, y
        self.width, self.height = size
        self.top, self.right, self.bottom, self.left = margins
        self._parts: list[str] = []

    def across(self, value: float) -> float:
        """Pixels from the left."""
        return self.left + float(self.x(value)) * (self.width - self.left - self.right)

    def down(self, value: float) -> float:
        """Pixels from the top."""
        return self.height - self.bottom - float(self.y(value)) * self.inner_height

    @property
    def inner_height(self) -> int:
        """Pixels between the margins."""
        return self.height - self.top - self.bottom

    def axes(
        self, x_ticks: Iterable[Tick] | None = None, y_ticks: Iterable[Tick] | None = None
    ) -> None:
        """Lines across at the ticks of y, and both axes' names; None: the scale's own ticks."""
        right, foot = self.width - self.right, self.height - self.bottom
        for value, name in self.y.ticks() if y_ticks is None else y_ticks:
            y = self.down(value)
            self.add(f'<path class="grid" d="M{self.left} {y:.1f}H{right}"/>')
            self.text(self.left - 5, y + 4, name, "tick end")
        for value, name in self.x.ticks() if x_ticks is None else x_ticks:
            x = self.across(value)
            self.add(f'<path class="grid" d="M{x:.1f} {foot}v4"/>')
            for line, words in enumerate(name.split("\n")):
                self.text(x, foot + 16 + 13 * line, words, "tick middle")
        self.add(f'<path class="axis" d="M{self.left} {foot}H{right}"/>')

    def band(self, start: float, stop: float, kind: str) -> None:
        """Shade from one x to another."""
        x, end = self.across(start), self.across(stop)
        self.add(
            f'<rect class="{kind}" x="{x:.1f}" y="{self.top}" width="{end - x:.1f}" '
            f'height="{self.inner_height}"/>'
        )

    def curve(self, xs: Array, ys: Array, kind: str, name: str = "") -> None:
        """A line through the points, broken where one is NaN; ``name`` shows under a pointer."""
        title = f"<title>{escape(name)}</title>" if name else ""
        self.add(f'<path class="curve {kind}" d="{self._way(xs, ys)}">{title}</path>')

    def dot(self, x: float, y: float, kind: str, radius: float = 3.5) -> None:
        """A disc."""
        place = f'cx="{self.across(x):.1f}" cy="{self.down(y):.1f}"'
        self.add(f'<circle class="dot {kind}" {place} r="{radius}"/>')

    def text(self, x: float, y: float, words: str, kind: str = "") -> None:
        """Words at a place in pixels."""
        self.add(f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{escape(words)}</text>')

    def add(self, element: str) -> None:
        """Any element, in pixels."""
        self._parts.append(element)

    def svg(self, title: str) -> str:
        """The picture; ``title`` is for those who cannot see it."""
        return (
            f'<svg viewBox="0 0 {self.width} {self.height}" role="img" '
            f'aria-label="{escape(title)}">{"".join(self._parts)}</svg>'
        )

    def _way(self, xs: Array, ys: Array) -> str:
        across = self.left + self.x(xs) * (self.width - self.left - self.right)
        down = self.height - self.bottom - self.y(ys) * self.inner_height
        words: list[str] = []
        last: tuple[int, int] | None = None  # tenths of pixels: steps between them are exact
        for x, y in zip((10.0 * across).tolist(), (10.0 * down).tolist(), strict=True):
            if x != x or y != y:
                last = None
                continue
            now = round(x), round(y)
            if last is None:
                words.append(f"M{now[0] / 10:g} {now[1] / 10:g}l0 0")
            elif now != last:
                words.append(f" {(now[0] - last[0]) / 10:g} {(now[1] - last[1]) / 10:g}")
            last = now
        return "".join(words)
