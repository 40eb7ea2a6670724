"""Kullback–Leibler divergence of two samples of noise, as in papers on noise models, with its interval."""

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
BIN_VALUES_MIN = 10


def noise_divergence(real: ArrayLike, model: ArrayLike, *, bins: int = 64) -> Quantity:
    """Return the Kullback–Leibler divergence of the histogram of real noise from that of a model [nat].

    ::

        rng = np.random.default_rng(1)
        print(ms.lab.noise_divergence(rng.normal(0, 1, 20_000), rng.normal(0, 1.1, 20_000)))

    real, model : independent values of noise, arrays of any shape.
    bins : number of bins of equal width between the quantiles 0.1 and 99.9 % of both; bins with few values are joined.
    The divergence of two samples of one distribution, (bins − 1) / 2 · (1/n + 1/m), is subtracted.
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
    """Return the counts of both samples, with bins joined until each has at least 10 values of both."""
    pooled = np.concatenate(samples)
    lowest, highest = np.quantile(pooled, [0.001, 0.999])
    inner = np.linspace(lowest, highest, bins - 1)
    counts = [np.bincount(np.searchsorted(inner, part), minlength=bins) for part in samples]
    real, model = [0.0], [0.0]
    for of_real, of_model in zip(*counts, strict=True):
        if min(real[-1], model[-1]) >= BIN_VALUES_MIN:
            real.append(0.0)
            model.append(0.0)
        real[-1] += float(of_real)
        model[-1] += float(of_model)
    if len(real) > 1 and min(real[-1], model[-1]) < BIN_VALUES_MIN:
        real[-2:] = [real[-2] + real[-1]]
        model[-2:] = [model[-2] + model[-1]]
    if len(real) < 2:
        raise InputError(
            f"no two bins have {BIN_VALUES_MIN} values of both real and model; pass samples that overlap and are not "
            "all equal."
        )
    return real, model


def _with_interval(
    value: float, counts: list[Float64Array], logs: Float64Array, ratio: Float64Array
) -> Quantity:
    """Return the divergence with its interval, from noncentral χ² widened to the delta method for large values."""
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
    if square > 4 * freedom:  # the noncentral part dominates
        wider = math.sqrt(max(linear / usual, 0.0))
        low, high = centre - wider * (centre - low), centre + wider * (high - centre)
    name = "Kullback–Leibler divergence of noise"
    return Quantity(
        "KL", name, centre, max(min(low, centre), 0.0), max(high, centre), "nat", SECTION
    )
