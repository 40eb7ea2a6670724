"""Whether a window is on the sensor: an error for films, light and FPN maps that are not, a note for arrays.

An array of photons may be any list of pixels.
"""

from ..core import Doubt, InputError
from .camera import Camera


def check_on_sensor(
    what: str, shape: tuple[int, ...], origin: tuple[int, int], camera: Camera
) -> None:
    """Raise InputError where a window of (rows, columns) from this first pixel on ends beyond the sensor."""
    if said := _beyond(shape, origin, camera):
        raise InputError(f"{what} has {said}.")


def size_note(
    shape: tuple[int, ...], origin: tuple[int, int], camera: Camera
) -> tuple[str, ...]:
    """The same for frames of such a window, as a note."""
    said = _beyond(shape, origin, camera)
    if said:
        return (Doubt(f"the frame has {said}; the fixed pattern goes on beyond the sensor"),)
    return ()


def _beyond(shape: tuple[int, ...], origin: tuple[int, int], camera: Camera) -> str:
    """The sizes and the way out; nothing for a window on the sensor."""
    needed = {"rows": origin[0] + shape[0], "columns": origin[1] + shape[1]}
    there = {name: getattr(camera.sensor, name) for name in needed}
    fields = [f"sensor.{name}={count}" for name, count in needed.items() if count > there[name]]
    if not fields:
        return ""
    if not any(origin):
        first = ""
    else:
        first = f" from row {origin[0]}, column {origin[1]} on"
    of_sensor = f"{camera.name} has {there['columns']} × {there['rows']}"
    way_out = f"take fewer (--width), or a larger sensor: {', '.join(fields)} (--set, or Camera.replace)"
    return f"{shape[1]} × {shape[0]} pixels{first}, and {of_sensor}; {way_out}"
