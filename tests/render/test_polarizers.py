"""Light behind a polariser mosaic against Fresnel's and Malus's laws, and against Mitsuba's Stokes vectors.

Seeds are fixed. The chance of a false alarm is stated where a bound is statistical.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.scenes import skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array
from mitsuba_sensor.render.lint.built_checks import DEPOLARISING
from mitsuba_sensor.render.motion.aovs import render_aovs
from mitsuba_sensor.render.variants import mitsuba

LLVM = "llvm_ad_spectral"
POLARIZED = "llvm_ad_spectral_polarized"
ANGLES_DEG = ((90, 45), (135, 0))
PLAIN = ms.load_camera("konnik_table1").replace(**{"pixel.fill_factor": 1})
MOSAIC = PLAIN.replace(**{"sensor.polarizers": ANGLES_DEG, "sensor.extinction_ratio": 1e6})
EXPOSURE = ms.Exposure(0.01)
FEW: Any = {"spp": 16, "wavelength_nm": 550, "denoise": False, "progress": False}
UNIFORM = '<spectrum name="radiance" value="5e-3"/>'
FILM = (
    '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="{}"/>{}'
    '<rfilter type="box"/></film>'
)
GLASS = (
    '<shape type="rectangle"><transform name="to_world"><scale value="99"/></transform>'
    '<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>'
)
BLACK = (
    '<shape type="rectangle"><transform name="to_world"><scale value="999"/><translate z="-1"/></transform>'
    '<bsdf type="diffuse"><spectrum name="reflectance" value="0"/></bsdf></shape>'
)


@pytest.fixture(autouse=True)
def variant() -> None:
    mitsuba().set_variant(skip_unless_usable(LLVM))


def scene(
    *elements: str,
    origin: Any = (0, 0, 5),
    up: Any = (0, 1, 0),
    fov: float = 1.0,
    size: tuple[int, int] = (32, 24),
    crop: str = "",
    depth: int = 6,
    target: Any = (0, 0, 0),
) -> str:
    """An evenly lit scene that a camera looks at."""
    place = " ".join(
        f'{name}="{point[0]:.9g}, {point[1]:.9g}, {point[2]:.9g}"'
        for name, point in (("origin", origin), ("target", target), ("up", up))
    )
    return (
        f'<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>'
        f'<emitter type="constant">{UNIFORM}</emitter>{"".join(elements)}<sensor type="perspective">'
        f'<float name="fov" value="{fov}"/><transform name="to_world"><lookat {place}/></transform>'
        f"{FILM.format(*size, crop)}</sensor></scene>"
    )


def plate(angle_deg: float = 0.0, kind: str = "polarizer", height: float = 0.0) -> str:
    axis = f'<spectrum name="theta" value="{angle_deg}"/>' if kind == "polarizer" else ""
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale value="9"/><translate z="{height}"/></transform>'
        f'<bsdf type="{kind}">{axis}</bsdf></shape>'
    )


def floor_seen_at(incidence_deg: float, roll_deg: float = 0.0, **more: Any) -> str:
    """A glass plate above a black floor; the camera is rolled clockwise about its axis."""
    incidence, roll = math.radians(incidence_deg), math.radians(roll_deg)
    upright = np.array([0.0, math.cos(incidence), math.sin(incidence)])
    up = math.cos(roll) * upright + math.sin(roll) * np.array([1.0, 0.0, 0.0])
    origin = (0.0, -5 * math.sin(incidence), 5 * math.cos(incidence))
    return scene(GLASS, BLACK, origin=origin, up=up, fov=0.5, **more)


def stokes(light: ms.Irradiance) -> Float64Array:
    """S0, S1/S0 and S2/S0 of the means behind each polariser."""
    image = light.data.sum(axis=-1, dtype=np.float64)
    at_90, at_45 = image[0::2, 0::2].mean(), image[0::2, 1::2].mean()
    at_135, at_0 = image[1::2, 0::2].mean(), image[1::2, 1::2].mean()
    s0 = (at_0 + at_45 + at_90 + at_135) / 4
    return np.array([s0, (at_0 - at_90) / 2 / s0, (at_45 - at_135) / 2 / s0])


def dolp(light: ms.Irradiance) -> float:
    return math.hypot(*stokes(light)[1:])


def aolp_deg(light: ms.Irradiance) -> float:
    _, s1, s2 = stokes(light)
    return math.degrees(math.atan2(s2, s1)) / 2


POLARISE = {"conductor", "dielectric", "polarizer", "pplastic", "roughconductor"}
UNPOLARISED = {"diffuse", "null", "retarder", "circular"}
"""Materials that leave unpolarised light without linear polarisation, in nature too. With those that lint names these
are all of Mitsuba 3.9.1, except those around others and measured ones, which need a file."""
OPTIONS = {
    "conductor": {"material": "Au"},
    "principledthin": {"spec_trans": 1.0},
    "roughconductor": {"material": "Au"},
}


def test_the_materials_that_depolarise_are_those_that_lint_names() -> None:
    """DoLP of what each material of Mitsuba makes of unpolarised light at Brewster's angle of n = 1.5, by 400 samples:
    0.08 for gold, above 0.9 for glass and pplastic, exactly 0 for those that lint names."""
    mi = mitsuba()
    mi.set_variant("scalar_spectral_polarized")
    random, angle = np.random.default_rng(1), math.atan(1.5)
    si = mi.SurfaceInteraction3f()
    si.t, si.wi, si.wavelengths = 1, [math.sin(angle), 0, math.cos(angle)], [550] * 4
    si.n, si.sh_frame = [0, 0, 1], mi.Frame3f([0, 0, 1])
    unpolarised = set[str]()
    for kind in {*DEPOLARISING} - {"measured"} | UNPOLARISED | POLARISE:
        material = mi.load_dict({"type": kind, **OPTIONS.get(kind, {})})
        total = np.zeros(3)
        for _ in range(400):
            sample = material.sample(mi.BSDFContext(), si, random.random(), random.random(2))
            total += np.array(sample[1])[:3, 0, 0]
        assert total[0] > 0, kind
        if math.hypot(*total[1:]) < 1e-6 * total[0]:
            unpolarised.add(kind)
    assert unpolarised == {*DEPOLARISING} - {"measured"} | UNPOLARISED


@pytest.mark.parametrize(
    ("incidence_deg", "expected", "samples", "tolerance"),
    [
        exhaustive(56.31, 1.0, 512, 0.002),
        exhaustive(70.0, 0.7516, 4096, 0.002),
        (70.0, 0.7516, 512, 0.006),
    ],
)
def test_glass_polarises_as_fresnel_says(
    incidence_deg: float, expected: float, samples: int, tolerance: float
) -> None:
    """Of 400 000 paths 9 or 17 % are reflected: a standard error of 0.14 % at 70°; none at 56.31°, where nothing passes
    one of the polarisers."""
    text = floor_seen_at(incidence_deg, depth=3)
    light = ms.render(text, MOSAIC, EXPOSURE, **{**FEW, "spp": samples})
    assert dolp(light) == pytest.approx(expected, rel=tolerance)
    assert aolp_deg(light) == pytest.approx(0, abs=0.4)


@pytest.mark.exhaustive
def test_it_is_the_light_of_mitsubas_stokes_vectors() -> None:
    """A ball of glass in a wide field of view of a rolled camera: the polarisers' pixels are S0 + S1 cos 2θ + S2 sin 2θ
    of Mitsuba's own integrator, within the noise of both, 2 % of S0 in the mean."""
    mi = mitsuba()
    mi.set_variant(POLARIZED)
    metal = '<bsdf type="conductor"><spectrum name="eta" value="1.5"/><spectrum name="k" value="0"/></bsdf>'
    ball = f'<shape type="sphere"><float name="radius" value="1.2"/>{metal}</shape>'
    view = {
        "origin": (0, -3, 1.5),
        "up": (0.4, 0, 1),
        "fov": 60.0,
        "size": (48, 32),
        "depth": 2,
    }
    text = scene(ball, **view)
    light, whole = (
        ms.render(text, camera, EXPOSURE, variant=POLARIZED, **{**FEW, "spp": 256})
        for camera in (MOSAIC, PLAIN)
    )
    inner = text.replace(
        '<integrator type="path">', '<integrator type="stokes"><integrator type="path">'
    )
    inner = inner.replace("</integrator>", "</integrator></integrator>", 1)
    image = np.array(mi.render(mi.load_string(inner), spp=256, seed=5), dtype=float)
    s0, s1, s2 = image[..., 3:].reshape(32, 48, 4, 3)[..., :3, 1].transpose(2, 0, 1)
    angles = np.radians(np.tile(ANGLES_DEG, (16, 24)))
    expected = 1 + (s1 * np.cos(2 * angles) + s2 * np.sin(2 * angles)) / s0
    off = light.data[..., 0] / whole.data[..., 0] - expected
    assert abs(off.mean()) < 0.01 and np.median(abs(off)) < 0.02
    assert np.ptp(expected) > 1.5


def test_a_circular_polariser_has_no_angle_and_no_light_is_negative() -> None:
    light = ms.render(scene(plate(kind="circular")), MOSAIC, EXPOSURE, **FEW)
    assert dolp(light) < 1e-4 and light.data.min() >= 0
    crossed = ms.render(scene(plate(0.0)), MOSAIC, EXPOSURE, **FEW)
    assert crossed.data.min() >= 0 and crossed.statistics.negative == 0
    assert dolp(crossed) == pytest.approx(1, abs=1e-5)


@pytest.fixture(scope="module")
def behind_plate() -> dict[str, ms.Irradiance]:
    """The light of a plate at 30° with and without a mosaic in the camera."""
    mitsuba().set_variant(skip_unless_usable(LLVM))
    text = scene(plate(30.0))
    return {
        name: ms.render(text, camera, EXPOSURE, **FEW)
        for name, camera in (("plain", PLAIN), ("mosaic", MOSAIC))
    }


def test_an_extinction_ratio_by_wavelength_is_that_of_each_band() -> None:
    points = MOSAIC.quantum_efficiency.wavelengths_nm
    ratios = np.interp(points, [500.0, 600.0], [3.0, 9.0])
    camera = MOSAIC.replace(**{"sensor.extinction_ratio": ratios.tolist()})
    one = {**FEW, "wavelength_nm": 510.0, "bandwidth_nm": 1.0}
    light = ms.render(scene(plate(30.0)), camera, EXPOSURE, **one)
    contrast = np.interp(510.0, points, (ratios - 1) / (ratios + 1))
    assert dolp(light) == pytest.approx(contrast, abs=1e-3)


def test_without_extinction_the_sensor_is_behind_a_grey_filter(
    behind_plate: dict[str, ms.Irradiance],
) -> None:
    """Half the photoelectrons of the camera without polarisers, for an extinction ratio of 1 all of τ_max."""
    grey = MOSAIC.replace(
        **{"sensor.extinction_ratio": 1.0, "sensor.polarizer_transmission": 0.5}
    )
    lights = {**behind_plate, "grey": ms.render(scene(plate(30.0)), grey, EXPOSURE, **FEW)}
    frames = {name: ms.expose(x, keep="photoelectrons") for name, x in lights.items()}
    total = frames["plain"].light.total.mean()
    assert frames["grey"].light.total.mean() == pytest.approx(total, rel=1e-5)
    # shot noise of 768 pixels with so many electrons is far below
    mean_e = frames["plain"].photoelectrons.mean()
    for name, camera in (("grey", grey), ("mosaic", MOSAIC)):
        assert frames[name].photoelectrons.mean() == pytest.approx(mean_e / 2, rel=2e-3)
        assert camera.qe(550) == pytest.approx(PLAIN.qe(550) / 2)


def test_colour_filters_and_polarisers_repeat_each_in_their_own_tile() -> None:
    """The 4 × 4 pattern of a colour polarisation sensor: 2 × 2 polarisers behind each filter of a Bayer pattern."""
    tile = np.repeat(np.repeat([["R", "G"], ["G", "B"]], 2, axis=0), 2, axis=1)
    camera = ms.load_camera("bayer_2mp").replace(
        **{
            "quantum_efficiency.tile": tile.tolist(),
            "sensor.polarizers": ANGLES_DEG,
            "sensor.extinction_ratio": 1e6,
        }
    )
    light = ms.render(scene(plate(30.0)), camera, EXPOSURE, **{**FEW, "wavelength_nm": None})
    frames = ms.expose(light.before_denoising(), keep="photoelectrons")
    means = frames.photoelectrons[0].reshape(6, 4, 8, 4).mean(axis=(0, 2))
    for rows in (slice(0, 2), slice(2, 4)):
        for columns in (slice(0, 2), slice(2, 4)):
            (at_90, at_45), (at_135, at_0) = means[rows, columns]
            total = at_0 + at_90
            angle = math.degrees(math.atan2(at_45 - at_135, at_0 - at_90)) / 2
            assert at_45 + at_135 == pytest.approx(total, rel=0.05)
            assert angle == pytest.approx(-30, abs=2)


@pytest.mark.exhaustive
@pytest.mark.parametrize("denoise", [False, True])
def test_denoising_keeps_the_polarisation(denoise: bool) -> None:
    """The picture of each polariser is denoised for itself, and keeps the sum of its light."""
    text = floor_seen_at(70.0, 20.0, size=(64, 48))
    light = ms.render(text, MOSAIC, EXPOSURE, **{**FEW, "spp": 64, "denoise": denoise})
    assert (light.statistics.denoised is not None) == denoise
    # five standard errors of 200 000 paths
    assert dolp(light) == pytest.approx(0.7516, abs=0.025)
    assert aolp_deg(light) == pytest.approx(20, abs=1)
    assert light.data.min() >= 0


def test_a_camera_without_polarisers_sees_all_light_of_a_scene_that_polarises(
    behind_plate: dict[str, ms.Irradiance],
) -> None:
    """Two polarisers at 60° pass a quarter of what one passes (Malus), in a variant that is chosen for the scene."""
    two = scene(plate(30.0), plate(90.0, height=-1.0))
    lights = behind_plate["plain"], ms.render(two, PLAIN, EXPOSURE, **FEW)
    assert lights[1].data.mean() / lights[0].data.mean() == pytest.approx(0.25, rel=1e-4)
    assert {light.statistics.variant for light in lights} == {POLARIZED}
    assert mitsuba().variant() == LLVM and lights[0].polarizers is None
    assert render_aovs(two, PLAIN).depth_m.shape == (24, 32)


def test_light_behind_polarisers_is_for_the_same_polarisers_at_the_same_place(
    behind_plate: dict[str, ms.Irradiance],
) -> None:
    light = behind_plate["mosaic"]
    other = MOSAIC.replace(**{"sensor.extinction_ratio": 5})
    for camera in (PLAIN, other):
        with pytest.raises(
            ms.InputError, match=f"another camera than {camera.name}; render it"
        ):
            ms.expose(light, camera)
    with pytest.raises(ms.InputError, match="move it by a multiple of 2 rows and 2 columns"):
        ms.expose(light, origin=(4, 3))
    assert ms.expose(light, origin=(4, 2)).digital.shape == (1, 24, 32)


def test_a_variant_that_does_not_follow_polarisation_is_refused_in_one_sentence() -> None:
    text = scene(plate(30.0))
    said = f"which {LLVM} does not follow; load and render the scene in variant '{POLARIZED}'"
    with pytest.raises(ms.InputError, match=f"konnik_table1 has polarisers, {said}"):
        ms.render(text, MOSAIC, EXPOSURE, variant=LLVM, **FEW)
    with pytest.raises(ms.InputError, match=f"'polarizer' acts on polarised light, {said}"):
        ms.render(text, PLAIN, EXPOSURE, variant=LLVM, **FEW)
    loaded = mitsuba().load_string(scene())
    with pytest.raises(ms.InputError, match=f"konnik_table1 has polarisers, {said}"):
        ms.render(loaded, MOSAIC, EXPOSURE, **FEW)


@pytest.mark.parametrize(
    "lens",
    one_in(
        3,
        [
            {"lens.diffraction": True},
            {"lens.distortion": [-0.2, 0, 0, 0, 0]},
            {"lens.prescription": "double_gauss", "lens.dispersion": True},
        ],
    ),
)
def test_every_lens_works_with_polarisers(lens: dict[str, Any]) -> None:
    """The polarisation of an even field is that of the plate, whatever the lens."""
    camera = MOSAIC.replace(**lens)
    light = ms.render(scene(plate(30.0)), camera, EXPOSURE, **{**FEW, "spp": 64})
    assert aolp_deg(light) == pytest.approx(-30, abs=0.5)
    assert dolp(light) == pytest.approx(1, abs=0.01)
