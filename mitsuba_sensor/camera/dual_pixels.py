"""The camera of one photodiode of dual pixels: half of the well and of the dark current, behind the same amplifier.

Both photodiodes share floating diffusion, amplifier and converter, as in Samsung's EP 4187914 A1: the picture is the
charge of both, and either of them can be read alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..stages.effects.shot_noise import LEFT, RIGHT
from ..stages.stage import Chain, Datasheet

if TYPE_CHECKING:
    from .camera import Camera

PHOTODIODES = (LEFT, RIGHT)
OF_AREA = ("fom_na_per_cm2", "diffusion_fom_na_per_cm2", "rate_e_per_s")
"""Fields of the dark current of which a photodiode has half."""


def check_dual_pixels(camera: Datasheet) -> None:
    """Raise ValueError for dual pixels with what nobody has said how two photodiodes share it."""
    if not camera.sensor.dual_pixel:
        return
    refused = (
        (camera.sensor.technology == "ccd", "sensor.technology is 'ccd'"),
        (bool(camera.readouts), "readouts are given"),
        (bool(camera.pixel.partial_resets), "pixel.partial_resets are given"),
        (camera.pixel.hits_per_cm2_s != 0, "pixel.hits_per_cm2_s is not 0"),
        (bool(camera.quantum_efficiency.quantum_yield), "a quantum_yield is given"),
        (camera.quantum_efficiency.image_lag != 0, "quantum_efficiency.image_lag is not 0"),
        (camera.lens.half_pupil is not None, "lens.half_pupil is given"),
        (camera.pixel.full_well_e < 2, "pixel.full_well_e is below 2"),
    )
    for is_refused, why in refused:
        if is_refused:
            raise ValueError(
                f"sensor.dual_pixel is true and {why}, and it is not known how the two photodiodes of a pixel share "
                "that; leave one of them out"
            )


def camera_of_photodiode(camera: Camera) -> Camera:
    """The camera with one photodiode of its dual pixels, which has half of the well and of the dark current."""
    dark = camera.dark_current
    fields: dict[str, object] = {"sensor.dual_pixel": False}
    fields["pixel.full_well_e"] = camera.pixel.full_well_e / 2
    for name in (*OF_AREA, "rts_amplitude_e_per_s", "overflow_rate_e_per_s"):
        if getattr(dark, name):
            fields[f"dark_current.{name}"] = getattr(dark, name) / 2
    if dark.components:
        fields["dark_current.components"] = [
            _half(part.model_dump()) for part in dark.components
        ]
    return camera.replace(**fields)


def _half(component: dict[str, float]) -> dict[str, float]:
    """A component of the dark current with half of its electrons."""
    halved = dict(component)
    for name in ("low", "high", "mean", "sigma"):
        if component.get(name) is not None:
            halved[name] = component[name] / 2
    return halved


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
