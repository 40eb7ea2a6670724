"""Degree and angle of linear polarisation (DoLP, AoLP) from a mosaic of polarisers, with errors.

A pixel with a polariser at θ has I(θ) = S0 + c·(S1 cos 2θ + S2 sin 2θ), with the mean S0 over all angles and the
contrast c = (r − 1)/(r + 1) for the extinction ratio r. Least squares over the pixels of a tile give S0, S1, S2 and
their variances, and then DoLP = √(S1² + S2²)/S0 and AoLP = ½ atan2(S2, S1) of the tile.

Noise alone seems polarised: the DoLP of normal values with standard deviation σ has a Rayleigh distribution with mean
σ√(π/2) without polarisation, and a Rice distribution with it. ``dolp_without_bias`` is the modified asymptotic estimate
of Plaszczynski et al. 2014, doi 10.1093/mnras/stu270.
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
"""Standard deviation of an unknown angle, uniform over 180°."""
TINY = np.finfo(float).tiny
BIASED_SIGMAS_MAX = 40.0
"""DoLP over its standard error above which its bias is below the resolution of float64."""


@dataclass(frozen=True, eq=False)
class Polarization(Figures):
    """Maps with one value for each tile of polarisers, shape (H, W) in tiles, and means over the image.

    s0, s1, s2 : Stokes parameters [DN]; s0 is the mean of the pixels.
    dolp, dolp_error : measured degree of linear polarisation, and its standard error.
    dolp_without_bias : the degree without the average contribution of noise, at least 0.
    aolp_deg, aolp_error_deg : angle from 0 to 180°, as the angles of the polarisers, and its standard error, at most
        52° as for an unknown angle.
    mean_dolp, mean_aolp : of the light of all tiles together.
    DoLP and AoLP are NaN if s0 is not positive; all maps are NaN if a pixel of the tile is saturated.
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
        """Return an image (H, W, 3) from 0 to 1: angle as hue, red at 0° and cyan at 90°, DoLP as brightness."""
        pure = hues(np.nan_to_num(self.aolp_deg))
        value = np.clip(np.nan_to_num(self.dolp_without_bias), 0.0, 1.0)
        return np.asarray(value[..., None] * pure)

    def plot(self, ax: Axes) -> None:
        """Plot the image of angle and degree."""
        ax.imshow(self.colours())
        ax.set(title="AoLP as hue, DoLP as brightness", xticks=[], yticks=[])


def hues(aolp_deg: Float64Array) -> Float64Array:
    """Return the colours of angles, shape (…, 3) from 0 to 1: red at 0°, green at 60°, cyan at 90°, blue at 120°."""
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
    """Measure DoLP and AoLP in the mean of a stack.

    angles_deg : angles of the polarisers, rows of a tile that begins at the first pixel, e.g. [[90, 45], [135, 0]].
        With colour filters over whole tiles, as on Sony's sensors, each tile has one colour.
    black_dn : mean of dark frames, a number or a map (H, W).
    variance_dn2 : temporal variance of one frame, a number or (H, W). Default: measured between at least two frames.
    saturation_dn : code from which on a pixel is saturated, if pixels saturate below the full-scale code; a saturated
        tile would seem unpolarised. Default: full-scale code of the stack's bits.
    Raises InputError for another type of stack, fewer than three angles, frames of incomplete tiles, and no variance.
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
    whole = stokes[known].sum(axis=0) / count, covariance[known].sum(axis=0) / count**2
    _, mean_error, mean, angle_deg, angle_error = map(float, _degree_and_angle(*whole))
    degree, angle = normal_interval(mean, mean_error), normal_interval(angle_deg, angle_error)
    s0, s1, s2 = np.moveaxis(stokes, -1, 0)
    maps = _degree_and_angle(stokes, covariance)
    dolp, dolp_error, dolp_without_bias, aolp_deg, aolp_error_deg = maps
    return Polarization(
        s0,
        s1,
        s2,
        dolp,
        dolp_error,
        dolp_without_bias,
        aolp_deg,
        aolp_error_deg,
        mean_dolp=Quantity("DoLP", "degree of linear polarisation", *degree, "", SECTION),
        mean_aolp=Quantity("AoLP", "angle of linear polarisation", *angle, "°", SECTION),
    )


def _least_squares(tile: Float64Array, contrast: float) -> Float64Array:
    """Return the matrix (3, pixels) from the pixels of a tile to Stokes parameters. Raises InputError."""
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
            f"angles_deg is {tile.tolist()} with a contrast of {contrast:g}; pass three different angles and an "
            "extinction ratio above 1."
        )
    return np.asarray(np.linalg.pinv(design))


def _map(name: str, values: ArrayLike, stack: Stack, wanted: str) -> Float64Array:
    """Return a number or a map (H, W). Raises InputError."""
    wanted += f", or a map {stack.shape}"
    given = finite_numbers(name, values, wanted)
    if given.shape not in ((), stack.shape):
        raise InputError(f"{name} has shape {given.shape}; pass {wanted}.")
    return given


def _in_tiles(name: str, image: Float64Array, tile: tuple[int, ...]) -> Float64Array:
    """Return an image (H, W) as (rows of tiles, columns of tiles, pixels). Raises InputError for incomplete tiles."""
    rows, columns = (n // period for n, period in zip(image.shape, tile, strict=True))
    if not rows or not columns:
        raise InputError(
            f"{name}: the frames have {image.shape[0]} × {image.shape[1]} pixels, less than a tile of {tile[0]} × "
            f"{tile[1]} polarisers; pass larger frames."
        )
    whole = rows * tile[0], columns * tile[1]
    if image.shape != whole:
        raise InputError(
            f"the frames have {image.shape[0]} × {image.shape[1]} pixels, and tiles {tile[0]} × {tile[1]} polarisers; "
            f"cut off incomplete tiles with frames[:, :{whole[0]}, :{whole[1]}]."
        )
    return (
        image.reshape(rows, tile[0], columns, tile[1])
        .transpose(0, 2, 1, 3)
        .reshape(rows, columns, -1)
    )


def _unclipped(stack: Stack, saturation_dn: float | None) -> Float64Array:
    """Return the mean of each pixel, NaN if it is saturated in any frame."""
    lowest_dn = None if stack.bits is None else 2**stack.bits - 1.0
    if saturation_dn is not None:
        lowest_dn = require(
            "saturation_dn", saturation_dn, 0.0, 1e12, "a code in DN, e.g. 4000"
        )
    if lowest_dn is None:
        return stack.mean
    return np.where((stack.frames >= lowest_dn).any(axis=0), np.nan, stack.mean)


def _variance_of_mean(stack: Stack, variance_dn2: ArrayLike | None) -> Float64Array:
    """Return the variance of the mean of each pixel, shape (H, W) [DN²]. Raises InputError."""
    if variance_dn2 is not None:
        given = _map("variance_dn2", variance_dn2, stack, "variances of a frame, e.g. 25.0 DN²")
        if given.min() < 0:
            raise InputError(
                f"variance_dn2 has values from {given.min():g}; pass variances of 0 or more."
            )
        return np.broadcast_to(given, stack.shape) / len(stack)
    if len(stack) < 2:
        raise InputError(
            f"{stack.source}: one frame shows no noise; pass two frames or variance_dn2, e.g. K·signal + σ²."
        )
    return stack.variance / len(stack)


def _degree_and_angle(
    stokes: Float64Array, covariance: Float64Array
) -> tuple[Float64Array, ...]:
    """Return DoLP, its standard error, DoLP without bias, AoLP and its standard error [°].

    stokes : shape (…, 3).  covariance : shape (…, 3, 3).
    """
    s0, s1, s2 = np.moveaxis(stokes, -1, 0)
    lit = np.where(s0 > 0, s0, np.nan)
    dolp, double = np.hypot(s1, s2) / lit, np.arctan2(s2, s1)
    cosine, sine, zero = np.cos(double), np.sin(double), np.zeros_like(double)
    along = np.stack([-dolp, cosine, sine], axis=-1)  # derivatives of DoLP times S0
    across = np.stack(
        [zero, -sine, cosine], axis=-1
    )  # derivatives of twice the angle times DoLP·S0
    radial, tangential = (
        np.sqrt(np.einsum("...i,...ij,...j->...", side, covariance, side)) / lit
        for side in (along, across)
    )
    over_error = np.minimum(dolp / np.maximum(tangential, TINY), BIASED_SIGMAS_MAX)
    bias = tangential**2 * -np.expm1(-(over_error**2))
    without_bias = np.maximum(dolp - bias / np.maximum(2 * dolp, TINY), 0.0)
    angle_error = np.degrees(tangential / np.maximum(2 * dolp, TINY))
    angle = np.where(np.isnan(lit), np.nan, np.degrees(double) / 2 % 180)
    return dolp, radial, without_bias, angle, np.minimum(angle_error, UNKNOWN_DEG)
