"""Law of the electron count of a pixel: the chance of every count for a mean and a variance, as a sparse matrix.

A variance equal to the mean is Poisson's law, exactly. A larger one (quantum yield, multiplication) is that of c·n, a
smaller one (compensated render noise) that of a + b + n with whole a, b = 0 or 1, and n of Poisson's law.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ..core.types import Float64Array

EVERY_COUNT = 2**17
"""Every count up to this one is a node where single electrons may show in the codes; or so many nodes, evenly."""

FROM = 2048
"""Nodes are all counts up to here, and then lie √N/STEPS apart where single electrons do not show."""

STEPS = 24.0
"""The sum over the nodes is the integral to 1e-4 σ also where the converter is full between two of them."""

LARGE = 1e6
"""A mean above which SciPy's incomplete gamma function loses its upper tail, and the law is normal to 1e-3 σ."""

REACH = 9.0
"""Counts further from their mean than so many σ are left out (1e-19)."""


Row = tuple[NDArray[np.intp], Float64Array]
"""Numbers of the nodes that a count can have, and their chances."""


def count_nodes(largest: float, widest: float, full: float = np.inf) -> Float64Array:
    """Counts from 0 to ``largest``, that one included [e-].

    widest : how far apart nodes may lie where the codes may follow single electrons, 1 for every count; else inf.
    full : count from which on the converter is full, and only analogue signals follow the count: nodes √N apart.
    """
    single, end = widest < 2, min(full, largest)
    last = min(largest, EVERY_COUNT if single else FROM)
    nodes = np.arange(0.0, np.floor(last) + 1)
    for until, apart in (
        (0.0 if single else min((STEPS * widest) ** 2, end), None),  # there √N/STEPS is as wide as allowed
        (0.0 if single else min(last + EVERY_COUNT * widest, end), widest),
        (end, None),
        (largest, None),
    ):
        if until > last:
            per_sigma = 1.0 if last >= full else STEPS
            more = _roots(last, until, per_sigma) if apart is None else np.arange(last + apart, until, apart)
            nodes, last = np.concatenate([nodes, np.floor(more)]), until
    return np.unique(np.append(nodes[nodes < largest], largest))


def _roots(first: float, last: float, per_sigma: float) -> Float64Array:
    """Between two counts, √N/per_sigma apart."""
    steps = np.arange(1, np.ceil(2 * per_sigma * (np.sqrt(last) - np.sqrt(first))))
    return np.asarray((np.sqrt(first) + steps / (2 * per_sigma)) ** 2)


def count_law(mean_e: Float64Array, variance_e2: Float64Array, nodes: Float64Array) -> scipy.sparse.csr_array:
    """Chance of every node for each mean and variance, (means, nodes); the last node stands for all that lie above."""
    rows = [_row(mean, variance, nodes) for mean, variance in zip(mean_e, variance_e2, strict=True)]
    pointers = np.cumsum([0, *(len(places) for places, _ in rows)])
    places, chances = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    return scipy.sparse.csr_array((chances, places, pointers), shape=(len(rows), nodes.size))


def _row(mean: float, variance: float, nodes: Float64Array) -> Row:
    """Nodes that a count can have, and their chances."""
    last = nodes.size - 1
    scale = max(variance / mean, 1.0) if mean > 0 and variance > 0 else 1.0
    shift = max(mean - variance, 0.0) if scale == 1.0 and variance < mean * (1 - 1e-12) else 0.0
    rate = (mean - shift) / scale
    if not np.isfinite(rate) or mean - REACH * np.sqrt(variance) > nodes[-1]:
        return np.array([last]), np.ones(1)
    low, high = rate - REACH * np.sqrt(rate) - 1, rate + REACH * np.sqrt(rate) + 25
    if scale == 1.0 and shift == 0.0:
        return _poisson(rate, low, high, nodes)
    step = max(int(np.sqrt(rate) / (2 * STEPS)), 1)
    n = np.arange(max(np.floor(low), 0.0), high, step)
    if scale > 1.0:
        chance = _chance(n, rate)
        return _spread(scale * n, chance / chance.sum(), nodes)
    whole = np.floor(shift)
    one = np.sqrt(shift - whole)  # a count of 0 or 1 of this mean varies less than its mean by what is left
    chance = _chance(n, max(mean - whole - one, 0.0))
    chance /= max(chance.sum(), 1e-300)
    return _spread(whole + np.append(n, n + 1), np.append((1 - one) * chance, one * chance), nodes)


def _poisson(rate: float, low: float, high: float, nodes: Float64Array) -> Row:
    last = nodes.size - 1
    first, end = np.searchsorted(nodes, low), min(int(np.searchsorted(nodes, high)), last)
    places = np.arange(first, end + 1)
    n = nodes[places]
    if end < 2 or nodes[end - 1] - nodes[first] == end - 1 - first:  # every count is a node
        chance = _chance(n, rate)
        if end == last:
            chance[-1] = scipy.special.pdtrc(np.ceil(n[-1]) - 1, rate) if n[-1] >= 1 else 1.0
        return places, chance / chance.sum()
    edges = 0.5 * (nodes[first : end + 1] + nodes[np.maximum(places - 1, 0)])  # the lower one of every node
    chance = _chance(n, rate) * np.diff(edges, append=0.5 * (n[-1] + nodes[min(end + 1, last)]))
    if end == last:
        below, edge = chance[:-1], edges[-1]
        above = scipy.special.ndtr((rate - edge) / np.sqrt(rate)) if rate > LARGE else scipy.special.pdtrc(edge, rate)
        chance = np.append(below * (1 - above) / max(below.sum(), 1e-300), above)
    return places, chance / chance.sum()


def _chance(n: Float64Array, rate: float) -> Float64Array:
    """Poisson's law."""
    if rate == 0:
        return np.where(n == 0, 1.0, 0.0)
    chance: Float64Array = np.exp(n * np.log(rate) - rate - scipy.special.gammaln(n + 1))
    return chance


def _spread(values: Float64Array, chance: Float64Array, nodes: Float64Array) -> Row:
    """Values between two nodes belong to both, by their distance."""
    values = np.minimum(values, nodes[-1])
    right = np.clip(np.searchsorted(nodes, values), 1, max(nodes.size - 1, 1))
    left = right - 1
    share = (values - nodes[left]) / (nodes[right] - nodes[left])
    return np.concatenate([left, right]), np.concatenate([chance * (1 - share), chance * share])
