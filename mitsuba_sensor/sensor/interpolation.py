"""Cubic interpolation between uneven nodes, as a sparse matrix that serves any number of tables."""

from __future__ import annotations

import numpy as np
import scipy

from ..core.types import Float64Array


def interpolation(nodes: Float64Array, at: Float64Array) -> scipy.sparse.csr_array:
    """Lagrange's cubic through the four nodes about each place, (places, nodes); constant beyond the last."""
    places = np.minimum(at, nodes[-1])
    first = np.clip(np.searchsorted(nodes, places, side="right") - 2, 0, nodes.size - 4)
    columns = first[:, None] + np.arange(4)
    x = nodes[columns]
    weights = np.ones(columns.shape)
    for k in range(4):
        for j in range(4):
            if j != k:
                weights[:, k] *= (places - x[:, j]) / (x[:, k] - x[:, j])
    pointers = np.arange(0, 4 * places.size + 1, 4)
    return scipy.sparse.csr_array((weights.ravel(), columns.ravel(), pointers), shape=(places.size, nodes.size))
