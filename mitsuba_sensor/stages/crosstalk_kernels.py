"""Kernels of crosstalk as a camera file has them: shares of the photoelectrons of a pixel, and which are possible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.types import Float64Array
from .datasheet import Chance

Kernel = tuple[tuple[Chance, ...], ...]
Tile: TypeAlias = tuple[tuple[int, ...], ...]
SIDES = (3, 5)
ROUNDING = 1e-9
"""By which a sum of shares that were rounded in a file may pass 1."""

KEEPS_ALL: Kernel = ((1.0,),)
GIVES_NOTHING: Kernel = ((0.0,),)
EXAMPLE = [[0.0, 0.02, 0.0], [0.02, 0.92, 0.02], [0.0, 0.02, 0.0]]
OWN_EXAMPLE = [[0.0, 0.0, 0.0], [0.0, 0.92, 0.0], [0.0, 0.0, 0.0]]
PAIR_EXAMPLE = [[0.0, 0.02, 0.0], [0.02, 0.0, 0.02], [0.0, 0.02, 0.0]]


def of_reach(kernel: Kernel, reach_px: int) -> Kernel:
    """The same shares, with zeros about them."""
    padded = np.pad(np.array(kernel), reach_px - len(kernel) // 2)
    return tuple(tuple(row) for row in padded.tolist())


def check_kernel(name: str, kernel: Kernel) -> None:
    """Raise ValueError for another shape, and for shares that no pixel can give."""
    _check_shape(name, kernel)
    _check_shares(name, np.array(kernel))


def check_pairs(
    source: str, of_receivers: Mapping[str, Kernel], names: tuple[str, ...], tile: Tile
) -> None:
    """Raise ValueError for shares that pixels behind a filter cannot give to those behind it and behind others.

    source : name of the filter.  of_receivers : its kernel for each of them.  names : of all filters.
    """
    where = f"crosstalk_pairs.{source}"
    for receiver, kernel in of_receivers.items():
        if receiver not in names:
            raise ValueError(
                f"{where} names {receiver!r}, which has no curve; there are {sorted(names)}"
            )
        _check_shape(f"{where}.{receiver}", kernel)
    if source not in of_receivers:
        raise ValueError(
            f"{where} has no {source!r}, and so its pixels would keep nothing; give their own shares, e.g. "
            f"{source} = {OWN_EXAMPLE}"
        )
    reach_px = max(len(kernel) // 2 for kernel in of_receivers.values())
    given = [of_receivers.get(name, GIVES_NOTHING) for name in names]
    kernels = np.array([of_reach(kernel, reach_px) for kernel in given])
    numbers, lies = np.arange(len(names))[:, None, None], np.zeros(kernels.shape, bool)
    for place in np.argwhere(np.array(tile) == names.index(source)):
        here = numbers == _filters_about(place, reach_px, tile)
        lies |= here
        shares = np.sum(np.where(here, kernels, 0.0), axis=0)
        _check_shares(f"{where} of the pixel at {place.tolist()} of the tile", shares)
    _check_receivers(where, names, (kernels > 0) & ~lies)


def _filters_about(place: NDArray[np.intp], reach_px: int, tile: Tile) -> NDArray[np.intp]:
    """Filter numbers of a pixel of the tile and of those about it, (2·reach_px + 1)²."""
    about = np.arange(-reach_px, reach_px + 1)
    rows, columns = (
        (first + about) % period for first, period in zip(place, np.shape(tile), strict=True)
    )
    return np.asarray(np.array(tile)[np.ix_(rows, columns)])


def _check_receivers(where: str, names: tuple[str, ...], nowhere: NDArray[np.bool_]) -> None:
    """Raise ValueError for shares that nobody would get.  nowhere : which, (F, rows, columns)."""
    for number, row, column in np.argwhere(nowhere):
        raise ValueError(
            f"{where}.{names[number]} has a share in row {row - nowhere.shape[1] // 2:+d} and column "
            f"{column - nowhere.shape[2] // 2:+d} from the pixel, where none behind {names[number]} lies in this tile; "
            "let it be 0, and give it to the filter that is there"
        )


def _check_shape(name: str, kernel: Kernel) -> None:
    """Raise ValueError for another shape than 3 × 3 and 5 × 5."""
    side = len(kernel)
    if side not in SIDES or any(len(row) != side for row in kernel):
        raise ValueError(
            f"{name} has rows of {', '.join(str(len(row)) for row in kernel)} shares; it must be 3 rows of 3 or "
            f"5 rows of 5, e.g. {EXAMPLE}"
        )


def _check_shares(name: str, shares: Float64Array) -> None:
    """Raise ValueError for more electrons than there were, and for a pixel that keeps too few."""
    if shares.sum() > 1 + ROUNDING:
        raise ValueError(
            f"{name} adds up to {shares.sum():.6g}, and there are no more electrons than the light has freed; "
            "let the shares add up to 1, or less where some are lost"
        )
    middle = shares[len(shares) // 2, len(shares) // 2]
    if middle < max(shares.max(), ROUNDING):
        raise ValueError(
            f"{name} gives {middle:g} to the pixel itself and {shares.max():g} to another; the share in the middle "
            "must be the largest"
        )
