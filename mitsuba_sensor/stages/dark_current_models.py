"""Dark current versus temperature, in Python float64 (float32 underflows at 72 K)."""

import math
from dataclasses import dataclass

from ..core.units import BOLTZMANN_EV_PER_K, ELEMENTARY_CHARGE_C

FIGURE_OF_MERIT_AT_K = 300.0
"""Temperature of figures of merit of dark current [K] (Janesick 2001)."""
EXPONENT_MAX = math.log(1e30)
"""Limits a dark current to 1e30 times its value at the reference temperature, so that squares stay finite."""


def band_gap_ev(temperature_k: float) -> float:
    """Band gap of silicon E_g(T) = 1.1557 − 7.021e-4·T²/(1108 + T) [eV] (paper eq. 3); 1.11082145 eV at 300 K."""
    return 1.1557 - 7.021e-4 * temperature_k**2 / (1108.0 + temperature_k)


def activation(temperature_k: float, power: float, divisor: float) -> float:
    """(T/300)^power·exp(E_g(300)/(d·k·300) − E_g(T)/(d·k·T)): 1 at 300 K and 0 at 0 K."""
    if temperature_k == 0:
        return 0.0
    reference = band_gap_ev(FIGURE_OF_MERIT_AT_K) / FIGURE_OF_MERIT_AT_K
    exponent = (reference - band_gap_ev(temperature_k) / temperature_k) / (
        divisor * BOLTZMANN_EV_PER_K
    )
    return float((temperature_k / FIGURE_OF_MERIT_AT_K) ** power * math.exp(exponent))


def arrhenius(temperature_k: float, at_temperature_k: float, activation_ev: float) -> float:
    """exp(E_a/k·(1/T_ref − 1/T)), at most 1e30: 1 at T_ref, and 0 at 0 K unless E_a is 0."""
    if activation_ev == 0 or temperature_k == at_temperature_k:
        return 1.0
    if temperature_k == 0:
        return 0.0
    exponent = activation_ev / BOLTZMANN_EV_PER_K * (1 / at_temperature_k - 1 / temperature_k)
    return math.exp(min(exponent, EXPONENT_MAX))


def rate_at_300_e_per_s(fom_na_per_cm2: float, area_cm2: float) -> float:
    """Return the dark current of a pixel of this area at 300 K [e-/s], from its figure of merit."""
    return area_cm2 * fom_na_per_cm2 * 1e-9 / ELEMENTARY_CHARGE_C


@dataclass(frozen=True)
class FigureOfMerit:
    """Depletion dark current from its figure of merit at 300 K (paper eq. 1, normalised).

    D_R(T) = (P_A·D_FM/q)·(T/300)^1.5·exp(E_g(300)/(2k·300) − E_g(T)/(2kT))  [e-/s]
    """

    fom_na_per_cm2: float  # D_FM
    area_cm2: float  # P_A, the whole pixel; in the dark the fill factor has no effect

    def rate_e_per_s(self, temperature_k: float) -> float:
        """Dark electrons per second; 0 at 0 K."""
        return rate_at_300_e_per_s(self.fom_na_per_cm2, self.area_cm2) * activation(
            temperature_k, 1.5, 2
        )


@dataclass(frozen=True)
class Mpp:
    """Dark current of a multi-pinned-phase pixel: diffusion and depletion separately (paper eq. 2, normalised).

    D_R(T) = D_diff·(T/300)³·exp(E_g(300)/(k·300) − E_g/(kT)) + D_dep·(T/300)^1.5·exp(… /2k)  [e-/s]
    """

    diffusion_fom_na_per_cm2: float  # at 300 K, like the next
    fom_na_per_cm2: float
    area_cm2: float

    def rate_e_per_s(self, temperature_k: float) -> float:
        """Dark electrons per second; 0 at 0 K."""
        diffusion = rate_at_300_e_per_s(
            self.diffusion_fom_na_per_cm2, self.area_cm2
        ) * activation(temperature_k, 3, 1)
        depletion = rate_at_300_e_per_s(self.fom_na_per_cm2, self.area_cm2) * activation(
            temperature_k, 1.5, 2
        )
        return diffusion + depletion


@dataclass(frozen=True)
class Measured:
    """A rate [e-/s] measured at one temperature [K], converted to other temperatures by eq. 1."""

    rate: float
    at_temperature_k: float

    def rate_e_per_s(self, temperature_k: float) -> float:
        """Dark electrons per second; 0 at 0 K."""
        return (
            self.rate
            * activation(temperature_k, 1.5, 2)
            / activation(self.at_temperature_k, 1.5, 2)
        )


@dataclass(frozen=True)
class Doubling:
    """Dark current as datasheets give it: rate·2^((T − T_ref)/T_d) [e-/s], T_d kelvin double it (EMVA 1288)."""

    rate: float
    at_temperature_k: float
    doubling_k: float

    def rate_e_per_s(self, temperature_k: float) -> float:
        """Dark electrons per second."""
        return self.rate * math.exp2(
            min((temperature_k - self.at_temperature_k) / self.doubling_k, 400.0)
        )


DarkCurrentModel = FigureOfMerit | Mpp | Measured | Doubling
