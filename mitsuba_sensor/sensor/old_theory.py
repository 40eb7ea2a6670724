"""Moments of a chain's digital numbers, with two corrections that depend on more than one stage.

A full well that the converter hides: a signal that is clipped twice is not normal the second time, and the theory of
one clip after the other is wrong by up to half of the noise where the well is nearly full. By default the black level
makes the converter end below the well: then only its own clip matters.

Whole electrons: where next to no noise follows the shot noise, codes and electrons interfere, and the mean of rounded
numbers is not that of a rounded normal.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ..core import Array, Frame, Moments, Photons, SensorWindow
from .stage import Chain, Converter, converter_of

HIDDEN = 4.0
"""A well is hidden if it is so many σ of the noise behind it above the converter's end; what the cut in the well then
still does to a pixel that is nearly full is below 1e-5 of that σ. (A default black level is 4σ.)"""

BEATS = 64
"""Harmonics of the steps that are looked at. Noise of 0.02 DN behind the counting damps the others; with none at all,
and few electrons one of which is next to the edge of a code, the mean may be off by a few hundredths of a DN."""

FAINT = 1e-6
"""A beat that the noise behind the counting weakens to less than that share is none."""

FinalMoments = tuple[Moments, Moments]
"""Without and with the converter's rounding, which can hide a change and can blow it up [DN]."""


def final_moments(stages: Chain, light: Photons, frame: Frame) -> FinalMoments:
    """Moments of the digital numbers that these stages make of ``light``, at every pixel of the window."""
    well = hidden_well(stages, frame)
    m, counts, full_share = Moments(light, 0.0, 0.0, frame), None, None
    *analogue, _ = stages
    converter = converter_of(stages)
    for stage in analogue:
        if stage.counts_electrons:
            counts = m
        if well is not None and stage.saturation_e is not None:
            full_share = _share_above(m, stage.saturation_e)
        else:
            m = stage.moments(m)
    ends = _converted(converter, m)
    if well is not None and full_share is not None:
        ends = _mixed(ends[0], well[0], full_share), _mixed(ends[1], well[1], full_share)
    return ends if counts is None else (ends[0], _with_beat(ends[1], stages, counts))


def _converted(converter: Converter, m: Moments) -> FinalMoments:
    smooth = m.scale(converter.gain_dn_per_v).add(mean=converter.black_level_dn).clip(0.0, converter.highest)
    return smooth, converter.moments(m)


def hidden_well(stages: Chain, frame: Frame) -> FinalMoments | None:
    """What a pixel whose well is full reads, less the highest code [DN]; None if the converter does not end below."""
    place = next((k for k, stage in enumerate(stages) if stage.saturation_e is not None), None)
    if place is None:
        return None
    pixel = replace(frame, window=SensorWindow(0, (1, 1), given=frame.window.given))
    m, converter = Moments(stages[place].saturation_e, 0.0, 0.0, pixel), converter_of(stages)
    for stage in stages[place + 1 : -1]:
        m = stage.moments(m)
    top = m.scale(converter.gain_dn_per_v).add(mean=converter.black_level_dn)
    if not np.all(top.mean - converter.highest >= HIDDEN * top.sigma):
        return None
    smooth, rounded = (end.add(mean=-converter.highest) for end in _converted(converter, m))
    return smooth, rounded


def _share_above(m: Moments, edge: float) -> Array:
    """The chance that a signal is above ``edge``."""
    sigma = np.sqrt(np.asarray(m.temporal + m.spatial, dtype=np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        chance = special.ndtr((np.asarray(m.mean, dtype=np.float64) - edge) / sigma)
    return np.where((sigma > 0) & np.isfinite(sigma), chance, np.asarray(m.mean) > edge)


def _mixed(end: Moments, full: Moments, share: Array) -> Moments:
    """``end``, where so often the well is full: the noise behind it may then reach below the last code."""
    return end.add(mean=share * full.mean, temporal=share * full.temporal, spatial=share * full.spatial)


def _with_beat(rounded: Moments, stages: Chain, counts: Moments) -> Moments:
    """The mean of rounded codes of whole electrons.

    round(x) = x + Σ (−1)^k/(πk)·sin 2πkx (core/rounding.py); for x = a + K·n + noise, n ~ Poisson(λ) and λ itself of
    variance V, each sine has the characteristic functions of both as its factor, where rounding took that of a normal.
    """
    place = next(k for k, stage in enumerate(stages) if stage.counts_electrons)
    line = _line_behind(stages, place, counts)
    if line is None:
        return rounded
    start, pitch, after = line
    mean, spread = _finite(counts.mean), _finite(counts.temporal + counts.spatial)
    beat: NDArray[np.float64] = np.zeros(np.broadcast_shapes(mean.shape, spread.shape, np.shape(after)))
    for k in range(1, BEATS + 1):
        left = np.exp(-2 * (math.pi * k) ** 2 * after)
        if np.max(left) < FAINT:
            break
        turn = math.remainder(2 * math.pi * k * pitch, 2 * math.pi)  # by which one electron more turns the phase
        counted = _of_counts(turn, mean, spread)
        normal = np.exp(2j * math.pi * k * pitch * mean - 2 * (math.pi * k * pitch) ** 2 * (mean + spread))
        wave = np.exp(2j * math.pi * k * start) * (counted - normal)
        beat += (-1) ** k / (math.pi * k) * left * np.imag(wave)
    inside = (rounded.mean > 0.5) & (rounded.mean < converter_of(stages).highest - 0.5)
    return rounded.add(mean=np.where(inside, beat, 0.0))


def _of_counts(turn: float, mean: Array, spread: Array) -> Array:
    """E exp(i·turn·n) of n ~ Poisson(λ), λ ~ Normal(mean, spread); 0 where the spread leaves no phase."""
    step = np.exp(1j * turn) - 1
    exponent = step * mean + 0.5 * step**2 * spread
    exponent = np.minimum(exponent.real, 0.0) + 1j * exponent.imag
    return np.where(turn**2 * spread < 9.0, np.exp(exponent), 0.0)


def _line_behind(stages: Chain, place: int, counts: Moments) -> tuple[float, float, Array] | None:
    """Code of no electron, codes per electron, and variance behind the counting [DN²]; None for a curved chain."""
    converter = converter_of(stages)
    if not all(stage.even_codes for stage in stages):
        return None

    def behind(electrons: Array) -> Moments:
        m = replace(counts, mean=electrons, temporal=0.0, spatial=0.0, light=None, variance_e2=None)
        for stage in stages[place + 1 : -1]:
            if not stage.saturation_e is not None:
                m = stage.moments(m)
        return m.scale(converter.gain_dn_per_v).add(mean=converter.black_level_dn)

    none, one, many = (float(np.mean(behind(n).mean)) for n in (0.0, 1.0, 1e4))
    pitch = one - none
    if not math.isclose(many - none, 1e4 * pitch, rel_tol=1e-9):
        return None
    m = behind(_finite(counts.mean))
    return none, pitch, np.asarray(m.temporal + m.spatial, dtype=np.float64)


def _finite(values: Array) -> NDArray[np.float64]:
    """0 where the light is infinite: such a pixel is saturated, and nothing beats there."""
    return np.where(np.isfinite(values), values, 0.0)
