"""Contrast detection probability and contrast transfer accuracy of two patches (IEEE 2020).

Each pixel of the bright patch has a contrast with each pixel of the dark patch. Contrast transfer accuracy (CTA) is the
fraction of these contrasts within bounds about the contrast of the scene (called contrast detection probability by
Geese et al. 2018 and Artmann et al. 2019). Contrast detection probability (CDP) is the fraction above the lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ....core import InputError, finite_numbers, require
from ....core.errors import shown
from ....core.types import Float64Array
from ...quantity import Figures, Quantity, no_value, normal_interval, share_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SECTION = "IEEE 2020"
PIXELS_MIN = 16
KINDS = ("weber", "michelson")


@dataclass(frozen=True, eq=False)
class Contrast(Figures):
    """Contrast of two patches.

    accuracy : contrast transfer accuracy.  detection : contrast detection probability.
    mean : contrast of the mean values.  ratios : bright over dark for 10 000 pairs of pixels.
    bounds : of the ratio, for the accuracy.
    """

    accuracy: Quantity
    detection: Quantity
    mean: Quantity
    ratios: Float64Array
    bounds: tuple[float, float]

    def plot(self, ax: Axes) -> None:
        """Plot a histogram of the ratios of pixels, and the bounds."""
        ax.hist(self.ratios, bins=100, density=True, label="pairs of pixels")
        for number, bound in enumerate(self.bounds):
            ax.axvline(bound, color="k", ls="--", lw=1, label=("bounds", None)[number])
        ax.set(xlabel="bright over dark pixel", ylabel="density")


def contrast_detection(
    bright: ArrayLike,
    dark: ArrayLike,
    contrast: float,
    *,
    tolerance: float = 0.5,
    kind: str = "weber",
) -> Contrast:
    """Measure how often a pair of pixels of two patches shows the contrast of the scene.

    ::

        rng = np.random.default_rng(1)
        bright, dark = rng.normal(150, 10, (40, 40)), rng.normal(100, 10, (40, 40))
        print(ms.lab.contrast_detection(bright, dark, 0.5).detection)

    bright, dark : linear values of each patch without the black level, shape (H, W) or (N, H, W); frames of a pixel are
        one case, because they share its fixed pattern.
    contrast : of the scene, above 0: bright / dark − 1 ("weber"), or (bright − dark) / (bright + dark) ("michelson").
    tolerance : the bounds are contrast·(1 ± tolerance).
    Raises InputError for patches of fewer than 16 pixels and impossible contrasts.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        raise InputError(f"kind is {shown(kind)}; it must be one of {', '.join(KINDS)}.")
    largest = {"weber": 1e6, "michelson": 1.0}[kind]
    contrast = require("contrast", contrast, 1e-6, largest, "of the scene, e.g. 0.5")
    tolerance = require("tolerance", tolerance, 1e-6, 1.0, "relative to contrast, e.g. 0.5")
    patches = _pixels("bright", bright), _pixels("dark", dark)
    ends = contrast * (1 - tolerance), contrast * (1 + tolerance)
    if kind == "michelson":  # bright over dark is infinite at a contrast of 1
        low, high = ((1 + c) / (1 - c) if c < 1 else np.inf for c in ends)
    else:
        low, high = 1 + ends[0], 1 + ends[1]
    accuracy = _share("CTA", "contrast transfer accuracy", patches, (low, high))
    detection = _share("CDP", "contrast detection probability", patches, (low, np.inf))
    rng = np.random.default_rng(0)
    above, below = (rng.choice(patch.ravel(), 10_000) for patch in patches)
    ratios = above[below > 0] / below[below > 0]
    return Contrast(accuracy, detection, _mean_contrast(patches, kind), ratios, (low, high))


def _pixels(name: str, values: ArrayLike) -> Float64Array:
    """Return a patch as (frames, pixels). Raises InputError."""
    wanted = f"values (rows, columns) or (frames, rows, columns) of {PIXELS_MIN} pixels or more"
    patch = finite_numbers(name, values, wanted)
    if patch.ndim == 2:
        patch = patch[None]
    if patch.ndim != 3 or not len(patch) or patch[0].size < PIXELS_MIN:
        raise InputError(f"{name} has shape {patch.shape}; pass {wanted}.")
    return patch.reshape(len(patch), -1)


def _share(
    symbol: str,
    name: str,
    patches: tuple[Float64Array, Float64Array],
    ends: tuple[float, float],
) -> Quantity:
    """Return the fraction of all pairs with a ratio within the ends, with a variance from the means over each patch."""
    bright, dark = patches
    by_bright = _count(np.sort(dark.ravel()), bright, (1 / ends[1], 1 / ends[0])) / dark.size
    by_dark = _count(np.sort(bright.ravel()), dark, ends) / bright.size
    share = float(by_bright.mean())
    variance = sum(
        float(part.mean(axis=0).var(ddof=1)) / part.shape[1] for part in (by_bright, by_dark)
    )
    cases = float(min(bright.shape[1], dark.shape[1]))
    if variance > 0 and 0 < share < 1:
        cases = max(share * (1 - share) / variance, 1.0)
    return Quantity(symbol, name, *share_interval(share, cases), "", SECTION)


def _count(
    others: Float64Array, values: Float64Array, ends: tuple[float, float]
) -> Float64Array:
    """Count for each value above 0 the sorted others between ends times the value."""
    lowest, highest = (
        np.where(values > 0, end * np.maximum(values, 1e-300), -np.inf) for end in ends
    )
    low = np.searchsorted(others, lowest, "left")
    if ends[0] == 0:  # dark pixels below 0 are darker than any bright one
        low[:] = 0
    high = np.searchsorted(others, highest, "right")
    return np.asarray(np.maximum(high - low, 0), np.float64)


def _mean_contrast(patches: tuple[Float64Array, Float64Array], kind: str) -> Quantity:
    """Return the contrast of the means, without a value unless both are above 0."""
    means = [float(patch.mean()) for patch in patches]
    errors = [
        float(patch.mean(axis=0).std(ddof=1)) / patch.shape[1] ** 0.5 for patch in patches
    ]
    name = f"contrast of the means, {kind}"
    if not min(means) > 0:
        return no_value("C", name, "", SECTION, "a patch is not brighter than black")
    ratio = means[0] / means[1]
    error = ratio * np.hypot(errors[0] / means[0], errors[1] / means[1])
    value = ratio - 1
    if kind == "michelson":
        value, error = (ratio - 1) / (ratio + 1), 2 * error / (ratio + 1) ** 2
    return Quantity("C", name, *normal_interval(value, float(error)), "", SECTION)
