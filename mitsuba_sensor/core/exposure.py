"""Exposure time [s] and sensor temperature [K] of a frame."""

from dataclasses import dataclass

from .errors import require
from .near_names import checks_names

TIME_MAX_S, TEMPERATURE_MAX_K = 1e12, 1e4  # beyond any camera


@checks_names
@dataclass(frozen=True)
class Exposure:
    """Exposure time and sensor temperature.

    ::

        night = ms.Exposure(0.02, temperature_k=273.15)
        frames = ms.expose(photons, camera, night)

    time_s : 0 to 1e12 [s].  temperature_k : 0 to 1e4 [K]; default 298.15 K (+25 °C), as in Konnik & Welsh 2014.
    Raises InputError for other values.
    """

    time_s: float
    temperature_k: float = 298.15

    def __post_init__(self) -> None:
        require("time_s", self.time_s, 0.0, TIME_MAX_S, "seconds, e.g. 0.1")
        require(
            "temperature_k",
            self.temperature_k,
            0.0,
            TEMPERATURE_MAX_K,
            "kelvin, e.g. 298.15 for 25 °C",
        )
