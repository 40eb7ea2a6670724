"""Branches and loops over pixels, on NumPy by index and on Dr.Jit inside the kernel.

A function that is passed in gets the arrays of the pixels concerned, one dimensional on NumPy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .arrays import drjit_module, is_numpy
from .types import Array


def replace_where(condition: Array, base: Array, function: Callable[..., Array], *arguments: Array) -> Array:
    """``base``, replaced by ``function(*arguments)`` where ``condition`` holds, for conditions that hold rarely.

    NumPy computes only those pixels; a compiled kernel skips the computation where no pixel of a vector needs it.
    """
    if is_numpy(condition):
        needed = np.flatnonzero(condition)
        if needed.size:
            base = np.array(base)
            base.ravel()[needed] = function(*(x.ravel()[needed] for x in arguments))
        return base
    return drjit_module().if_stmt((base, *arguments), condition, lambda _, *a: function(*a), lambda same, *_: same)


def branch(condition: Array, yes: Callable[..., Array], no: Callable[..., Array], *arguments: Array) -> Array:
    """``yes(*arguments)`` where ``condition`` holds, else ``no(*arguments)``; each computes its own pixels only."""
    if not is_numpy(condition):
        return drjit_module().if_stmt(arguments, condition, yes, no)
    if not condition.any():
        return no(*arguments)
    if condition.all():
        return yes(*arguments)
    chosen = yes(*(x[condition] for x in arguments))
    result = np.empty(condition.shape, dtype=chosen.dtype)
    result[condition] = chosen
    result[~condition] = no(*(x[~condition] for x in arguments))
    return result


def loop(going: Callable[..., Array], step: Callable[..., tuple[Array, ...]], state: tuple[Array, ...]) -> Array:
    """Repeats ``state = step(*state)`` for every pixel while ``going(*state)`` holds; the last array of ``state``."""
    if not is_numpy(state[0]):
        return drjit_module().while_loop(state, going, step)[-1]
    result = np.empty_like(state[-1])
    index, live = np.arange(result.size), tuple(x.ravel() for x in state)
    while index.size:
        on = going(*live)
        done, rest = np.flatnonzero(~on), np.flatnonzero(on)
        result.ravel()[index[done]] = live[-1][done]
        index, live = index[rest], step(*(x[rest] for x in live))
    return result
