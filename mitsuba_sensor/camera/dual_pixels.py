"""The camera of one photodiode of dual pixels: half the well and half the dark current before the same amplifier.

Both photodiodes share floating diffusion, amplifier and ADC, as in Samsung's EP 4187914 A1. The image is the charge of
both; each can also be read alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from ..stages.effects.shot_noise import LEFT, RIGHT
from ..stages.stage import Chain, Datasheet

if TYPE_CHECKING:
    from .camera import Camera

PHOTODIODES = (LEFT, RIGHT)
AREA_FIELDS = (
    *("fom_na_per_cm2", "diffusion_fom_na_per_cm2", "rate_e_per_s"),
    *("rts_amplitude_e_per_s", "overflow_rate_e_per_s"),
)
"""Dark current fields that are half as large for a photodiode."""


def wrong_dual_pixels(camera: Datasheet) -> Iterator[str]:
    """Yield errors for dual pixels with effects that two photodiodes share in an unknown way."""
    refused = {
        "sensor.technology is 'ccd'": camera.sensor.technology == "ccd",
        "readouts are given": camera.readouts,
        "pixel.partial_resets are given": camera.pixel.partial_resets,
        "pixel.hits_per_cm2_s is not 0": camera.pixel.hits_per_cm2_s,
        "a quantum_yield is given": camera.quantum_efficiency.quantum_yield,
        "quantum_efficiency.image_lag is not 0": camera.quantum_efficiency.image_lag,
        "lens.half_pupil is given": camera.lens.half_pupil,
        "pixel.full_well_e is below 2": camera.pixel.full_well_e < 2,
    }
    for why, is_refused in refused.items():
        if camera.sensor.dual_pixel and is_refused:
            yield (
                f"sensor.dual_pixel is true and {why}, but how two photodiodes share this is unknown; omit either"
            )


def camera_of_photodiode(camera: Camera) -> Camera:
    """Return the camera of one photodiode of dual pixels, with half the well and half the dark current."""
    dark, well_e = camera.dark_current.model_dump(), camera.pixel.full_well_e / 2
    fields: dict[str, object] = {"sensor.dual_pixel": False, "pixel.full_well_e": well_e}
    fields |= {
        f"dark_current.{name}": value for name, value in _half(dark, AREA_FIELDS).items()
    }
    if dark["components"]:
        fields["dark_current.components"] = [
            component | _half(component, ("low", "high", "mean", "sigma"))
            for component in dark["components"]
        ]
    return camera.replace(**fields)


def _half(table: Mapping[str, float], names: Iterable[str]) -> dict[str, float]:
    """Return half of each given number with one of these names."""
    return {name: table[name] / 2 for name in names if table.get(name)}


def stages_of_photodiode(photodiode: Camera, stages: Chain) -> Chain:
    """Return the chain for the charge of one photodiode; gains, offsets and ADC are shared by both."""
    charge = {stage.key(): stage for stage in photodiode.stages if stage.domain == "electrons"}
    return tuple(charge.get(stage.key(), stage) for stage in stages)


def has_several_readouts(camera: Datasheet) -> bool:
    """Return True if every pixel is read more than once: by several readouts, or as two photodiodes."""
    return bool(camera.readouts) or camera.sensor.dual_pixel
