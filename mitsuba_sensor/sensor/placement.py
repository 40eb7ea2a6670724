"""Where light lies on the sensor, and what of it holds for its pixels alone."""

from __future__ import annotations

from ..camera.camera import Camera
from ..core import InputError, Photons
from .checks import checked_origin


def placed(light: Photons, first_pixel: object, camera: Camera) -> Photons:
    """The light where it was asked for on the sensor, or where it is; what is known of each pixel's own filter holds
    behind that one only. Raises InputError."""
    if first_pixel is None:
        return _at(light, checked_origin(light.origin), moved=False)
    row, column = checked_origin(first_pixel)
    if light.polarizers is not None:
        _refuse_other_polarizers((row, column), light.origin, camera)
    moved = (row - light.origin[0]) % len(camera.tile) or (column - light.origin[1]) % len(
        camera.tile[0]
    )
    return _at(light, (row, column), bool(moved))


def _at(light: Photons, origin: tuple[int, int], moved: bool) -> Photons:
    """The light of all exposures from this pixel on.  moved : whether each pixel has another filter there."""
    in_band = None if moved else light.in_band
    placed_light = light.changed(origin=origin, in_band=in_band)
    return placed_light.with_readouts(lambda one: _at(one, origin, moved))


def _refuse_other_polarizers(
    first_pixel: tuple[int, int], origin: tuple[int, int], camera: Camera
) -> None:
    """Raise InputError where each pixel's light would come to a pixel with another polariser."""
    periods = camera.sensor.polarizer_periods
    if any((new - old) % n for new, old, n in zip(first_pixel, origin, periods, strict=True)):
        raise InputError(
            f"origin is {first_pixel}, and the light was rendered behind the polarisers of the pixels from {origin} "
            f"on; move it by a multiple of {periods[0]} rows and {periods[1]} columns, or render it there."
        )
