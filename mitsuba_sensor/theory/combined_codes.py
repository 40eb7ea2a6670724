"""Mean and variance of the linear code of combined read-outs, in closed form from those of each read-out.

The codes of two read-outs are normal. Those of one charge have the covariance K_1·K_2·μ of its shot noise; given the
code x of the more sensitive one, the other is normal about m_2 + β·(x − m_1), β = Cov/σ_1². The hand-over depends on x
alone, so that mean and variance of the combination are integrals over x, split where x begins and ends to hand over.
More than two read-outs are combined from the last one backwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core import Frame, Moments
from ..core.types import Float64Array
from ..stages.combination import Combination, LinearisedReadout
from ..stages.combined_readouts import CombinedReadouts

QUANTISATION_DN2 = 1 / 12
STILL_DN2 = 1e-6
"""Variance of a code that is the same in all but one of a million frames [DN²]."""
NODES, WIDTH = 24, 9.0
"""Nodes of each part of an integral, and how many σ it reaches."""


class Estimate(NamedTuple):
    """Mean and variance of electrons of the reference exposure, (P,) each [e-, e-²]."""

    mean: Float64Array
    variance: Float64Array


class CodeMoments(NamedTuple):
    """Mean and variance of the code of one read-out, (P,) each [DN, DN²]."""

    mean: Float64Array
    variance: Float64Array


def combined_codes(
    stage: CombinedReadouts, codes: list[CodeMoments], frame: Frame
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the linear code, (P,) each [DN, DN²].

    codes : of each read-out, in the order of the stage.  frame : its conditions.
    """
    combination, last = stage.combination, len(codes) - 1
    found = _estimate(combination, last, codes[last])
    for number in range(last - 1, -1, -1):
        own = _estimate(combination, number, codes[number])
        covariance_e2 = np.zeros(own.mean.shape)
        if stage.readouts[number].charge == stage.readouts[number + 1].charge:
            shot_e = _estimate(combination, number + 1, codes[number + 1]).mean
            shot_e2 = np.maximum(shot_e, 0.0) / stage.readouts[number].light_ratio
            covariance_e2 = np.minimum(shot_e2, np.sqrt(own.variance * found.variance))
        readout = combination.readouts[number]
        found = _handed_over(readout, codes[number], own, found, covariance_e2)
    gain = combination.gain_dn_per_e
    linear = Moments(
        combination.black_level_dn + gain * found.mean, gain**2 * found.variance, 0.0, frame
    )
    clipped = linear.clip(0.0, combination.highest)
    return np.asarray(clipped.mean), np.asarray(clipped.temporal)


def _estimate(combination: Combination, number: int, codes: CodeMoments) -> Estimate:
    """The codes of a read-out as electrons of the reference exposure, rounded to the linear code.

    Where the code has less noise than rounding, as in a saturated converter, rounding to the linear code adds that much
    less; a code that never changes is one linear code.
    """
    readout = combination.readouts[number]
    per_dn_e, gain = readout.electrons_per_dn, combination.gain_dn_per_e
    rounding_e, rounding_e2 = combination.rounding_e(number)
    plain_e = per_dn_e * (codes.mean - readout.black_dn)
    black_dn = combination.black_level_dn
    one_code_e = (np.floor(gain * plain_e + black_dn + 0.5) - black_dn) / gain
    dithered = np.clip(codes.variance / QUANTISATION_DN2, 0.0, 1.0)
    return Estimate(
        np.where(codes.variance < STILL_DN2, one_code_e, plain_e + rounding_e),
        per_dn_e**2 * codes.variance + dithered * rounding_e2,
    )


def _handed_over(
    readout: LinearisedReadout,
    codes: CodeMoments,
    own: Estimate,
    other: Estimate,
    covariance_e2: Float64Array,
) -> Estimate:
    """A read-out and what it hands over to, as one estimate.

    covariance_e2 : of both estimates, from the shot noise of a charge that they share.
    """
    sigma_dn = np.sqrt(codes.variance)
    begin_dn, end_dn = readout.begin_dn, readout.end_dn
    if begin_dn == end_dn:
        begin_dn = end_dn = end_dn - 0.5  # a whole code reaches the threshold
    before = codes.mean + WIDTH * sigma_dn < begin_dn
    behind = codes.mean - WIDTH * sigma_dn >= end_dn
    mean, variance = (
        np.where(behind, other.mean, own.mean),
        np.where(behind, other.variance, own.variance),
    )
    between = ~(before | behind)
    if between.any():
        part = _Part(
            readout.electrons_per_dn,
            begin_dn,
            end_dn,
            *(x[between] for x in (codes.mean, sigma_dn, *own, *other, covariance_e2)),
        )
        mean[between], variance[between] = part.moments()
    return Estimate(mean, variance)


@dataclass(frozen=True)
class _Part:
    """Pixels whose code may or may not hand over, (P,) each.

    begin_dn, end_dn : codes between which the other read-out takes over.  mean_dn, sigma_dn : of the code.
    own_e, own_e2 : mean and variance of the code as electrons.  other_e, other_e2 : those of the other estimate.
    covariance_e2 : of both estimates.
    """

    electrons_per_dn: float
    begin_dn: float
    end_dn: float
    mean_dn: Float64Array
    sigma_dn: Float64Array
    own_e: Float64Array
    own_e2: Float64Array
    other_e: Float64Array
    other_e2: Float64Array
    covariance_e2: Float64Array

    def moments(self) -> Estimate:
        """Mean and variance of the combination, over the codes."""
        low = self.mean_dn - WIDTH * self.sigma_dn
        high = self.mean_dn + WIDTH * self.sigma_dn
        edges = [low, *(np.clip(x, low, high) for x in (self.begin_dn, self.end_dn)), high]
        chance, first, second = (np.zeros(self.mean_dn.size) for _ in range(3))
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        for start, stop in zip(edges[:-1], edges[1:], strict=True):
            half, middle = (stop - start) / 2, (start + stop) / 2
            for node, weight in zip(nodes, weights, strict=True):
                code_dn = middle + half * node
                density = weight * half * self._density(code_dn)
                mean, variance = self._given(code_dn, middle)
                chance += density
                first += density * mean
                second += density * (variance + (mean - self.other_e) ** 2)
        mean = first / chance
        return Estimate(mean, second / chance - (mean - self.other_e) ** 2)

    def _density(self, code_dn: Float64Array) -> Float64Array:
        z = (code_dn - self.mean_dn) / self.sigma_dn
        return np.asarray(np.exp(-0.5 * z**2) / (np.sqrt(2 * np.pi) * self.sigma_dn))

    def _given(self, code_dn: Float64Array, middle_dn: Float64Array) -> Estimate:
        """Mean and variance of the combination where the code is known.  middle_dn : of the part of the integral."""
        off_e = self.electrons_per_dn * (code_dn - self.mean_dn)
        own_e = self.own_e + off_e
        slope = np.divide(
            self.covariance_e2, self.own_e2, out=np.zeros(off_e.size), where=self.own_e2 > 0
        )
        other_e = self.other_e + slope * off_e
        left_e2 = np.maximum(self.other_e2 - slope * self.covariance_e2, 0.0)
        if self.begin_dn == self.end_dn:
            weight = np.where(middle_dn >= self.end_dn, 1.0, 0.0)
        else:
            weight = np.clip(
                (code_dn - self.begin_dn) / (self.end_dn - self.begin_dn), 0.0, 1.0
            )
        return Estimate(own_e + weight * (other_e - own_e), weight**2 * left_e2)
