"""Superimposed dark signals: a share of the pixels follows a law of its own (paper, long integration times)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import Any, Literal

from ..engine import arrays
from ..engine.frame import Device, Frame
from ..engine.lanes import Lanes, uniforms
from ..engine.moments import rectified_normal


@dataclass(frozen=True)
class DarkPart:
    """Share ``weight`` of the pixels has a mean dark signal from this law instead of the main one.

    family : "uniform" on [first, second], or "normal" of mean first and σ second, cut at 0.
    e_per_unit : what 1 of the law's unit is [e-]; ``per_second`` says that it is a rate.
    """

    weight: float
    family: Literal["uniform", "normal"]
    first: float
    second: float
    e_per_unit: float = 1.0
    per_second: bool = False

    def electrons(self, quantile: Any, frame: Frame) -> Any:
        """(H, W) quantiles, 0 … 1 → mean dark electrons of pixels that belong to this part."""
        if self.family == "uniform":
            value = frame.number(self.first) + frame.number(self.second - self.first) * quantile
        else:
            z = frame.device.lanes.normal_of(quantile)
            value = arrays.maximum(frame.number(self.first) + frame.number(self.second) * z, 0.0)
        return frame.number(self._unit(frame.exposure.time_s)) * value

    def moments(self, time_s: float) -> tuple[float, float]:
        """Mean and variance of that [e-, e-²]."""
        unit = self._unit(time_s)
        if self.family == "uniform":
            return unit * (self.first + self.second) / 2, (unit * (self.second - self.first)) ** 2 / 12
        mean, variance = rectified_normal(self.second / self.first)
        return unit * self.first * mean, (unit * self.first) ** 2 * variance

    def _unit(self, time_s: float) -> float:
        return self.e_per_unit * (time_s if self.per_second else 1.0)


def superimpose(parts: tuple[DarkPart, ...], main: Any, frame: Frame) -> Any:
    """Mean dark electrons (H, W): every pixel belongs to the main law or to one part, for ever."""
    maps = part_maps(parts, frame.device)
    dark = main
    for number, part in enumerate(parts, start=1):
        value = part.electrons(maps["dark_part_quantile"], frame)
        dark = arrays.where(maps["dark_part"] == number, value, dark)
    return dark


def part_maps(parts: tuple[DarkPart, ...], device: Device) -> dict[str, Any]:
    """``dark_part``: 0 for the main law, else the number of the pixel's part; ``dark_part_quantile``: where in it."""
    edges = tuple(accumulate(part.weight for part in parts))
    return {
        "dark_part": device.fixed("dark_part", lambda: device.pattern("dark_part", _Number(edges))),
        "dark_part_quantile": device.fixed("dark_part_quantile", lambda: device.pattern("dark_pattern", uniforms)),
    }


def mixture_moments(parts: tuple[DarkPart, ...], mean: float, variance: float, frame: Frame) -> tuple[float, float]:
    """Mean and variance from pixel to pixel of the mixture: (1 − Σw)·main + Σ w·part."""
    laws = [(1 - sum(p.weight for p in parts), mean, variance)]
    laws += [(p.weight, *p.moments(frame.exposure.time_s)) for p in parts]
    average = sum(w * m for w, m, _ in laws)
    return average, sum(w * (v + (m - average) ** 2) for w, m, v in laws)


@dataclass(frozen=True)
class _Number:
    """Words → the number of the part: 1 below the first edge, 2 below the second, …, 0 above the last."""

    edges: tuple[float, ...]

    def __call__(self, lanes: Lanes, words: Any) -> Any:
        chance = lanes.uniform(words)
        number = 1 + arrays.count_at_or_below(self.edges, chance)
        return arrays.where(chance < lanes.number(self.edges[-1]), number, lanes.number(0.0))
