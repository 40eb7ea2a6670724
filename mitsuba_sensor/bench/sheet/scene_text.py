"""Charts as scenes of Mitsuba: shining rectangles before a telecentric lens; 1 is the pitch of the pixels."""

from __future__ import annotations

from collections.abc import Iterable

EVEN = '<spectrum name="radiance" type="uniform"><float name="value" value="{value:.9g}"/></spectrum>'
DAYLIGHT = (
    '<spectrum name="radiance" type="d65"><float name="scale" value="{value:.9g}"/></spectrum>'
)
"""Radiance of a lamp of a flat spectrum and of CIE D65."""
BITMAP_FILE = "{bitmap}"
"""Stands for the file of a bitmap in the text of a scene."""
REPEATS = 3
"""Of a bitmap along each side: the light that comes from beyond the picture is that of the bitmap, too."""


def telecentric_scene(shape: tuple[int, int], elements: Iterable[str]) -> str:
    """The XML of a scene.  shape : rows and columns of the picture; its middle is at (0, 0)."""
    half = shape[1] / 2
    sensor = (
        f'<sensor type="orthographic"><transform name="to_world"><scale x="{half:g}" y="{half:g}"/>'
        '<lookat origin="0, 0, 1" target="0, 0, 0" up="0, 1, 0"/></transform>'
    )
    return _scene(sensor, shape, elements)


def surrounded_scene(shape: tuple[int, int], field_deg: float) -> str:
    """The XML of even light from everywhere.  field_deg : field of view across."""
    sensor = f'<sensor type="perspective"><float name="fov" value="{field_deg:g}"/>'
    return _scene(
        sensor, shape, [f'<emitter type="constant">{EVEN.format(value=1.0)}</emitter>']
    )


def _scene(sensor: str, shape: tuple[int, int], elements: Iterable[str]) -> str:
    """The XML of a scene.  sensor : the beginning of its element, without film and sampler."""
    rows, columns = shape
    return f"""<scene version="3.0.0">
<integrator type="path"><integer name="max_depth" value="1"/></integrator>
{sensor}
<film type="specfilm"><integer name="width" value="{columns}"/><integer name="height" value="{rows}"/>
<string name="component_format" value="float32"/><rfilter type="box"/></film>
<sampler type="multijitter"/>
</sensor>
{"".join(elements)}</scene>"""


def emitter_rectangle(
    middle: tuple[float, float],
    half: tuple[float, float],
    turned_deg: float,
    radiance: float,
    spectrum: str = EVEN,
) -> str:
    """A rectangle that shines towards the camera.

    middle, half : its middle and half its sides, before it is turned about (0, 0) by so many degrees, anticlockwise.
    """
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale x="{half[0]:g}" y="{half[1]:g}"/>'
        f'<translate x="{middle[0]:g}" y="{middle[1]:g}"/><rotate z="1" angle="{turned_deg:g}"/></transform>'
        f'<emitter type="area">{spectrum.format(value=radiance)}</emitter></shape>\n'
    )


def bitmap_lamp(shape: tuple[int, int]) -> str:
    """A lamp that shines as a bitmap says, which fills the picture and repeats beyond.  shape : rows and columns."""
    rows, columns = shape
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale x="{REPEATS * columns / 2:g}" '
        f'y="{REPEATS * rows / 2:g}"/></transform><emitter type="area"><texture type="bitmap" name="radiance">'
        f'<string name="filename" value="{BITMAP_FILE}"/><boolean name="raw" value="true"/>'
        f'<transform name="to_uv"><scale value="{REPEATS}"/></transform></texture></emitter></shape>'
    )
