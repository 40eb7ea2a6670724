"""Measure the bias of Mitsuba's multijitter sampler, whose dimensions are correlated if a pass has few samples.

    python benchmarks/sampler_bias.py [--sizes 2 3 4 6 8 9 12 15 16 20 25 64] [--million 8]

Prints for each number of samples in a pass: the mean of Π(½ + u) over 8, 16 and 48 random numbers of a sample, which
should be 1; the light that crosses a slab of fog, relative to the sampler "independent"; and the variance of that light
at equal samples, also relative. Each bias is in % with its standard error.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

import numpy as np

DEPTHS = (8, 16, 48)  # random numbers of a product
THICKNESS, ALBEDO, SCATTERINGS = 2.0, 0.98, 14  # of the slab [mean free paths], of the fog
SURE_SCATTERINGS = 4  # before Russian roulette
WAVEFRONT = 2**20  # samples at once


def products(mi: Any, sampler: Any) -> list[Any]:
    """Return Π(½ + u) of each sample, for each number of factors."""
    product, found = mi.Float(1.0), []
    for depth in range(1, DEPTHS[-1] + 1):
        product = product * (0.5 + sampler.next_1d())
        sampler.schedule_state()
        if depth in DEPTHS:
            found.append(product)
    return found


def fog(mi: Any, sampler: Any) -> list[Any]:
    """Return the light of random walks that cross the slab, with ten random numbers for each scattering (volpath)."""
    import drjit as dr

    depth, cosine, weight, light = (mi.Float(x) for x in (0.0, 1.0, 1.0, 0.0))
    active = mi.Bool(True)
    for scattering in range(SCATTERINGS):
        sampler.next_1d()  # wavelength of the free path
        depth = depth - cosine * dr.log(1 - sampler.next_1d())
        light = dr.select(active & (depth > THICKNESS), light + weight, light)
        active &= (depth >= 0) & (depth <= THICKNESS)
        (
            sampler.next_1d(),
            sampler.next_2d(),
            sampler.next_1d(),
        )  # lamp, and lobe of the phase function
        turn = sampler.next_2d()
        across, sine = 2 * turn.x - 1, dr.safe_sqrt(1 - cosine * cosine)
        cosine = cosine * across + sine * dr.safe_sqrt(1 - across * across) * dr.cos(
            dr.two_pi * turn.y
        )
        roulette, weight = sampler.next_1d(), weight * ALBEDO
        if scattering >= SURE_SCATTERINGS:
            survival = dr.minimum(weight, 0.95)
            active &= roulette < survival
            weight = weight / survival
        sampler.schedule_state()
        dr.schedule(depth, cosine, weight, light, active)
    return [light]


def measured(
    mi: Any, kind: str, samples: int, run: Callable[[Any, Any], list[Any]], million: float
) -> list[tuple[float, float, float]]:
    """Return mean, its standard error, and the variance of one sample, from the spread of the pixels."""
    import drjit as dr

    means: list[list[Any]] = []
    for seed in range(max(round(million * 1e6 / WAVEFRONT), 1)):
        sampler = mi.load_dict({"type": kind, "sample_count": samples})
        sampler.set_samples_per_wavefront(samples)
        sampler.seed(seed, WAVEFRONT // samples * samples)
        means.append(
            [np.array(dr.block_reduce(dr.ReduceOp.Add, mi.Float(x), samples), float) / samples
             for x in run(mi, sampler)]
        )  # fmt: skip
    pixels = [np.concatenate(x) for x in zip(*means, strict=True)]
    return [(x.mean(), x.std() / math.sqrt(x.size), x.var() * samples) for x in pixels]


def main() -> None:
    """Parse the options, measure, print."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_spectral")
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    sizes = [2, 3, 4, 6, 8, 9, 12, 15, 16, 20, 25, 64]
    parser.add_argument("--sizes", type=int, nargs="+", default=sizes)
    parser.add_argument("--million", type=float, default=8.0, help="samples of each size")
    options = parser.parse_args()
    [(truth, truth_error, truth_variance)] = measured(
        mi, "independent", 4, fog, 3 * options.million
    )
    for size in options.sizes:
        row = [
            f"{100 * (mean - 1):+.2f} ± {100 * error:.2f}"
            for mean, error, _ in measured(mi, "multijitter", size, products, options.million)
        ]
        [(mean, error, variance)] = measured(mi, "multijitter", size, fog, options.million)
        both = math.hypot(error, truth_error) / truth
        row.append(f"fog {100 * (mean / truth - 1):+.2f} ± {100 * both:.2f}")
        print(
            f"{size:4}  ",
            "   ".join(row),
            f"  variance {variance / truth_variance:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
