"""The camera of one photodiode of dual pixels: half of the well and of the dark current, behind the same amplifier.

Both photodiodes share floating diffusion, amplifier and converter, as in Samsung's EP 4187914 A1: the picture is the
charge of both, and either of them can be read alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from ..stages.effects.shot_noise import LEFT, RIGHT
from ..stages.stage import Chain, Datasheet

if TYPE_CHECKING:
    from .camera import Camera

PHOTODIODES = (LEFT, RIGHT)
OF_AREA = ("fom_na_per_cm2", "diffusion_fom_na_per_cm2", "rate_e_per_s")
"""Fields of the dark current of which a photodiode has half."""


def wrong_dual_pixels(camera: Datasheet) -> Iterator[str]:
    """Sentences for dual pixels with what nobody has said how two photodiodes share it."""
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
                f"sensor.dual_pixel is true and {why}, and it is not known how the two photodiodes of a pixel share "
                "that; leave one of them out"
            )


def camera_of_photodiode(camera: Camera) -> Camera:
    """The camera with one photodiode of its dual pixels, which has half of the well and of the dark current."""
    dark = camera.dark_current
    fields: dict[str, object] = {"sensor.dual_pixel": False}
    fields["pixel.full_well_e"] = camera.pixel.full_well_e / 2
    halved = _half(
        dark.model_dump(), (*OF_AREA, "rts_amplitude_e_per_s", "overflow_rate_e_per_s")
    )
    fields |= {f"dark_current.{name}": value for name, value in halved.items()}
    if dark.components:
        parts = [part.model_dump() for part in dark.components]
        fields["dark_current.components"] = [
            part | _half(part, ("low", "high", "mean", "sigma")) for part in parts
        ]
    return camera.replace(**fields)


def _half(table: Mapping[str, float], names: Iterable[str]) -> dict[str, float]:
    """Half of those of these numbers that are given."""
    return {name: table[name] / 2 for name in names if table.get(name)}


def stages_of_photodiode(photodiode: Camera, stages: Chain) -> Chain:
    """The chain of a picture with the charge of one photodiode: gains, offsets and converter are those of both."""
    own = {stage.key(): stage for stage in photodiode.stages if stage.domain == "electrons"}
    found = list(stages)
    for number, stage in enumerate(stages):
        if stage.domain == "electrons":
            found[number] = own.get(stage.key(), stage)
    return tuple(found)


def has_several_readouts(camera: Datasheet) -> bool:
    """Whether every pixel is read more than once: by its read-outs, or as each of its two photodiodes."""
    return bool(camera.readouts) or camera.sensor.dual_pixel
