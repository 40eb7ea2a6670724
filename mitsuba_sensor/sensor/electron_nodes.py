"""Nodes of mean electrons at which the theory of a pixel is tabulated."""

from __future__ import annotations

import numpy as np

from ..core.types import Float64Array
from .given_count import GivenCount

PER_DECADE = 48
KINK: Float64Array = np.arange(-10.0, 10.001, 0.25)
"""Nodes in a decade of mean electrons, and about the levels where well or converter are full, in σ of the count."""

BEATS, MOST_BEATS = 8, 64
"""Harmonics of the steps of the converter whose beat with the electrons is resolved, and how many beats of each."""


def electron_nodes(given: GivenCount, dark_e: float) -> Float64Array:
    """Evenly in their logarithm, for light and dark electrons alike, and close where the ends are.

    given : what stands behind the count.  dark_e : mean electrons that are there without light.
    """
    top = 1e4 * max(given.counts[-1], 1.0)
    parts = [np.array([0.0]), np.geomspace(1e-4, top, int(PER_DECADE * np.log10(top * 1e4)))]
    for end in given.ends_e:
        around = end + KINK * np.sqrt(end + given.read_noise_e**2 + 1)
        parts += [around, around - dark_e]
    parts.append(_beats(given))
    if given.converter.inl_lsb is not None:
        parts.append(_evenly(given, top))
    found = np.unique(np.concatenate(parts))
    found = found[(found >= 0) & np.isfinite(found)]
    return np.asarray(found[np.diff(found, prepend=-1.0) > 1e-5 * found + 1e-6])


def _beats(given: GivenCount) -> Float64Array:
    """Nodes that resolve slow beats between electrons and steps of the converter that noise and DSNU leave visible."""
    if not given.is_sharp:
        return np.zeros(0)
    pitch, sigma, top = given.dn_per_e, given.spread_dn.min(), given.counts[-1] * 1.2
    found: list[Float64Array] = []
    for k in range(1, BEATS + 1):
        slow = abs(k * pitch - round(k * pitch))
        if slow > 1e-5 and np.exp(-2 * (np.pi * k * sigma) ** 2) > 1e-3:
            period = 1 / slow
            found.append(np.arange(0, min((period / 4) ** 2, top, MOST_BEATS * period), period / 8))
    return np.concatenate(found) if found else np.zeros(0)


def _evenly(given: GivenCount, top: float) -> Float64Array:
    """Nodes a third of the noise apart, for steps of unequal width."""
    read = given.read_noise_e
    steps = np.arange(0, 6 * (np.sqrt(1.2 * given.counts[-1] + read**2) - read))
    return np.minimum((read + steps / 6) ** 2 - read**2, top)
