"""Colour difference CIEDE2000 (CIE 142:2001; formulas and names of Sharma, Wu and Dalal 2005)."""

from __future__ import annotations

import numpy as np

from ..core import Float64Array


def delta_e_2000(first: Float64Array, second: Float64Array) -> Float64Array:
    """ΔE00 of colours in CIELAB (..., 3), with k_L = k_C = k_H = 1."""
    lightness, a, b = np.moveaxis(np.stack(np.broadcast_arrays(first, second)), -1, 0)
    mean_chroma = np.hypot(a, b).mean(axis=0)
    stretched = a * (1 + 0.5 * (1 - _saturating(mean_chroma)))
    chroma = np.hypot(stretched, b)
    hue = np.degrees(np.arctan2(b, stretched)) % 360
    turn = (hue[1] - hue[0] + 180) % 360 - 180
    coloured = chroma.prod(axis=0) > 0
    d_hue = 2 * np.sqrt(chroma.prod(axis=0)) * np.sin(np.radians(turn) / 2)
    mean_hue = np.where(coloured, hue[0] + turn / 2, hue.sum(axis=0)) % 360
    d_lightness, d_chroma = lightness[1] - lightness[0], chroma[1] - chroma[0]
    middle, mean_stretched = lightness.mean(axis=0), chroma.mean(axis=0)
    bright = np.square(middle - 50)
    lightness_part = d_lightness / (1 + 0.015 * bright / np.sqrt(20 + bright))
    chroma_part = d_chroma / (1 + 0.045 * mean_stretched)
    hue_part = d_hue / (1 + 0.015 * mean_stretched * _hue_weight(mean_hue))
    angle = 60 * np.exp(-np.square((mean_hue - 275) / 25))
    rotation = -2 * _saturating(mean_stretched) * np.sin(np.radians(angle))
    squares = lightness_part**2 + chroma_part**2 + hue_part**2
    return np.asarray(np.sqrt(np.maximum(squares + rotation * chroma_part * hue_part, 0.0)))


def _saturating(chroma: Float64Array) -> Float64Array:
    """√(C⁷ / (C⁷ + 25⁷))."""
    return np.asarray(np.sqrt(chroma**7 / (chroma**7 + 25.0**7)))


def _hue_weight(hue_deg: Float64Array) -> Float64Array:
    """The factor T of the hue's weight."""
    hue = np.radians(hue_deg)
    first = 1 - 0.17 * np.cos(hue - np.pi / 6) + 0.24 * np.cos(2 * hue)
    second = 0.32 * np.cos(3 * hue + np.pi / 30) - 0.20 * np.cos(4 * hue - np.radians(63))
    return np.asarray(first + second)
