"""Write color_checker.xml and step_wedge.xml: charts under closed-form light, too long to type.

    python scenes/make_charts.py

Both are coplanar matt squares that see nothing but an even D65 sky, through a telecentric lens: the radiance of a
square is its reflectance times that of the sky, exactly, so that a render can be compared with an integral.
"""

from __future__ import annotations

from pathlib import Path

import colour
import numpy as np

from mitsuba_sensor.optics import spectra

HERE = Path(__file__).parent
STEPS = 64
FRAME_REFLECTANCE = 0.03  # black card between the patches

HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!-- {title}

     Written by make_charts.py. Matt squares in one plane under an even sky, seen by a telecentric (orthographic) lens:
     radiance = reflectance x illuminance / pi in closed form, no shading, no interreflection.
{about} -->
<scene version="3.0.0">
    <!-- Columns and rows of the film: a window of the camera's pixels. -->
    <default name="width" value="{width}"/>
    <default name="height" value="{height}"/>
    <!-- Exposure time [s]; plain Mitsuba ignores it. -->
    <default name="exposure_s" value="0.1"/>
    <!-- Illuminance of the chart [lux]. {level} -->
    <default name="lux" value="{lux:g}"/>

    <!-- One bounce, and only towards where the surface scatters: against an even sky that has no noise of its own. -->
    <integrator type="direct">
        <integer name="emitter_samples" value="0"/>
        <integer name="bsdf_samples" value="1"/>
    </integrator>

    <sensor type="orthographic">
        <transform name="to_world">
            <scale x="{half_width:g}" y="{half_width:g}"/>
            <lookat origin="0, 0, 1" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="specfilm">
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
            <string name="component_format" value="float32"/>
            <rfilter type="box"/>
            <!-- For plain Mitsuba; mitsuba_sensor puts its own bands in the place of this one. -->
            <spectrum name="band" value="360:1, 830:1"/>
        </film>
        <sampler type="multijitter"/>
    </sensor>

    <!-- The sky is CIE D65. Mitsuba's table, at scale 1, has {unit:.6g} cd/m2; the factor inside makes "scale" the
         illuminance in lux of a surface that faces it: 1 / (pi x {unit:.6g}). -->
    <emitter type="constant">
        <spectrum name="radiance" type="d65">
            <float name="scale" value="$lux"/>
            <spectrum name="factor" type="uniform">
                <float name="value" value="{factor:.7g}"/>
            </spectrum>
        </spectrum>
    </emitter>
"""


def mitsuba_d65_luminance() -> float:
    """cd/m² of Mitsuba's d65 at scale 1: D65 divided by 98.99741751876255."""
    fine = np.arange(360.0, 831.0)
    return spectra.luminous(fine, spectra.d65(fine) / 98.99741751876255)


def head(**values: object) -> str:
    unit = mitsuba_d65_luminance()
    return HEAD.format(unit=unit, factor=1 / (np.pi * unit), **values)


def square(
    x: float, y: float, half_x: float, half_y: float, reflectance: str, z: float = 0.0
) -> str:
    """One matt rectangle; ``reflectance`` is the spectrum element."""
    return (
        f'    <shape type="rectangle">\n'
        f'        <bsdf type="diffuse">{reflectance}</bsdf>\n'
        f'        <transform name="to_world"><scale x="{half_x:.6g}" y="{half_y:.6g}"/>'
        f'<translate x="{x:.6g}" y="{y:.6g}" z="{z:g}"/></transform>\n'
        f"    </shape>\n"
    )


def even(value: float) -> str:
    if value == 0:  # a table of zeros has nothing to sample, says Mitsuba
        return '<spectrum name="reflectance" value="0"/>'
    return f'<spectrum name="reflectance" value="360:{value:.6g}, 830:{value:.6g}"/>'


def table(wavelengths_nm: np.ndarray, values: np.ndarray) -> str:
    """A tabulated reflectance, held constant down to 360 and up to 830 nm."""
    first, last = (360.0, values[0]), (830.0, values[-1])
    pairs = [first, *zip(wavelengths_nm, values, strict=True), last]
    return (
        '<spectrum name="reflectance" value="'
        + ", ".join(f"{w:g}:{v:.6g}" for w, v in pairs)
        + '"/>'
    )


def color_checker() -> str:
    about = """     Patches 6 x 4, 40 mm wide, 50 mm apart; reflectances ISO 17321-1 (380 to 780 nm every 5 nm, through
     colour-science), held constant outside."""
    text = head(
        title="ColorChecker, 24 patches of known reflectance under D65.",
        about=about,
        width=384,
        height=256,
        level="White stands at about 80 % of full well (konnik_table1, f/2.8, 0.1 s).",
        lux=85,
        half_width=0.15,
    )
    text += square(0, 0, 0.2, 0.2, even(FRAME_REFLECTANCE), z=-0.001)
    for k, (name, patch) in enumerate(colour.SDS_COLOURCHECKERS["ISO 17321-1"].items()):
        x, y = 0.05 * (k % 6) - 0.125, 0.075 - 0.05 * (k // 6)
        text += f"    <!-- {name} -->\n" + square(
            x, y, 0.02, 0.02, table(patch.wavelengths, patch.values)
        )
    return text + "</scene>\n"


def step_wedge() -> str:
    about = f"""     {STEPS} steps of equal width and equal rise, from exactly dark on the left to reflectance 1 on the
     right: the linear gradient of a photon transfer measurement (Konnik and Welsh 2014)."""
    text = head(
        title="Step wedge: irradiance rises linearly across the frame, from dark to 1.2 times saturation.",
        about=about,
        width=256,
        height=256,
        level="The last step stands at 120 % of full well (konnik_table1, f/2.8, 0.1 s).",
        lux=117,
        half_width=1.0,
    )
    for k in range(STEPS):
        text += square((2 * k + 1) / STEPS - 1, 0, 1 / STEPS, 1.5, even(k / (STEPS - 1)))
    return text + "</scene>\n"


if __name__ == "__main__":
    (HERE / "color_checker.xml").write_text(color_checker(), encoding="utf-8")
    (HERE / "step_wedge.xml").write_text(step_wedge(), encoding="utf-8")
