"""Physical constants (exact SI 2019 values, as in CODATA 2018) and the photon energy."""

from .types import Array

PLANCK_J_S = 6.62607015e-34
LIGHT_SPEED_M_PER_S = 299_792_458.0
BOLTZMANN_J_PER_K = 1.380649e-23
ELEMENTARY_CHARGE_C = 1.602176634e-19
KELVIN_AT_0_C = 273.15
BOLTZMANN_EV_PER_K = BOLTZMANN_J_PER_K / ELEMENTARY_CHARGE_C


def photon_energy_j(wavelength_nm: Array) -> Array:
    """Return the energy of a photon, hc/λ [J]; 3.6117e-19 J at 550 nm."""
    return PLANCK_J_S * LIGHT_SPEED_M_PER_S / (wavelength_nm * 1e-9)
