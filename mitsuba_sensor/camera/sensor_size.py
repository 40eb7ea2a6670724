"""Check that a window lies on the sensor: an error for films, light and FPN maps, a note for arrays.

An array of photons may be any list of pixels.
"""

from ..core import Doubt, InputError
from .camera import Camera


def check_on_sensor(
    what: str, shape: tuple[int, ...], origin: tuple[int, int], camera: Camera
) -> None:
    """Raise InputError if a window of (rows, columns) at this first pixel exceeds the sensor.  what : its name."""
    if text := _exceeds(shape, origin, camera):
        raise InputError(f"{what} has {text}.")


def size_note(
    shape: tuple[int, ...], origin: tuple[int, int], camera: Camera
) -> tuple[str, ...]:
    """Return a note if frames of this window exceed the sensor."""
    text = _exceeds(shape, origin, camera)
    return (
        (Doubt(f"the frame has {text}; the fixed pattern continues outside"),) if text else ()
    )


def _exceeds(shape: tuple[int, ...], origin: tuple[int, int], camera: Camera) -> str:
    """Return the sizes and how to fix them; empty if the window lies on the sensor."""
    needed = {"rows": origin[0] + shape[0], "columns": origin[1] + shape[1]}
    sensor = camera.sensor
    fields = {f"sensor.{x}": n for x, n in needed.items() if n > getattr(sensor, x)}
    if not fields:
        return ""
    start = f" from row {origin[0]}, column {origin[1]}" if any(origin) else ""
    return (
        f"{shape[1]} × {shape[0]} pixels{start}, but {camera.name} has {sensor.columns} × {sensor.rows}; use a smaller "
        f"window (width=), or a larger sensor: camera.replace(**{fields})"
    )
