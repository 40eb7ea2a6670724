"""Exposure time [s] and sensor temperature [K] of a frame."""

from dataclasses import dataclass

from .errors import require

LONGEST_S, HOTTEST_K = (
    1e12,
    1e4,
)  # beyond any camera: 30 000 years, and six times the melting point of silicon


@dataclass(frozen=True)
class Exposure:
    """Exposure time and sensor temperature.

    ::

        night = ms.Exposure(0.02, temperature_k=273.15)
        frames = ms.expose(photons, camera, night)

    time_s : 0 … 1e12 [s].  temperature_k : 0 … 1e4 [K]; 298.15 K (+25 °C) as in Konnik & Welsh 2014.
    Raises InputError otherwise.
    """

    time_s: float
    temperature_k: float = 298.15

    def __post_init__(self) -> None:
        require("exposure time_s", self.time_s, 0.0, LONGEST_S, "seconds, e.g. 0.1")
        require(
            "temperature_k", self.temperature_k, 0.0, HOTTEST_K, "kelvin, e.g. 298.15 for 25 °C"
        )
