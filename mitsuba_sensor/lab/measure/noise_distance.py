"""Kullback-Leibler divergence of two samples of noise, as papers on noise models print it, with its interval."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ...core import InputError, finite_numbers
from ...core.errors import require_count
from ...core.types import Float64Array
from ..quantity import Quantity
from ..statistics.estimators import noncentrality_interval

SECTION = "Abdelhamed et al. 2019"
FEWEST_IN_A_BIN = 10


def noise_divergence(real: ArrayLike, model: ArrayLike, *, bins: int = 64) -> Quantity:
    """Kullback-Leibler divergence of the histogram of real noise from that of a model [nat].

    ::

        rng = np.random.default_rng(1)
        print(ms.lab.noise_divergence(rng.normal(0, 1, 20_000), rng.normal(0, 1.1, 20_000)))

    real, model : values of noise, arrays of any shape, independent of each other.
    bins : of equal width between the quantiles 0.1 and 99.9 % of both; neighbours with few values are joined.
    Chance makes two histograms of one law differ by (bins − 1) / 2 · (1/n + 1/m); this is taken off.
    Raises InputError for fewer than 100 values.
    """
    samples = []
    for name, noise in (("real", real), ("model", model)):
        values = finite_numbers(name, noise, "values of noise, 100 or more").ravel()
        if values.size < 100:
            raise InputError(f"{name} has {values.size} values; pass 100 or more.")
        samples.append(values)
    count = require_count("bins", bins, 4, 10_000, 64)
    counts = [np.array(part, float) for part in _histograms(samples, count)]
    above, below = (part / part.sum() for part in counts)
    logs = np.log(above / below)
    value = float((above * logs).sum())
    return _with_interval(value, counts, logs, above / below)


def _histograms(samples: list[Float64Array], bins: int) -> tuple[list[float], list[float]]:
    """Counts of both samples; bins are joined until each has enough of both, at least 10."""
    pooled = np.concatenate(samples)
    lowest, highest = np.quantile(pooled, [0.001, 0.999])
    inner = np.linspace(lowest, highest, bins - 1)
    found = [np.bincount(np.searchsorted(inner, part), minlength=bins) for part in samples]
    real, model = [0.0], [0.0]
    for own, other in zip(*found, strict=True):
        if min(real[-1], model[-1]) >= FEWEST_IN_A_BIN:
            real.append(0.0)
            model.append(0.0)
        real[-1] += float(own)
        model[-1] += float(other)
    if len(real) > 1 and min(real[-1], model[-1]) < FEWEST_IN_A_BIN:
        real[-2:] = [real[-2] + real[-1]]
        model[-2:] = [model[-2] + model[-1]]
    if len(real) < 2:
        raise InputError(
            f"no two bins have {FEWEST_IN_A_BIN} values of both; where real and model have no values in common, their "
            "divergence is infinite, and values that are all equal have none."
        )
    return real, model


def _with_interval(
    value: float, counts: list[Float64Array], logs: Float64Array, ratio: Float64Array
) -> Quantity:
    """From the noncentral χ² law of small divergences, as wide as the delta method has it for large ones."""
    sizes = [float(part.sum()) for part in counts]
    harmonic = 1 / (1 / sizes[0] + 1 / sizes[1])
    freedom = logs.size - 1
    above, below = (part / part.sum() for part in counts)
    linear = float(above @ np.square(logs) - value**2) / sizes[0]
    linear += float(below @ np.square(ratio) - 1) / sizes[1]
    square = 2 * harmonic * value
    centre = max(square - freedom, 0.0) / (2 * harmonic)
    ends = noncentrality_interval(np.array(square), freedom)
    low, high = (float(end) / (2 * harmonic) for end in ends)
    usual = 2 * max(centre, 1e-300) / harmonic
    if square > 4 * freedom:  # the noncentral part rules
        wider = math.sqrt(max(linear / usual, 0.0))
        low, high = centre - wider * (centre - low), centre + wider * (high - centre)
    name = "Kullback-Leibler divergence of noise"
    return Quantity(
        "KL", name, centre, max(min(low, centre), 0.0), max(high, centre), "nat", SECTION
    )
