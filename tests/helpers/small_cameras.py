"""Cameras of a few lines of NumPy: Poisson photoelectrons, a full well, normal read noise, rounding and clipping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mitsuba_sensor.lab.frames.stack import Stack


def as_it_is(electrons: np.ndarray) -> np.ndarray:
    return electrons


@dataclass(frozen=True)
class SmallCamera:
    """gain [DN/e-], efficiency, read_noise_e, full_well_e, black_dn, bits; curve: electrons to those of the code;
    prnu and dsnu_dn are standard deviations."""

    gain: float = 0.3
    efficiency: float = 0.6
    read_noise_e: float = 6.0
    full_well_e: float = 10_000.0
    black_dn: float = 64.0
    bits: int = 12
    prnu: float = 0.0
    dsnu_dn: float = 0.0
    curve: Callable[[np.ndarray], np.ndarray] = as_it_is

    def frames(
        self,
        rng: np.random.Generator,
        photons: Any,
        count: int,
        shape: tuple[int, int],
        drift: float = 0,
    ) -> Any:
        """(count, H, W) codes; drift is the standard deviation of the light from frame to frame."""
        pattern = np.random.default_rng(1).standard_normal((2, *shape))
        light = (
            photons
            * (1 + self.prnu * pattern[0])
            * (1 + drift * rng.standard_normal((count, 1, 1)))
        )
        electrons = np.minimum(
            rng.poisson(self.efficiency * light * np.ones((count, *shape))), self.full_well_e
        )
        noise = self.read_noise_e * rng.standard_normal((count, *shape))
        codes = (
            self.black_dn
            + self.dsnu_dn * pattern[1]
            + self.gain * (self.curve(electrons) + noise)
        )
        return np.clip(np.floor(codes + 0.5), 0, 2**self.bits - 1).astype(np.uint16)

    def stack(
        self,
        rng: np.random.Generator,
        photons: Any,
        count: int,
        shape: tuple[int, int],
        drift: float = 0,
    ) -> Stack:
        return Stack(
            self.frames(rng, photons, count, shape, drift),
            0.01,
            photons=photons,
            bits=self.bits,
        )

    def bench(
        self,
        rng: np.random.Generator,
        count: int = 2,
        shape: tuple[int, int] = (32, 32),
        levels: int = 30,
        drift: float = 0,
    ) -> tuple[list[Stack], list[Stack]]:
        """Dark frames and flat fields from darkness to 1.1 full wells."""
        light = np.linspace(0, 1.1 * self.full_well_e / self.efficiency, levels + 1)
        dark, *flats = (
            self.stack(rng, float(one), count, shape, drift if one else 0) for one in light
        )
        return [dark], flats
