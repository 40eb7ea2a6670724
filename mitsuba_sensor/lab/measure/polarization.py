"""Degree and angle of linear polarisation (DoLP, AoLP) behind a mosaic of polarisers, with error bars.

A pixel behind a polariser at θ has I(θ) = S0 + c·(S1 cos 2θ + S2 sin 2θ), with S0 the mean over all angles and the
contrast c = (r − 1)/(r + 1) of the extinction ratio r. Least squares over the pixels of a tile give S0, S1, S2, and the
variances of the pixels theirs. DoLP = √(S1² + S2²)/S0 and AoLP = ½ atan2(S2, S1) are then of one tile each.

Noise alone is polarised: without polarisation the DoLP of normal values with the standard deviation σ has Rayleigh's
law with the mean σ√(π/2), and with a degree p Rice's law. ``dolp_without_bias`` is the modified asymptotic estimate of
Plaszczynski et al. 2014, doi 10.1093/mnras/stu270.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core import InputError, finite_numbers, require
from ...core.types import Float64Array
from ..frames.stack import Stack
from ..quantity import Figures, Quantity, normal_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "Stokes parameters of a polariser mosaic"
UNKNOWN_DEG = 180 / math.sqrt(12)
"""Standard deviation of an angle of which nothing is known: even over 180°."""
TINY = np.finfo(float).tiny
MOST_ERRORS = 40.0
"""Standard errors of DoLP above which it has no bias that a float64 holds."""


@dataclass(frozen=True, eq=False)
class Polarization(Figures):
    """Maps with one value for each tile of polarisers, (H, W) of tiles, and their means over the picture.

    s0, s1, s2 : Stokes parameters [DN]; s0 is the mean of the pixels.
    dolp, dolp_error : degree of linear polarisation as measured, and its standard error.
    dolp_without_bias : the same without what noise adds on average, 0 or more.
    aolp_deg, aolp_error_deg : angle, 0 to 180 as the angles of the polarisers count, and its standard error, at most
        that of an angle of which nothing is known, 52°.
    mean_dolp, mean_aolp : of the light of all tiles together, whose noise averages out.
    Where s0 is not positive, DoLP and AoLP are NaN, and all maps where a pixel of the tile is saturated.
    """

    s0: Float64Array
    s1: Float64Array
    s2: Float64Array
    dolp: Float64Array
    dolp_error: Float64Array
    dolp_without_bias: Float64Array
    aolp_deg: Float64Array
    aolp_error_deg: Float64Array
    mean_dolp: Quantity
    mean_aolp: Quantity

    def colours(self) -> Float64Array:
        """A picture, (H, W, 3) from 0 to 1: the angle as hue, red at 0° and cyan at 90°, the degree as brightness."""
        pure = hues(np.nan_to_num(self.aolp_deg))
        value = np.clip(np.nan_to_num(self.dolp_without_bias), 0.0, 1.0)
        return np.asarray(value[..., None] * pure)

    def plot(self, ax: Axes) -> None:
        """The picture of angle and degree."""
        ax.imshow(self.colours())
        ax.set(title="AoLP as hue, DoLP as brightness", xticks=[], yticks=[])


def hues(aolp_deg: Float64Array) -> Float64Array:
    """The colours of angles, (…, 3) from 0 to 1: red at 0°, green at 60°, cyan at 90°, blue at 120°."""
    sixths = aolp_deg[..., None] / 30 + np.array([5.0, 3.0, 1.0])
    distance = np.minimum(sixths % 6, 4 - sixths % 6)
    return np.asarray(1 - np.clip(distance, 0.0, 1.0))


def polarization(
    stack: Stack,
    angles_deg: ArrayLike,
    *,
    black_dn: ArrayLike = 0.0,
    extinction_ratio: float = 1e6,
    variance_dn2: ArrayLike | None = None,
    saturation_dn: float | None = None,
) -> Polarization:
    """DoLP and AoLP of the mean of a stack.

    angles_deg : of the polarisers, rows of a tile that begins at the first pixel, e.g. [[90, 45], [135, 0]]. Colour
        filters that lie over whole tiles, as on Sony's sensors, leave each tile in one colour.
    black_dn : level without light, a number or a map (H, W): of dark frames the mean.
    variance_dn2 : of one frame, a number or (H, W); by default that between the frames, of which there must be two.
    saturation_dn : code from which on a pixel is saturated, where wells are full below the largest code; a saturated
        tile would seem not to be polarised at all. By default the largest code of the stack's bits.
    Raises InputError for what is no stack, for angles that are fewer than three, for frames that are not whole tiles,
    and without a variance.
    """
    if not isinstance(stack, Stack):
        raise InputError(
            f"stack is a {type(stack).__name__}; pass ms.lab.Stack(frames.digital, time_s, bits=12)."
        )
    tile = finite_numbers(
        "angles_deg", angles_deg, "angles of the polarisers, e.g. [[90, 45], [135, 0]]"
    )
    ratio = require("extinction_ratio", extinction_ratio, 1.0, 1e9, "τ_max/τ_min, e.g. 300")
    inverse = _least_squares(tile, (ratio - 1) / (ratio + 1))
    black = _map("black_dn", black_dn, stack, "the black level in DN, e.g. 64")
    light = _in_tiles("black_dn", _unclipped(stack, saturation_dn) - black, tile.shape)
    variance = _in_tiles("variance_dn2", _variance_of_mean(stack, variance_dn2), tile.shape)
    stokes = light @ inverse.T
    covariance = np.einsum("ik,...k,jk->...ij", inverse, variance, inverse)
    known = ~np.isnan(stokes[..., 0])
    count = max(int(known.sum()), 1)
    maps = _degree_and_angle(stokes, covariance)
    _, dolp_error, dolp, aolp_deg, aolp_error_deg = map(
        float,
        _degree_and_angle(
            stokes[known].sum(axis=0) / count, covariance[known].sum(axis=0) / count**2
        ),
    )
    degree, angle = normal_interval(dolp, dolp_error), normal_interval(aolp_deg, aolp_error_deg)
    return Polarization(
        *np.moveaxis(stokes, -1, 0),
        *maps,
        mean_dolp=Quantity("DoLP", "degree of linear polarisation", *degree, "", SECTION),
        mean_aolp=Quantity("AoLP", "angle of linear polarisation", *angle, "°", SECTION),
    )


def _least_squares(tile: Float64Array, contrast: float) -> Float64Array:
    """The matrix (3, pixels) that makes Stokes parameters of the pixels of a tile. Raises InputError."""
    if tile.ndim != 2:
        raise InputError(
            f"angles_deg has shape {tile.shape}; pass rows of angles of a tile, e.g. [[90, 45], [135, 0]]."
        )
    double = 2 * np.radians(tile.ravel())
    design = np.stack(
        [np.ones_like(double), contrast * np.cos(double), contrast * np.sin(double)], axis=1
    )
    if np.linalg.matrix_rank(design, tol=1e-6) < 3:
        raise InputError(
            f"angles_deg is {tile.tolist()} with a contrast of {contrast:g}; DoLP and AoLP need three different angles "
            "and polarisers with an extinction ratio above 1."
        )
    return np.asarray(np.linalg.pinv(design))


def _map(name: str, values: ArrayLike, stack: Stack, wanted: str) -> Float64Array:
    """A number or a map (H, W). Raises InputError."""
    wanted += f", or a map {stack.shape}"
    given = finite_numbers(name, values, wanted)
    if given.shape not in ((), stack.shape):
        raise InputError(f"{name} has shape {given.shape}; pass {wanted}.")
    return given


def _in_tiles(name: str, image: Float64Array, tile: tuple[int, ...]) -> Float64Array:
    """(H, W) → (H of tiles, W of tiles, pixels of a tile). Raises InputError for a part of a tile at the edges."""
    rows, columns = (n // period for n, period in zip(image.shape, tile, strict=True))
    if not rows or not columns:
        raise InputError(
            f"{name}: the frames have {image.shape[0]} × {image.shape[1]} pixels, fewer than the tile of polarisers, "
            f"{tile[0]} × {tile[1]}; pass larger frames."
        )
    whole = rows * tile[0], columns * tile[1]
    if image.shape != whole:
        raise InputError(
            f"the frames have {image.shape[0]} × {image.shape[1]} pixels, and tiles of polarisers have {tile[0]} × "
            f"{tile[1]}; cut off what is left at the edges, frames[:, :{whole[0]}, :{whole[1]}]."
        )
    return (
        image.reshape(rows, tile[0], columns, tile[1])
        .transpose(0, 2, 1, 3)
        .reshape(rows, columns, -1)
    )


def _unclipped(stack: Stack, saturation_dn: float | None) -> Float64Array:
    """Mean of each pixel; NaN where it is saturated in any frame: by default at the largest code, if that is known."""
    lowest_dn = None if stack.bits is None else 2**stack.bits - 1.0
    if saturation_dn is not None:
        lowest_dn = require(
            "saturation_dn", saturation_dn, 0.0, 1e12, "a code in DN, e.g. 4000"
        )
    if lowest_dn is None:
        return stack.mean
    return np.where((stack.frames >= lowest_dn).any(axis=0), np.nan, stack.mean)


def _variance_of_mean(stack: Stack, variance_dn2: ArrayLike | None) -> Float64Array:
    """Variance of the mean of each pixel, (H, W) [DN²]. Raises InputError."""
    if variance_dn2 is not None:
        given = _map("variance_dn2", variance_dn2, stack, "variances of a frame, e.g. 25.0 DN²")
        if given.min() < 0:
            raise InputError(
                f"variance_dn2 has values from {given.min():g}; pass variances of 0 or more."
            )
        return np.broadcast_to(given, stack.shape) / len(stack)
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame shows no noise; pass two frames or more, or variance_dn2, e.g. K·signal + σ²."
        )
    return stack.variance / len(stack)


def _degree_and_angle(
    stokes: Float64Array, covariance: Float64Array
) -> tuple[Float64Array, ...]:
    """DoLP, its standard error, DoLP without bias, AoLP and its standard error [°], of (…, 3) and (…, 3, 3)."""
    s0, s1, s2 = np.moveaxis(stokes, -1, 0)
    lit = np.where(s0 > 0, s0, np.nan)
    dolp, double = np.hypot(s1, s2) / lit, np.arctan2(s2, s1)
    cosine, sine, zero = np.cos(double), np.sin(double), np.zeros_like(double)
    along = np.stack([-dolp, cosine, sine], axis=-1)  # derivatives of DoLP times S0
    across = np.stack([zero, -sine, cosine], axis=-1)  # of twice the angle times DoLP·S0
    radial, tangential = (
        np.sqrt(np.einsum("...i,...ij,...j->...", side, covariance, side)) / lit
        for side in (along, across)
    )
    over_error = np.minimum(dolp / np.maximum(tangential, TINY), MOST_ERRORS)
    bias = tangential**2 * -np.expm1(-(over_error**2))
    without_bias = np.maximum(dolp - bias / np.maximum(2 * dolp, TINY), 0.0)
    angle_error = np.degrees(tangential / np.maximum(2 * dolp, TINY))
    angle = np.where(np.isnan(lit), np.nan, np.degrees(double) / 2 % 180)
    return dolp, radial, without_bias, angle, np.minimum(angle_error, UNKNOWN_DEG)
