"""Write night_crossing.xml, its motion, and its meshes and textures in parts/night_crossing/.

    python scenes/make_night_crossing.py

Luminances and intensities are photometric here; V(λ) and the spectrum of each lamp make W m⁻² sr⁻¹ nm⁻¹ of them.
Lengths are metres: x is to the right, y up, and the street runs away from the camera towards -z.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from night_crossing_figures import (
    AXLES_Z_M,
    TRACK_X_M,
    WHEEL_RADIUS_M,
    car_body,
    car_dark_parts,
    car_glass,
    coat,
    head,
    legs,
    rim,
    tree,
    tyre,
    umbrella,
    umbrella_stick,
)
from night_crossing_houses import COLUMN_M, Facade
from night_crossing_mesh import Mesh
from night_crossing_textures import asphalt_relief, evening_sky, puddles

from mitsuba_sensor.files.openexr import Plane, write_planes
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.optics import spectra

HERE = Path(__file__).parent
PARTS = "parts/night_crossing"
WAVELENGTHS_NM = np.arange(380.0, 1101.0, 10.0)
RGB_UNIT_CD_PER_M2 = 73_000.0  # luminance of linear sRGB 1, 1, 1 as a spectrum of Mitsuba
ASPECT_M = 0.32  # from one aspect of a signal down to the next


# --- spectra


def bell(centre_nm: float, fwhm_nm: float) -> np.ndarray:
    """A bell curve of height 1."""
    return np.exp2(-4 * ((WAVELENGTHS_NM - centre_nm) / fwhm_nm) ** 2)


def black_body(temperature_k: float) -> np.ndarray:
    """Planck's law, relative."""
    return WAVELENGTHS_NM**-5 / np.expm1(1.4387769e7 / (WAVELENGTHS_NM * temperature_k))


def white_led(blue: float, phosphor_nm: float) -> np.ndarray:
    """A blue chip under a yellow phosphor: dark in the infrared.  blue : its peak over that of the phosphor."""
    shorter, longer = bell(phosphor_nm, 115), bell(phosphor_nm, 150)
    phosphor = np.where(phosphor_nm > WAVELENGTHS_NM, shorter, longer)
    return blue * bell(450, 22) + phosphor


def moonlight() -> np.ndarray:
    """Sunlight off the Moon, whose albedo rises from 0.07 at 450 to 0.12 at 750 nm, through a clear sky."""
    albedo = 0.07 + 0.05 * (WAVELENGTHS_NM - 450) / 300
    return black_body(5780) * albedo * np.exp(-0.25 * (450 / WAVELENGTHS_NM) ** 4)


LIGHTS: Mapping[str, np.ndarray] = {
    "street_led": white_led(0.55, 595),  # about 3000 K
    "headlight_led": white_led(1.25, 560),  # about 5500 K
    "tube_led": white_led(0.5, 585),  # about 3500 K
    "red_led": bell(632, 18),
    "green_led": bell(507, 32),
    "incandescent": black_body(2450),
    "moon": moonlight(),
}

# Plausible reflectances, not those of measured samples; what grows or is dyed is bright in the infrared.
REFLECTANCE_NM = (300, 400, 450, 500, 550, 600, 650, 700, 750, 850, 1100)
REFLECTANCES: Mapping[str, Sequence[float]] = {
    "asphalt": (0.03, 0.035, 0.04, 0.042, 0.045, 0.048, 0.05, 0.052, 0.054, 0.06, 0.07),
    "puddle": (0.012, 0.014, 0.016, 0.017, 0.018, 0.019, 0.02, 0.021, 0.02, 0.018, 0.012),
    "road_paint": (0.05, 0.35, 0.55, 0.58, 0.60, 0.61, 0.62, 0.62, 0.62, 0.60, 0.55),
    "paving": (0.06, 0.10, 0.12, 0.14, 0.155, 0.165, 0.17, 0.175, 0.18, 0.19, 0.21),
    "ochre_plaster": (0.08, 0.15, 0.20, 0.27, 0.36, 0.44, 0.48, 0.50, 0.52, 0.55, 0.58),
    "grey_plaster": (0.12, 0.24, 0.28, 0.30, 0.31, 0.32, 0.32, 0.33, 0.34, 0.36, 0.40),
    "brick": (0.04, 0.05, 0.06, 0.075, 0.10, 0.17, 0.23, 0.26, 0.28, 0.32, 0.38),
    "trim": (0.08, 0.38, 0.46, 0.49, 0.50, 0.51, 0.51, 0.52, 0.52, 0.53, 0.55),
    "slate": (0.04, 0.05, 0.055, 0.055, 0.055, 0.05, 0.05, 0.05, 0.055, 0.07, 0.10),
    "wood": (0.03, 0.035, 0.04, 0.045, 0.05, 0.06, 0.075, 0.09, 0.12, 0.20, 0.32),
    "leaf": (0.03, 0.04, 0.045, 0.055, 0.11, 0.07, 0.055, 0.12, 0.42, 0.46, 0.42),
    "black": (0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.025, 0.03),
    "wool": (0.02, 0.022, 0.024, 0.022, 0.02, 0.022, 0.025, 0.05, 0.15, 0.40, 0.50),
    "skin": (0.08, 0.22, 0.25, 0.28, 0.30, 0.45, 0.56, 0.60, 0.62, 0.60, 0.45),
    "red_cloth": (0.03, 0.035, 0.04, 0.035, 0.04, 0.22, 0.48, 0.55, 0.58, 0.60, 0.60),
    "silver_paint": (0.15, 0.34, 0.38, 0.39, 0.40, 0.40, 0.40, 0.40, 0.40, 0.41, 0.42),
    "blue_paint": (0.04, 0.10, 0.13, 0.08, 0.04, 0.03, 0.03, 0.05, 0.09, 0.16, 0.22),
}
# Aluminium, rounded from Rakić et al. 1998 (doi:10.1364/AO.37.005271).
ALUMINIUM_ETA = (
    "300:0.28, 400:0.49, 500:0.77, 600:1.2, 700:1.83, 800:2.77, 900:2.06, 1000:1.35, 1100:1.2"
)
ALUMINIUM_K = (
    "300:3.6, 400:4.86, 500:6.08, 600:7.26, 700:8.31, 800:8.4, 900:8.3, 1000:9.58, 1100:10.9"
)


def pairs(wavelengths_nm: Sequence[float] | np.ndarray, values: Sequence[float]) -> str:
    """A table of values as Mitsuba reads it."""
    return ", ".join(f"{w:g}:{v:.4g}" for w, v in zip(wavelengths_nm, values, strict=True))


def reflectance(name: str, key: str = "reflectance") -> str:
    return f'<spectrum name="{key}" value="{pairs(REFLECTANCE_NM, REFLECTANCES[name])}"/>'


def light(name: str, level: float, key: str = "radiance") -> str:
    """A spectrum of this luminance [cd/m²] or luminous intensity [cd]; none of its values is below 1e-6 of the top."""
    shape = LIGHTS[name]
    values = level * shape / spectra.luminous(WAVELENGTHS_NM, shape)
    values[values < 1e-6 * values.max()] = 0
    return f'<spectrum name="{key}" value="{pairs(WAVELENGTHS_NM, values.tolist())}"/>'


def vector(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:g}" for value in values)


def at(place: Sequence[float] | np.ndarray) -> str:
    return '<translate x="{:g}" y="{:g}" z="{:g}"/>'.format(*place)


def number(name: str, value: float) -> str:
    return f'<float name="{name}" value="{value:g}"/>'


# --- materials

MATT = (
    "ochre_plaster", "grey_plaster", "brick", "trim", "slate", "wood", "leaf", "black", "wool",
    "skin", "red_cloth",
)  # fmt: skip
COATED = (  # id, reflectance of the body, roughness and index of the coat
    ("stripes", "road_paint", 0.16, 1.33),
    ("pavement", "paving", 0.22, 1.33),
    ("glass", "black", 0.03, 1.52),
    ("silver_paint", "silver_paint", 0.08, 1.5),
    ("blue_paint", "blue_paint", 0.08, 1.5),
    ("shiny_black", "black", 0.12, 1.5),
)
WET_ALPHA, PUDDLE_ALPHA, WATER_INDEX, RELIEF_M = 0.18, 0.035, 1.33, 0.006
ROAD_HALF_M, PUDDLES_ACROSS, RELIEFS_ACROSS = 90.0, 9, 60  # tiles of 20 m and of 3 m


def two_sided(name: str, body: str) -> str:
    return f'    <bsdf type="twosided" id="{name}">{body}</bsdf>\n'


def coated(colour: str, alpha: float, index: float) -> str:
    """A coloured body under a rough clear coat: paint, glass, or anything that is wet."""
    return (
        '<bsdf type="roughplastic"><string name="distribution" value="ggx"/>'
        f"{number('alpha', alpha)}{number('int_ior', index)}"
        f"{reflectance(colour, 'diffuse_reflectance')}</bsdf>"
    )


def texture(name: str, file: str, tiles: int) -> str:
    """Plain numbers from a picture, repeated so many times across the road."""
    return (
        f'<texture name="{name}" type="bitmap"><string name="filename" value="{PARTS}/{file}"/>'
        f'<boolean name="raw" value="true"/>'
        f'<transform name="to_uv"><scale x="{tiles}" y="{tiles}"/></transform></texture>'
    )


def road() -> str:
    """Wet asphalt with puddles: a rough film of water, and smooth water where the texture says so."""
    return f"""    <bsdf type="blendbsdf" id="road">
        {texture("weight", "puddles.png", PUDDLES_ACROSS)}
        <bsdf type="bumpmap">
            {texture("relief", "asphalt.png", RELIEFS_ACROSS)}
            {number("scale", RELIEF_M)}
            {coated("asphalt", WET_ALPHA, WATER_INDEX)}
        </bsdf>
        {coated("puddle", PUDDLE_ALPHA, WATER_INDEX)}
    </bsdf>
"""


def materials() -> str:
    text = ""
    for name in MATT:
        text += two_sided(name, f'<bsdf type="diffuse">{reflectance(name)}</bsdf>')
    for name, colour, alpha, index in COATED:
        text += two_sided(name, coated(colour, alpha, index))
    metal = (
        f'<bsdf type="roughconductor">{number("alpha", 0.25)}'
        f'<spectrum name="eta" value="{ALUMINIUM_ETA}"/><spectrum name="k" value="{ALUMINIUM_K}"/></bsdf>'
    )
    return text + two_sided("aluminium", metal) + road()


# --- what shines: names, places [m], levels, and how often paths look for each (measured: the least noise)

MOON_M, MOON_RADIUS_M, MOON_CD_PER_M2 = (-14.0, 66.0, -290.0), 1.36, 2500.0
CAMERA_M, TARGET_M, FOCAL_LENGTH_MM = (3.2, 1.4, 0.0), (1.121, 1.1, -9.781), 3.1
LAMPS = (  # middle of each lamp, weight
    ((-4.3, 6.2, -4.0), 2.0),
    ((4.3, 6.2, -18.0), 5.5),
    ((-4.3, 6.2, -31.0), 2.4),
    ((4.3, 6.2, -44.0), 1.4),
    ((-4.3, 6.2, -58.0), 0.9),
    ((4.3, 6.2, -74.0), 0.5),
)
LAMP_CD_PER_M2, LAMP_HALF_M, LAMP_TILT_DEG = 6500.0, (0.25, 0.125), 12.0
CAR_M, CAR_M_PER_S = (-2.3, 0.0, -16.2), 4.0  # where it is at time 0, and how fast it comes
HEADLIGHTS_ON_CAR_M = ((-0.62, 0.70, 2.12), (0.62, 0.70, 2.12))
HEADLIGHT_CD_PER_M2, HEADLIGHT_RADIUS_M = 2.5e4, 0.05
BEAM_CD, BEAM_AIM_M, BEAM_DEG = 1500.0, (-2.6, -0.7, 14.0), (9.0, 26.0)
SIGNAL_RADIUS_M = 0.14
SIGNALS = (  # name, spectrum, cd/m², place, aspects of its case
    ("signal_red_1", "red_led", 250.0, (5.6, 2.95, -12.3), 3),
    ("signal_red_2", "red_led", 250.0, (-5.6, 2.95, -12.6), 3),
    ("signal_walk", "green_led", 150.0, (-5.6, 2.2, -12.2), 2),
)
SIGNAL_MASTS_M = ((5.6, -12.45), (-5.6, -12.45))
WINDOWS = (  # name, spectrum, cd/m², weight
    ("window_warm", "incandescent", 2.6, 1.0),
    ("window_dim", "incandescent", 1.0, 0.7),
    ("window_cool", "tube_led", 1.4, 0.3),
    ("window_cafe", "incandescent", 2.8, 1.0),
)


def area_light(name: str, spectrum: str, level: float, weight: float) -> str:
    body = number("sampling_weight", weight) + light(spectrum, level)
    return f'<emitter type="area" id="{name}">{body}</emitter>'


def shining(kind: str, emitter: str, name: str, place: str) -> str:
    """A rectangle or a disk that shines."""
    return (
        f'    <shape type="{kind}" id="{name}_shape"><transform name="to_world">{place}</transform>'
        f'<ref id="black"/>{emitter}</shape>\n'
    )


def sky_and_moon() -> str:
    sky = (
        f'    <emitter type="envmap" id="sky"><string name="filename" value="{PARTS}/sky.exr"/>'
        f"{number('scale', 1 / RGB_UNIT_CD_PER_M2)}{number('sampling_weight', 3)}</emitter>\n"
    )
    lookat = f'<lookat origin="{vector(MOON_M)}" target="{vector(CAMERA_M)}" up="0, 1, 0"/>'
    moon = area_light("moon", "moon", MOON_CD_PER_M2, 1.5)
    return sky + shining("disk", moon, "moon", f'<scale value="{MOON_RADIUS_M:g}"/>{lookat}')


def lamps() -> str:
    text = ""
    for count, (place, weight) in enumerate(LAMPS, start=1):
        tilt_deg = -np.sign(place[0]) * LAMP_TILT_DEG  # towards the middle of the street
        long, wide = LAMP_HALF_M
        transform = (
            f'<scale x="{long:g}" y="{wide:g}"/><rotate x="1" angle="90"/>'
            f'<rotate z="1" angle="{tilt_deg:g}"/>{at(place)}'
        )
        emitter = area_light(f"lamp_{count}", "street_led", LAMP_CD_PER_M2, weight)
        text += shining("rectangle", emitter, f"lamp_{count}", transform)
    return text


def headlights() -> str:
    text = ""
    narrow_deg, wide_deg = BEAM_DEG
    for count, on_car in enumerate(HEADLIGHTS_ON_CAR_M, start=1):
        place, name = np.add(CAR_M, on_car), f"headlight_{count}"
        emitter = area_light(name, "headlight_led", HEADLIGHT_CD_PER_M2, 1.3)
        scaled = f'<scale value="{HEADLIGHT_RADIUS_M:g}"/>{at(place)}'
        text += shining("disk", emitter, name, scaled)
        origin, target = np.add(place, (0, 0, 0.05)), np.add(place, BEAM_AIM_M)
        lookat = f'<lookat origin="{vector(origin)}" target="{vector(target)}" up="0, 1, 0"/>'
        text += (
            f'    <emitter type="spot" id="{name}_beam">'
            f'<transform name="to_world">{lookat}</transform>'
            f"{number('beam_width', narrow_deg)}{number('cutoff_angle', wide_deg)}"
            f"{number('sampling_weight', 0.5)}"
            f"{light('headlight_led', BEAM_CD, 'intensity')}</emitter>\n"
        )
    return text


def signals() -> str:
    text = ""
    for name, spectrum, level, place, _ in SIGNALS:
        before_the_case = np.add(place, (0, 0, 0.02))
        transform = f'<scale value="{SIGNAL_RADIUS_M:g}"/>{at(before_the_case)}'
        text += shining("disk", area_light(name, spectrum, level, 0.7), name, transform)
    return text


# --- houses

HOUSES = (  # side, where it begins [m], columns, floors, wall, shop
    (-1, 2.0, 5, 3, "brick", ""),
    (-1, -11.5, 4, 3, "ochre_plaster", "window_cafe"),
    (-1, -22.3, 5, 4, "grey_plaster", ""),
    (-1, -35.8, 4, 2, "brick", ""),
    (-1, -46.6, 6, 4, "ochre_plaster", ""),
    (-1, -62.8, 8, 3, "grey_plaster", ""),
    (-1, -84.4, 6, 4, "brick", ""),
    (1, -4.0, 5, 3, "grey_plaster", ""),
    (1, -17.5, 4, 4, "brick", ""),
    (1, -28.3, 6, 3, "ochre_plaster", ""),
    (1, -44.5, 5, 4, "grey_plaster", ""),
    (1, -58.0, 8, 3, "brick", ""),
    (1, -79.6, 8, 4, "ochre_plaster", ""),
)
HOUSE_MATERIALS = {
    "ochre_plaster": "ochre_plaster", "grey_plaster": "grey_plaster", "brick": "brick", "trim": "trim",
    "glass": "glass", "door": "wood", "awning": "red_cloth", "roofs": "slate",
}  # fmt: skip
FRONT_X_M, PAVEMENT_M, WINDOW_SEED = 8.5, 0.13, 3
LIT = ((0.22, "window_warm"), (0.40, "window_dim"), (0.48, "window_cool"))
"""Panes of a smaller random number than these shine; all others are dark."""


def lit_windows(
    chance: np.random.Generator, columns: int, floors: int
) -> dict[tuple[int, int], str]:
    """What shines at (floor, column)."""
    lit: dict[tuple[int, int], str] = {}
    for floor in range(floors):
        for column in range(columns):
            drawn = chance.random()
            names = [name for below, name in LIT if drawn < below]
            if names:
                lit[floor, column] = names[0]
    return lit


def houses() -> dict[str, Mesh]:
    """The meshes of all houses: those of HOUSE_MATERIALS, and the lit windows by the names of their emitters."""
    parts = {name: Mesh() for name in (*HOUSE_MATERIALS, *(name for name, *_ in WINDOWS))}
    chance = np.random.default_rng(WINDOW_SEED)
    for side, begin, columns, floors, wall, shop in HOUSES:
        corner_z = begin
        if side > 0:  # seen from the street, its left end is the far one
            corner_z = begin - columns * COLUMN_M
        lit = lit_windows(chance, columns, floors)
        origin = (side * FRONT_X_M, PAVEMENT_M, corner_z)
        Facade(origin, (0, 0, side), columns, floors, lit, shop).build(parts, wall)
    church(parts["grey_plaster"], parts["roofs"])
    return parts


def church(walls: Mesh, roofs: Mesh) -> None:
    """A church at the end of the street."""
    walls.box((-1, 0, -150), (5, 9, -130))
    walls.box((-0.5, 0, -130), (4.5, 19, -124))
    tip = (2.0, 32.0, -127.0)
    base = [(-0.8, 19, -123.7), (4.8, 19, -123.7), (4.8, 19, -130.3), (-0.8, 19, -130.3)]
    for a, b in zip(base, base[1:] + base[:1], strict=True):
        roofs.add(np.array([a, b, tip]), np.array([[0, 1, 2]]))


# --- the street

Made = dict[str, tuple[str, Mesh]]  # material and mesh, by the name of its file and its shape
KERB_X_M = 5.0
PERSON_M, PERSON_TURN_DEG = (0.95, 0.0, -9.7), 180.0  # on the crossing, on the way to the left
TREES_M = ((6.9, -24.5), (6.9, -35.0), (-6.9, -27.0), (-6.9, -40.0))
PARKED_M = ((4.0, 0.0, -26.0), (4.05, 0.0, -32.5), (4.0, 0.0, -50.0))
SMOOTH = {"car_body", "parked_bodies", "person_coat", "person_legs", "person_head", "masts"}


def street() -> Made:
    """Pavements, kerbs, paint, masts, the cases of lamps and signals."""
    pavement, paint, masts, cases = Mesh(), Mesh(), Mesh(), Mesh()
    for side in (-1, 1):
        for inner, outer, height in ((KERB_X_M, 5.15, 0.15), (5.15, 12.0, PAVEMENT_M)):
            low, high = sorted((side * inner, side * outer))
            pavement.box((low, -0.05, -160), (high, height, 12))
    paint_on_road(paint)
    for (x, y, z), _ in LAMPS:
        foot = np.sign(x) * 5.75
        bend = [(foot, 0, z), (foot, 3, z), (foot, y - 0.6, z), (0.85 * foot, y + 0.12, z)]
        masts.tube([*bend, (x, y + 0.07, z)], (0.09, 0.075, 0.06, 0.05, 0.05))
        cases.box((x - 0.33, y + 0.05, z - 0.17), (x + 0.33, y + 0.13, z + 0.17))
    for x, z in SIGNAL_MASTS_M:
        cases.tube([(x, 0, z), (x, 3.4, z)], (0.06, 0.06))
    for *_, place, aspects in SIGNALS:
        signal_case(cases, place, aspects)
    return {
        "pavements": ("pavement", pavement),
        "road_paint": ("stripes", paint),
        "masts": ("aluminium", masts),
        "cases": ("shiny_black", cases),
    }


def paint_on_road(mesh: Mesh) -> None:
    """The crossing, the lines where cars stop, and the line in the middle."""
    places = [(x, x + 0.5, -11.6, -8.4) for x in np.arange(-4.6, 4.2, 1.0)]
    places += [(0.15, 4.6, -7.6, -7.2), (-4.6, -0.15, -12.8, -12.4)]
    places += [(-0.06, 0.06, z - 3.0, z) for z in np.arange(-18.0, -120.0, -6.0)]
    y = 0.006
    for left, right, far, near in places:
        mesh.quad((left, y, near), (right, y, near), (right, y, far), (left, y, far))


def signal_case(mesh: Mesh, place: Sequence[float], aspects: int) -> None:
    """The case of a signal whose top aspect shines, with a visor above each aspect."""
    x, y, z = place
    tall = ASPECT_M * aspects
    mesh.box((x - 0.17, y + 0.18 - tall, z - 0.22), (x + 0.17, y + 0.18, z))
    angles = np.radians(np.linspace(-30, 210, 9))
    for k in range(aspects):
        arc_x = x + SIGNAL_RADIUS_M * np.cos(angles)
        arc_y = y - ASPECT_M * k + SIGNAL_RADIUS_M * np.sin(angles)
        for a, b in zip(range(8), range(1, 9), strict=True):
            near = (arc_x[b], arc_y[b], z + 0.2), (arc_x[a], arc_y[a], z + 0.2)
            mesh.quad((arc_x[a], arc_y[a], z), (arc_x[b], arc_y[b], z), *near)


def person_and_trees() -> Made:
    wood, leaves = Mesh(), Mesh()
    for seed, (x, z) in enumerate(TREES_M):
        trunk, crown = tree(seed)
        wood.join(trunk.moved((x, PAVEMENT_M, z)))
        leaves.join(crown.moved((x, PAVEMENT_M, z)))
    person = {
        "person_coat": ("wool", coat()),
        "person_legs": ("black", legs()),
        "person_head": ("skin", head()),
        "person_umbrella": ("red_cloth", umbrella()),
        "person_stick": ("black", umbrella_stick()),
    }
    made = {
        name: (material, mesh.moved(PERSON_M, PERSON_TURN_DEG))
        for name, (material, mesh) in person.items()
    }
    return made | {"trunks": ("wood", wood), "leaves": ("leaf", leaves)}


def wheels_m() -> dict[str, np.ndarray]:
    """Middles of the wheels on a car."""
    return {
        f"{end}_{side}": np.array([x, WHEEL_RADIUS_M, z])
        for end, z in zip(("front", "rear"), AXLES_Z_M, strict=True)
        for side, x in (("left", TRACK_X_M), ("right", -TRACK_X_M))
    }


def cars() -> Made:
    """The car that comes, in parts because each moves by its own id, and the parked ones."""
    parts = {
        "car_body": ("silver_paint", car_body()),
        "car_glass": ("glass", car_glass()),
        "car_dark": ("shiny_black", car_dark_parts()),
    }
    parked = {"bodies": ("blue_paint", car_body()), "glass": ("glass", car_glass())}
    dark, rims = car_dark_parts(), Mesh()
    for name, place in wheels_m().items():
        parts[f"car_tyre_{name}"] = ("black", tyre().moved(place))
        parts[f"car_rim_{name}"] = ("aluminium", rim().moved(place))
        dark.join(tyre().moved(place))
        rims.join(rim().moved(place))
    parked |= {"dark": ("shiny_black", dark), "rims": ("aluminium", rims)}
    made = {name: (material, mesh.moved(CAR_M)) for name, (material, mesh) in parts.items()}
    for name, (material, mesh) in parked.items():
        all_of_them = Mesh()
        for place in PARKED_M:
            all_of_them.join(mesh.moved(place, 180.0))
        made[f"parked_{name}"] = (material, all_of_them)
    return made


# --- the files

HEAD = f"""<?xml version="1.0" encoding="utf-8"?>
<!-- Night crossing: a wet street late in the evening, 130 dB from the headlights to the darkest walls. LED street
     lamps, a traffic light, a car that comes, lit windows, the Moon, and a person with an umbrella in the dark.

     mitsuba-sensor render night_crossing -o out/      the second picture of the README

     The ids of the emitters make groups: sky and moon, lamp_*, headlight_*, signal_*, window_*. night_crossing.toml
     moves the car with its wheels and lights. Spectra go to 1100 nm, but for the sky, an RGB picture. Written by
     make_night_crossing.py. -->
<scene version="3.0.0">
    <!-- Columns and rows of the film: a window of the camera's pixels. -->
    <default name="width" value="384"/>
    <default name="height" value="256"/>
    <!-- How long the shutter is open [s]. -->
    <default name="exposure_s" value="0.025"/>
    <!-- Focal length over pupil diameter. -->
    <default name="f_number" value="1.4"/>
    <!-- Gain setting of the camera: an ISO number. -->
    <default name="iso" value="3200"/>

    <integrator type="path">
        <integer name="max_depth" value="16"/>
    </integrator>

    <sensor type="camera">
        <float name="focal_length_mm" value="{FOCAL_LENGTH_MM:g}"/>
        <float name="f_number" value="$f_number"/>
        <string name="scene_unit" value="m"/>
        <transform name="to_world">
            <lookat origin="{vector(CAMERA_M)}" target="{vector(TARGET_M)}" up="0, 1, 0"/>
        </transform>
        <film type="photosensor">
            <string name="camera" value="sony_a7s2"/>
            <string name="gain" value="$iso"/>
            <float name="exposure_s" value="$exposure_s"/>
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
        </film>
        <sampler type="multijitter"/>
    </sensor>
"""
ROAD = (
    '    <shape type="rectangle" id="road_shape"><transform name="to_world"><rotate x="1" angle="-90"/>'
    f'<scale x="{ROAD_HALF_M:g}" z="{ROAD_HALF_M:g}"/><translate z="-70"/></transform><ref id="road"/></shape>\n'
)


def mesh_shape(name: str, material: str, emitter: str = "") -> str:
    """A shape whose mesh is in a file of its name."""
    flat = '<boolean name="face_normals" value="true"/>'
    if name in SMOOTH:
        flat = ""
    return (
        f'    <shape type="ply" id="{name}"><string name="filename" value="{PARTS}/{name}.ply"/>'
        f'{flat}<ref id="{material}"/>{emitter}</shape>\n'
    )


def meshes() -> Made:
    """Material and mesh of everything that is in a file, by its name."""
    built = houses()
    made: Made = {f"houses_{k}": (m, built[k]) for k, m in HOUSE_MATERIALS.items()}
    made |= {f"{name}_shape": ("black", built[name]) for name, *_ in WINDOWS}
    return made | street() | person_and_trees() | cars()


def scene(made: Made) -> str:
    """The text of night_crossing.xml."""
    emitters = {f"{row[0]}_shape": area_light(*row) for row in WINDOWS}
    shapes = "".join(mesh_shape(k, m, emitters.get(k, "")) for k, (m, _) in made.items())
    sections = {
        "Materials: reflectances from 300 to 1100 nm.": materials(),
        "Sky and Moon.": sky_and_moon(),
        "Street lamps: LEDs of about 3000 K.": lamps(),
        "Headlights: what is seen of each, and its beam.": headlights(),
        "The traffic light.": signals(),
        "Houses with lit windows, the street, the person, the cars.": ROAD + shapes,
    }
    text = HEAD
    for title, elements in sections.items():
        text += f"\n    <!-- {title} -->\n{elements}"
    return text + "</scene>\n"


def motion() -> str:
    """The text of night_crossing.toml."""
    velocity = f"velocity_m_per_s = [0, 0, {CAR_M_PER_S:g}]\n"
    text = (
        f"# How the car of night_crossing.xml comes: {CAR_M_PER_S:g} m/s, and its wheels roll. Time 0 is when the\n"
        "# first row of the film opens; lengths are metres.\n"
    )
    moving = ["car_body", "car_glass", "car_dark"]
    for count in range(1, len(HEADLIGHTS_ON_CAR_M) + 1):
        moving += [f"headlight_{count}_shape", f"headlight_{count}_beam"]
    for name in moving:
        text += f"\n[objects.{name}]\n{velocity}"
    turn = (
        f"rotate_deg_per_s = {np.degrees(CAR_M_PER_S / WHEEL_RADIUS_M):.5g}\naxis = [1, 0, 0]\n"
    )
    for name, on_car in wheels_m().items():
        pivot = f"pivot_m = [{vector(np.add(CAR_M, on_car))}]\n"
        for part in ("tyre", "rim"):
            text += f"\n[objects.car_{part}_{name}]\n{velocity}{turn}{pivot}"
    return text


def write(folder: Path) -> None:
    """Write the scene, its motion and its parts below this folder."""
    parts, made = folder / PARTS, meshes()
    parts.mkdir(parents=True, exist_ok=True)
    (folder / "night_crossing.xml").write_text(scene(made), encoding="utf-8")
    (folder / "night_crossing.toml").write_text(motion(), encoding="utf-8")
    for name, (_, mesh) in made.items():
        (parts / f"{name}.ply").write_bytes(mesh.ply())
    for name, heights in (("puddles", puddles()), ("asphalt", asphalt_relief())):
        write_png(parts / f"{name}.png", np.rint(255 * heights).astype(np.uint8))
    sky = evening_sky()
    channels = {name: Plane(sky[..., k], 1.0) for k, name in enumerate("RGB")}
    write_planes(parts / "sky.exr", {}, channels)


if __name__ == "__main__":
    write(HERE)
