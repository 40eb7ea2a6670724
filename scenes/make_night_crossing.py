"""Write night_crossing.xml, its motion, and its meshes and textures in parts/night_crossing/.

    python scenes/make_night_crossing.py

Luminances and intensities are photometric here, and become W m⁻² sr⁻¹ nm⁻¹ by V(λ) and the spectrum of each lamp.
Lengths in metres: x is to the right, y up, and the street runs along z, away from the camera towards -z.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from night_crossing_meshes import (
    AXLES_Z_M,
    TRACK_X_M,
    WHEEL_RADIUS_M,
    Facade,
    Mesh,
    asphalt_relief,
    car_body,
    car_dark_parts,
    car_glass,
    coat,
    evening_sky,
    head,
    legs,
    puddles,
    rim,
    roof,
    tree,
    tyre,
    umbrella,
    umbrella_stick,
)

from mitsuba_sensor.files.openexr import Plane, write_planes
from mitsuba_sensor.files.png import write_png
from mitsuba_sensor.optics import spectra

HERE = Path(__file__).parent
PARTS = "parts/night_crossing"
WAVELENGTHS_NM = np.arange(380.0, 1101.0, 10.0)
CAR_M, CAR_M_PER_S = (-2.3, 0.0, -16.2), 4.0  # where it is at time 0, and how fast it comes
SKY_UNIT_CD_PER_M2 = 73_000.0  # of linear sRGB 1, 1, 1 as a spectrum of Mitsuba


# --- spectra --------------------------------------------------------------------------------


def bell(centre_nm: float, fwhm_nm: float) -> np.ndarray:
    """A bell curve of height 1."""
    return np.exp(-4 * np.log(2) * ((WAVELENGTHS_NM - centre_nm) / fwhm_nm) ** 2)


def black_body(temperature_k: float) -> np.ndarray:
    """Planck's law, relative."""
    x = 1.4387769e7 / (WAVELENGTHS_NM * temperature_k)
    return (
        (555 / WAVELENGTHS_NM) ** 5
        / np.expm1(x)
        * np.expm1(1.4387769e7 / (555 * temperature_k))
    )


def white_led(blue: float, phosphor_nm: float) -> np.ndarray:
    """A blue chip under a yellow phosphor: dark in the infrared.  blue : its peak over that of the phosphor."""
    phosphor = np.where(
        WAVELENGTHS_NM < phosphor_nm, bell(phosphor_nm, 115), bell(phosphor_nm, 150)
    )
    return blue * bell(450, 22) + phosphor


def moonlight() -> np.ndarray:
    """Sunlight off the Moon, whose albedo rises by half from 450 to 750 nm, through a clear sky."""
    albedo = 0.07 + 0.05 * (WAVELENGTHS_NM - 450) / 300
    sky = np.exp(-0.25 * (450 / WAVELENGTHS_NM) ** 4)
    return black_body(5780) * albedo * sky


LIGHTS: Mapping[str, np.ndarray] = {
    "street_led": white_led(0.55, 595),  # about 3000 K
    "headlight_led": white_led(1.25, 560),  # about 5500 K
    "red_led": bell(632, 18),
    "green_led": bell(507, 32),
    "lamp_light": black_body(2450),  # halogen lamps behind curtains
    "tube_led": white_led(0.8, 575),
    "moon": moonlight(),
}

# Reflectances at 300, 400, 450, 500, 550, 600, 650, 700, 750, 850 and 1100 nm: plausible values, rounded to a few percent.
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
    "umbrella_cloth": (0.03, 0.035, 0.04, 0.035, 0.04, 0.22, 0.48, 0.55, 0.58, 0.60, 0.60),
    "silver_paint": (0.15, 0.34, 0.38, 0.39, 0.40, 0.40, 0.40, 0.40, 0.40, 0.41, 0.42),
    "blue_paint": (0.04, 0.10, 0.13, 0.08, 0.04, 0.03, 0.03, 0.05, 0.09, 0.16, 0.22),
}


def pairs(
    wavelengths_nm: Sequence[float] | np.ndarray, values: Sequence[float] | np.ndarray
) -> str:
    """A table as Mitsuba reads it."""
    return ", ".join(f"{w:g}:{v:.4g}" for w, v in zip(wavelengths_nm, values, strict=True))


def reflectance(name: str, key: str = "reflectance") -> str:
    return f'<spectrum name="{key}" value="{pairs(REFLECTANCE_NM, REFLECTANCES[name])}"/>'


def light(name: str, level: float, key: str = "radiance") -> str:
    """A spectrum of this luminance [cd/m²] or luminous intensity [cd]."""
    shape = LIGHTS[name]
    values = level * shape / spectra.luminous(WAVELENGTHS_NM, shape)
    return f'<spectrum name="{key}" value="{pairs(WAVELENGTHS_NM, np.maximum(values, 0))}"/>'


# --- materials ------------------------------------------------------------------------------


def matt(name: str) -> str:
    body = f'<bsdf type="diffuse">{reflectance(name)}</bsdf>'
    return f'    <bsdf type="twosided" id="{name}">{body}</bsdf>\n'


def coated(name: str, colour: str, alpha: float, inside: float, identity: bool = True) -> str:
    """A coloured body under a rough clear coat of this index: paint, or anything that is wet."""
    own = f' id="{name}"' if identity else ""
    return (
        f'<bsdf type="roughplastic"{own}><string name="distribution" value="ggx"/>'
        f'<float name="alpha" value="{alpha:g}"/><float name="int_ior" value="{inside:g}"/>'
        f"{reflectance(colour, 'diffuse_reflectance')}</bsdf>"
    )


def road() -> str:
    """Wet asphalt with puddles: rough water film, and smooth water where the texture says so."""
    wet = coated("wet", "asphalt", 0.18, 1.33, identity=False)
    relief = f"""<bsdf type="bumpmap">
            <texture name="arbitrary" type="bitmap">
                <string name="filename" value="{PARTS}/asphalt.png"/>
                <boolean name="raw" value="true"/>
                <transform name="to_uv"><scale x="60" y="60"/></transform>
            </texture>
            <float name="scale" value="{RELIEF_M:g}"/>
            {wet}
        </bsdf>"""
    water = coated("water", "puddle", 0.035, 1.33, identity=False)
    return f"""    <bsdf type="blendbsdf" id="road">
        <texture name="weight" type="bitmap">
            <string name="filename" value="{PARTS}/puddles.png"/>
            <boolean name="raw" value="true"/>
            <transform name="to_uv"><scale x="9" y="9"/></transform>
        </texture>
        {relief}
        {water}
    </bsdf>
"""


def metal(name: str, alpha: float) -> str:
    """Aluminium (η and k after Rakić 1998, rounded), rough."""
    eta = "300:0.28, 400:0.49, 500:0.77, 600:1.20, 700:1.83, 800:2.77, 900:2.06, 1000:1.35, 1100:1.20"
    k = "300:3.6, 400:4.86, 500:6.08, 600:7.26, 700:8.31, 800:8.40, 900:8.30, 1000:9.58, 1100:10.9"
    return (
        f'    <bsdf type="twosided" id="{name}"><bsdf type="roughconductor">'
        f'<float name="alpha" value="{alpha:g}"/><spectrum name="eta" value="{eta}"/><spectrum name="k" value="{k}"/>'
        f"</bsdf></bsdf>\n"
    )


RELIEF_M = 0.006
MATT = ("ochre_plaster", "grey_plaster", "brick", "trim", "slate", "wood", "leaf", "black", "wool", "skin", "umbrella_cloth")  # fmt: skip


def materials() -> str:
    text = "".join(matt(name) for name in MATT)
    text += road() + metal("aluminium", 0.25)
    for name, colour, alpha, inside in (
        ("stripes", "road_paint", 0.16, 1.33),
        ("pavement", "paving", 0.22, 1.33),
        ("glass", "black", 0.03, 1.52),
        ("silver_paint", "silver_paint", 0.08, 1.5),
        ("blue_paint", "blue_paint", 0.08, 1.5),
        ("shiny_black", "black", 0.12, 1.5),
    ):
        text += f'    <bsdf type="twosided" id="{name}">{coated("", colour, alpha, inside, identity=False)}</bsdf>\n'
    return text


# --- shapes and emitters --------------------------------------------------------------------


def emitter(name: str, spectrum: str, weight: float) -> str:
    """An area light.  weight : how often paths look for it."""
    return f'<emitter type="area" id="{name}"><float name="sampling_weight" value="{weight:g}"/>{spectrum}</emitter>'


def mesh(name: str, material: str, more: str = "", smooth: bool = False) -> str:
    """A mesh in a file of its own."""
    flat = "" if smooth else '<boolean name="face_normals" value="true"/>'
    return (
        f'    <shape type="ply" id="{name}"><string name="filename" value="{PARTS}/{name}.ply"/>{flat}'
        f'{more}<ref id="{material}"/></shape>\n'
    )


def flat_light(
    kind: str, name: str, place: str, level: tuple[str, float], weight: float
) -> str:
    """A rectangle or a disk that shines."""
    return (
        f'    <shape type="{kind}" id="{name}_shape"><transform name="to_world">{place}</transform>'
        f'<ref id="black"/>{emitter(name, light(*level), weight)}</shape>\n'
    )


def at(x: float, y: float, z: float) -> str:
    return f'<translate x="{x:g}" y="{y:g}" z="{z:g}"/>'


# Middle of each lamp; odd ones stand on the left.
LAMPS_M = ((-4.3, 6.2, -4.0), (4.3, 6.2, -18.0), (-4.3, 6.2, -31.0), (4.3, 6.2, -44.0), (-4.3, 6.2, -58.0), (4.3, 6.2, -74.0))  # fmt: skip
LAMP_CD_PER_M2, LAMP_M = 6500.0, (0.25, 0.125)  # and its half length and half width
LAMP_WEIGHTS = (2.0, 5.5, 2.4, 1.4, 0.9, 0.5)
HEADLIGHT_CD_PER_M2, HEADLIGHT_RADIUS_M, BEAM_CD = 2.5e4, 0.05, 1500.0
HEADLIGHTS_X_M, HEADLIGHT_Y_M, HEADLIGHT_Z_M = (-0.62, 0.62), 0.70, 2.12  # on the car
SIGNALS = (  # name, spectrum, cd/m², x, y, z
    ("signal_red_1", "red_led", 250.0, 5.6, 2.95, -12.3),
    ("signal_red_2", "red_led", 250.0, -5.6, 2.95, -12.6),
    ("signal_walk", "green_led", 150.0, -5.6, 2.2, -12.2),
)
WINDOWS = (  # name, spectrum, cd/m², weight
    ("window_warm", "lamp_light", 2.6, 1.0),
    ("window_dim", "lamp_light", 1.0, 0.7),
    ("window_cool", "tube_led", 1.4, 0.3),
    ("window_cafe", "lamp_light", 2.8, 1.0),
)


def lamps() -> str:
    text = ""
    for number, (x, y, z) in enumerate(LAMPS_M, start=1):
        long, wide = LAMP_M
        tilt = 12 if x < 0 else -12  # towards the middle of the street
        place = f'<scale x="{long:g}" y="{wide:g}"/><rotate x="1" angle="90"/><rotate z="1" angle="{tilt}"/>{at(x, y, z)}'
        text += flat_light(
            "rectangle",
            f"lamp_{number}",
            place,
            ("street_led", LAMP_CD_PER_M2),
            LAMP_WEIGHTS[number - 1],
        )
    return text


def headlights() -> str:
    text = ""
    for number, x in enumerate(HEADLIGHTS_X_M, start=1):
        place = np.array(CAR_M) + (x, HEADLIGHT_Y_M, HEADLIGHT_Z_M)
        scaled = f'<scale value="{HEADLIGHT_RADIUS_M:g}"/>{at(*place)}'
        text += flat_light(
            "disk", f"headlight_{number}", scaled, ("headlight_led", HEADLIGHT_CD_PER_M2), 1.3
        )
        origin, target = place + (0, 0, 0.05), place + (-2.6, -0.7, 14)
        lookat = f'<lookat origin="{vector(origin)}" target="{vector(target)}" up="0, 1, 0"/>'
        text += (
            f'    <emitter type="spot" id="headlight_{number}_beam"><transform name="to_world">{lookat}</transform>'
            f'<float name="cutoff_angle" value="26"/><float name="beam_width" value="9"/>'
            f'<float name="sampling_weight" value="0.5"/>{light("headlight_led", BEAM_CD, "intensity")}</emitter>\n'
        )
    return text


def vector(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:g}" for value in values)


def signals() -> str:
    text = ""
    for name, spectrum, level, x, y, z in SIGNALS:
        place = f'<scale value="0.14"/>{at(x, y, z + 0.02)}'
        text += flat_light("disk", name, place, (spectrum, level), 0.7)
    return text


def sky_and_moon() -> str:
    moon = f'<scale value="1.36"/><lookat origin="{vector(MOON_M)}" target="3.2, 1.4, 0" up="0, 1, 0"/>'
    return (
        f'    <emitter type="envmap" id="sky"><string name="filename" value="{PARTS}/sky.exr"/>'
        f'<float name="scale" value="{1 / SKY_UNIT_CD_PER_M2:.6g}"/><float name="sampling_weight" value="3"/></emitter>\n'
        + flat_light("disk", "moon", moon, ("moon", 2500.0), 1.5)
    )


MOON_M = (-14.0, 66.0, -290.0)


def lit_windows() -> str:
    text = ""
    for name, spectrum, level, weight in WINDOWS:
        text += mesh(f"{name}_shape", "black", emitter(name, light(spectrum, level), weight))
    return text


# --- what stands in the street ----------------------------------------------------------------


HOUSES = (  # side, where it begins, columns, floors, wall, shop
    (-1, 2.0, 5, 3, "brick", ""),
    (-1, -11.5, 4, 3, "ochre_plaster", "window_cafe_shape"),
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
    "glass": "glass", "door": "wood", "awning": "umbrella_cloth", "roofs": "slate",
}  # fmt: skip


def lit(chance: np.random.Generator, columns: int, floors: int) -> dict[tuple[int, int], str]:
    """Which windows shine, and how."""
    found = {}
    for key in np.ndindex(floors, columns):
        which = chance.random()
        if which < 0.22:
            found[key] = "window_warm_shape"
        elif which < 0.40:
            found[key] = "window_dim_shape"
        elif which < 0.48:
            found[key] = "window_cool_shape"
    return found


def houses() -> dict[str, Mesh]:
    """Meshes of all houses by name."""
    names = [*HOUSE_MATERIALS, *(f"{name}_shape" for name, *_ in WINDOWS)]
    parts = {name: Mesh() for name in names}
    chance = np.random.default_rng(3)
    for side, begin, columns, floors, wall, shop in HOUSES:
        width = columns * 2.7
        origin = (-8.5, 0.13, begin) if side < 0 else (8.5, 0.13, begin - width)
        facade = Facade(
            origin, (0, 0, side), columns, floors, lit(chance, columns, floors), shop=shop
        )
        facade.build(parts, wall)
        roof(facade, 9.0, parts["roofs"])
    tower(parts["grey_plaster"], parts["roofs"])
    return parts


def tower(walls: Mesh, roofs: Mesh) -> None:
    """A church at the end of the street."""
    walls.box((-1, 0, -150), (5, 9, -130))
    walls.box((-0.5, 0, -130), (4.5, 19, -124))
    tip = (2.0, 32.0, -127)
    base = [(-0.8, 19, -123.7), (4.8, 19, -123.7), (4.8, 19, -130.3), (-0.8, 19, -130.3)]
    for a, b in zip(base, base[1:] + base[:1], strict=True):
        roofs.add(np.array([a, b, tip]), np.array([[0, 1, 2]]))


def street() -> dict[str, tuple[str, Mesh]]:
    """Pavements, kerbs, stripes, masts, signals."""
    pavement, stripes, masts, boxes = Mesh(), Mesh(), Mesh(), Mesh()
    for side in (-1, 1):
        low, high = sorted((side * 5.15, side * 12.0))
        pavement.box((low, -0.05, -160), (high, 0.13, 12))
        low, high = sorted((side * 5.0, side * 5.15))
        pavement.box((low, -0.05, -160), (high, 0.15, 12))
    for x in np.arange(-4.6, 4.2, 1.0):
        flat(stripes, (x, x + 0.5), (-11.6, -8.4))
    flat(stripes, (0.15, 4.6), (-7.6, -7.2))
    flat(stripes, (-4.6, -0.15), (-12.8, -12.4))
    for z in np.arange(-18.0, -120.0, -6.0):
        flat(stripes, (-0.06, 0.06), (z - 3.0, z))
    for x, y, z in LAMPS_M:
        foot = 5.75 if x > 0 else -5.75
        masts.tube([(foot, 0, z), (foot, 3, z), (foot, y - 0.6, z), (0.85 * foot, y + 0.12, z), (x, y + 0.07, z)],
                   (0.09, 0.075, 0.06, 0.05, 0.05))  # fmt: skip
        boxes.box((x - 0.33, y + 0.05, z - 0.17), (x + 0.33, y + 0.13, z + 0.17))
    for x in (5.6, -5.6):
        boxes.tube([(x, 0, -12.45), (x, 3.4, -12.45)], (0.06, 0.06))
    for _, _, _, x, y, z in SIGNALS:
        signal_head(boxes, x, y, z)
    return {"pavement_shape": ("pavement", pavement), "stripes_shape": ("stripes", stripes),
            "masts": ("aluminium", masts), "boxes": ("shiny_black", boxes)}  # fmt: skip


def flat(mesh: Mesh, x: Sequence[float], z: Sequence[float]) -> None:
    """Paint on the road, which faces up."""
    (left, right), (far, near) = x, z
    height = 0.006
    mesh.quad(
        (left, height, near), (right, height, near), (right, height, far), (left, height, far)
    )


def signal_head(mesh: Mesh, x: float, y: float, z: float) -> None:
    """The case of a signal, its visors, and the aspects that are dark."""
    tall = 1.0 if y > 2.5 else 0.62
    mesh.box((x - 0.17, y + 0.2 - tall, z - 0.22), (x + 0.17, y + 0.2, z))
    for k in range(round(tall / 0.32)):
        middle = y - 0.32 * k
        arc = circle_arc(x, middle, 0.14)
        for a, b in zip(arc, arc[1:], strict=False):
            mesh.quad((*a, z), (*b, z), (*b, z + 0.2), (*a, z + 0.2))


def circle_arc(x: float, y: float, radius: float) -> list[tuple[float, float]]:
    """The upper two thirds of a circle."""
    angles = np.radians(np.linspace(-30, 210, 9))
    return [(x + radius * np.cos(a), y + radius * np.sin(a)) for a in angles]


def figures() -> dict[str, tuple[str, Mesh]]:
    """The person on the crossing, who walks to the left, and the trees."""
    pose = {"turn_deg": 180.0, "move": (0.95, 0.0, -9.7)}
    wood, leaves = Mesh(), Mesh()
    for number, (x, z) in enumerate(((6.9, -24.5), (6.9, -35.0), (-6.9, -27.0), (-6.9, -40.0))):
        trunk, crown = tree(number)
        wood.add(*trunk.moved(move=(x, 0.13, z)).arrays())
        leaves.add(*crown.moved(move=(x, 0.13, z)).arrays())
    return {
        "person_coat": ("wool", coat().moved(**pose)), "person_legs": ("black", legs().moved(**pose)),
        "person_head": ("skin", head().moved(**pose)), "person_umbrella": ("umbrella_cloth", umbrella().moved(**pose)),
        "person_stick": ("black", umbrella_stick().moved(**pose)),
        "trunks": ("wood", wood), "leaves": ("leaf", leaves),
    }  # fmt: skip


def cars() -> dict[str, tuple[str, Mesh]]:
    """The car that comes, part by part because each moves by its id, and two that are parked."""
    parts = {
        "car_body": ("silver_paint", car_body().moved(move=CAR_M)),
        "car_glass": ("glass", car_glass().moved(move=CAR_M)),
        "car_dark": ("shiny_black", car_dark_parts().moved(move=CAR_M)),
    }
    for name, place in wheels_m().items():
        parts[f"car_tyre_{name}"] = ("black", tyre().moved(move=place))
        parts[f"car_rim_{name}"] = ("aluminium", rim().moved(move=place))
    body, dark, glass, parked_rims = Mesh(), Mesh(), Mesh(), Mesh()
    for x, z in ((4.0, -26.0), (4.05, -32.5), (4.0, -50.0)):
        pose = {"turn_deg": 180.0, "move": (x, 0, z)}
        body.add(*car_body().moved(**pose).arrays())
        glass.add(*car_glass().moved(**pose).arrays())
        dark.add(*car_dark_parts().moved(**pose).arrays())
        for z_axle in AXLES_Z_M:
            for side in (-1, 1):
                wheel = (x + side * TRACK_X_M, WHEEL_RADIUS_M, z + z_axle)
                dark.add(*tyre().moved(move=wheel).arrays())
                parked_rims.add(*rim().moved(move=wheel).arrays())
    return parts | {
        "parked_bodies": ("blue_paint", body), "parked_glass": ("glass", glass),
        "parked_dark": ("shiny_black", dark), "parked_rims": ("aluminium", parked_rims),
    }  # fmt: skip


def wheels_m() -> dict[str, np.ndarray]:
    """Middles of the wheels of the car that comes."""
    found = {}
    for end, z in zip(("front", "rear"), AXLES_Z_M, strict=True):
        for side, x in (("left", TRACK_X_M), ("right", -TRACK_X_M)):
            found[f"{end}_{side}"] = np.array(CAR_M) + (x, WHEEL_RADIUS_M, z)
    return found


SMOOTH = {"car_body", "parked_bodies", "person_coat", "person_legs", "person_head", "masts"}


def meshes() -> dict[str, tuple[str, Mesh]]:
    """Material and mesh of everything that does not shine, by the name of its file."""
    built = houses()
    found = {f"houses_{name}": (HOUSE_MATERIALS[name], built[name]) for name in HOUSE_MATERIALS}
    return found | street() | figures() | cars()


# --- the files --------------------------------------------------------------------------------

HEAD = """<?xml version="1.0" encoding="utf-8"?>
<!-- Night crossing: a wet street late in the evening. LED street lamps, a traffic light, a car that comes, lit windows,
     the Moon, a person with an umbrella in the dark: about 130 dB from the headlights to the darkest things.
     Written by make_night_crossing.py.

     mitsuba-sensor render scenes/night_crossing.xml -o out/      the second picture of the README

     The ids of the emitters make groups: sky and moon; lamp_*; headlight_*; signal_*; window_*. night_crossing.toml
     moves the car with its wheels and lights. -->
<scene version="3.0.0">
    <!-- Columns and rows of the film: a window of the camera's pixels. -->
    <default name="width" value="384"/>
    <default name="height" value="256"/>
    <!-- How long the shutter is open [s]. -->
    <default name="exposure_s" value="0.025"/>
    <!-- Focal length over pupil diameter. -->
    <default name="f_number" value="1.4"/>
    <!-- Voltage at which the converter is full [V]. -->
    <default name="full_scale_v" value="0.2677"/>

    <integrator type="path">
        <integer name="max_depth" value="16"/>
    </integrator>

    <sensor type="camera">
        <float name="focal_length_mm" value="3.1"/>
        <float name="f_number" value="$f_number"/>
        <string name="scene_unit" value="m"/>
        <transform name="to_world"><lookat origin="3.2, 1.4, 0" target="1.121, 1.1, -9.781" up="0, 1, 0"/></transform>
        <film type="photosensor">
            <string name="camera" value="sony_a7s2"/>
            <float name="adc.full_scale_v" value="$full_scale_v"/>
            <float name="source_follower.read_noise_e" value="1.284"/>
            <float name="exposure_s" value="$exposure_s"/>
            <integer name="width" value="$width"/>
            <integer name="height" value="$height"/>
        </film>
        <sampler type="multijitter"/>
    </sensor>

"""


def scene() -> str:
    """The text of night_crossing.xml."""
    text = HEAD + "    <!-- Materials: reflectances from 300 to 1100 nm. -->\n" + materials()
    text += "\n    <!-- Sky and Moon. -->\n" + sky_and_moon()
    text += "\n    <!-- Street lamps: LEDs of about 3000 K. -->\n" + lamps()
    text += (
        "\n    <!-- The headlights: what is seen of each lamp, and its beam. -->\n"
        + headlights()
    )
    text += "\n    <!-- The traffic light. -->\n" + signals()
    text += "\n    <!-- Windows. -->\n" + lit_windows()
    text += "\n    <!-- The street. -->\n"
    text += (
        '    <shape type="rectangle" id="road_shape"><transform name="to_world"><rotate x="1" angle="-90"/>'
        '<scale x="90" z="90"/><translate z="-70"/></transform><ref id="road"/></shape>\n'
    )
    text += "".join(
        mesh(name, material, smooth=name in SMOOTH) for name, (material, _) in meshes().items()
    )
    return text + "</scene>\n"


def motion() -> str:
    """The text of night_crossing.toml: the car comes, and its wheels roll."""
    speed = vector((0, 0, CAR_M_PER_S)).join("[]")
    moving = ["car_body", "car_glass", "car_dark"]
    moving += [f"headlight_{k}_shape" for k in range(1, len(HEADLIGHTS_X_M) + 1)]
    text = (
        "# How the car of night_crossing.xml comes: 4 m/s along +z, and its wheels roll. Time 0 is when the first row\n"
        "# of the film opens; lengths are metres.\n"
    )
    text += "".join(f"\n[objects.{name}]\nvelocity_m_per_s = {speed}\n" for name in moving)
    turn = np.degrees(CAR_M_PER_S / WHEEL_RADIUS_M)
    for name, place in wheels_m().items():
        for part in ("tyre", "rim"):
            text += (
                f"\n[objects.car_{part}_{name}]\nvelocity_m_per_s = {speed}\nrotate_deg_per_s = {turn:.5g}\n"
                f"axis = [1, 0, 0]\npivot_m = [{vector(place)}]\n"
            )
    return text


def write(folder: Path) -> None:
    """Write all files below this folder."""
    parts = folder / PARTS
    parts.mkdir(parents=True, exist_ok=True)
    (folder / "night_crossing.xml").write_text(scene(), encoding="utf-8")
    (folder / "night_crossing.toml").write_text(motion(), encoding="utf-8")
    built = houses()
    for name, *_ in WINDOWS:
        (parts / f"{name}_shape.ply").write_bytes(built[f"{name}_shape"].ply())
    for name, (_, shape) in meshes().items():
        (parts / f"{name}.ply").write_bytes(shape.ply())
    write_png(parts / "puddles.png", np.rint(255 * puddles()).astype(np.uint8))
    write_png(parts / "asphalt.png", np.rint(255 * asphalt_relief()).astype(np.uint8))
    sky = evening_sky()
    write_planes(
        parts / "sky.exr", {}, {c: Plane(sky[..., k], 1.0) for k, c in enumerate("RGB")}
    )


if __name__ == "__main__":
    write(HERE)
