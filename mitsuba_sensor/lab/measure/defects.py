"""Defect pixels: hot pixels in the dark and dead pixels in light, compared with their neighbourhood."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from ...core import InputError
from ...core.types import Float64Array
from ..frames.clipping import CLIPPED_MAX
from ..frames.stack import Stack
from ..quantity import Figures, Quantity, no_value, share_interval
from ..statistics.estimators import require_probability, z_limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "EMVA 1288 R4 8.8"
PIXELS_MIN = 100
WINDOW = 5
"""Rows and columns of the neighbourhood whose median is compared with a pixel."""
MAD_TO_SIGMA = 1.482602218505602
"""σ of a normal distribution over its median absolute deviation, 1/Φ⁻¹(3/4)."""
ROUNDING_DN = 12**-0.5
"""Standard deviation of rounding to whole numbers, the smallest σ of integer frames."""
DEAD_MAX = 0.5
"""Fraction of the neighbours' signal below which a pixel is dead: an assumption, EMVA 1288 leaves it to the user."""


@dataclass(frozen=True, eq=False)
class Defects(Figures):
    """Pixels that differ significantly from their neighbourhood; maps of shape (H, W), None without light.

    hot : brighter in the dark.  dead : less than half of their neighbours' signal in light.  deviating : other pixels
    with a different response to light.  hot_share, dead_share, deviating_share : fractions of all pixels [%].
    z_dark, z_light : deviations over their robust σ.  limit : |z| of a defect.
    """

    hot: NDArray[np.bool_]
    dead: NDArray[np.bool_] | None
    deviating: NDArray[np.bool_] | None
    hot_share: Quantity
    dead_share: Quantity
    deviating_share: Quantity
    z_dark: Float64Array
    z_light: Float64Array | None
    limit: float

    def plot(self, ax: Axes) -> None:
        """Plot the number of pixels versus deviation, with the normal distribution and the limits."""
        deviations = {"dark": self.z_dark}
        if self.z_light is not None:
            deviations["light"] = self.z_light
        ends = max(1.3 * self.limit, *(float(np.abs(z).max()) for z in deviations.values()))
        edges = np.linspace(-ends, ends, 201)
        middle = 0.5 * (edges[1:] + edges[:-1])
        for name, z in deviations.items():
            counts, _ = np.histogram(z, edges)
            ax.plot(middle[counts > 0], counts[counts > 0], ".", ms=4, label=name)
        normal = self.z_dark.size * np.diff(scipy.special.ndtr(edges))
        shown = normal > 0.1
        ax.plot(middle[shown], normal[shown], lw=1, color="0.4", label="normal distribution")
        for limit, label in ((-self.limit, None), (self.limit, "limit")):
            ax.axvline(limit, color="0.4", ls="--", lw=1, label=label)
        ax.set(xlabel="deviation from the neighbourhood [σ]", ylabel="number of pixels")
        ax.set(yscale="log", ylim=(0.5, None))


def defects(dark: Stack, light: Stack | None = None, false_alarm: float = 0.01) -> Defects:
    """Find defect pixels in the mean of dark frames, and in light minus dark.

    The median of each line is subtracted, then the median of the other 24 of 5 × 5 pixels; σ is 1.4826 times the median
    absolute deviation.
    false_alarm : probability of one or more false defects in a sensor with normal pixels.
    Raises InputError for mosaics, light of another size, fewer than 100 pixels, and an impossible probability.
    """
    dark.require_one_filter()
    size = " × ".join(map(str, dark.shape))
    if light is not None:
        light.require_one_filter()
        if light.shape != dark.shape:
            lit = " × ".join(map(str, light.shape))
            raise InputError(f"dark is {size} and light {lit}; pass equal sizes.")
    if dark.mean.size < PIXELS_MIN:
        raise InputError(f"defects need at least {PIXELS_MIN} pixels; dark is {size}.")
    require_probability(false_alarm)
    limit = z_limit(dark.mean.size, false_alarm)
    z_dark, _ = _deviations(dark.mean, dark)
    hot = z_dark > limit
    defects_in_dark = Defects(
        hot=hot,
        dead=None,
        deviating=None,
        hot_share=_share("hot", hot, dark),
        dead_share=_share("dead", None),
        deviating_share=_share("deviating", None),
        z_dark=z_dark,
        z_light=None,
        limit=limit,
    )
    if light is None:
        return defects_in_dark
    signal = light.mean - dark.mean
    z_light, expected = _deviations(signal, light)
    dead = (z_light < -limit) & (signal < DEAD_MAX * expected)
    deviating = (np.abs(z_light) > limit) & ~dead
    return replace(
        defects_in_dark,
        dead=dead,
        deviating=deviating,
        dead_share=_share("dead", dead, light, dark),
        deviating_share=_share("deviating", deviating, light, dark),
        z_light=z_light,
    )


def _deviations(image: Float64Array, stack: Stack) -> tuple[Float64Array, Float64Array]:
    """Return the deviation of each pixel from its line and neighbourhood in σ, and the expected value [DN]."""
    rest = image - np.median(image)
    for axis, length in ((1, image.shape[1]), (0, image.shape[0])):
        if length >= WINDOW:
            rest = rest - np.median(rest, axis=axis, keepdims=True)
    neighbours = np.ones((WINDOW, WINDOW), bool)
    neighbours[WINDOW // 2, WINDOW // 2] = False
    rest = rest - scipy.ndimage.median_filter(rest, footprint=neighbours, mode="reflect")
    least = ROUNDING_DN
    if stack.frames.dtype.kind == "f":
        least = 1e-9 * max(1.0, float(np.abs(image).max()))
    sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(rest))), least)
    return rest / sigma, image - rest


def _share(name: str, pixels: NDArray[np.bool_] | None, *stacks: Stack) -> Quantity:
    """Return the fraction of these pixels, without a value if noise is clipped.

    Pixels at an end of the range in every frame are defects, not clipped noise.
    """
    figure = no_value(name, f"fraction of {name} pixels", "%", SECTION)
    if pixels is None:
        return figure.noted("no light was given")
    share = share_interval(float(pixels.mean()), pixels.size)
    figure = figure.with_interval(share).scaled(100, "%")
    for stack in stacks:
        clipping = stack.clipping
        shares = clipping.shares_of_pixels(stack.frames)
        now_and_then = float(shares[shares < 1].sum())
        noise_is_clipped = len(stack) == 1 or now_and_then > CLIPPED_MAX * shares.size
        most_are = np.count_nonzero(shares == 1) >= shares.size / 2
        hides = clipping.clipped and bool(noise_is_clipped or most_are)
        if hides or clipping.lowest == clipping.largest:
            figure = figure.without_value(clipping.note, clipped=hides)
    return figure
