"""Point spread of displaced rays against closed forms: slanted edges, encircled energy, flat fields.

Random tests fix their seeds.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import scipy
from helpers.marks import exhaustive
from helpers.scenes import SKY, scene_text, skip_unless_usable, write_scene
from helpers.slanted_edge import edge_picture, frequency_response

import mitsuba_sensor as ms
from mitsuba_sensor.core import Float64Array
from mitsuba_sensor.optics.image_record import image_record
from mitsuba_sensor.optics.point_spread import (
    diffraction_mtf,
    encircled_energy,
    first_zero,
)
from mitsuba_sensor.render.denoise.guides import trace_guides
from mitsuba_sensor.render.light.bands import box_bands
from mitsuba_sensor.render.load.scene import Scene, load_scene
from mitsuba_sensor.render.motion.aovs import render_aovs
from mitsuba_sensor.render.variants import choose_variant, mitsuba, use

LLVM = "llvm_ad_spectral"
PITCH_UM = 3.45
SHAPE = 128, 64
"""Rows and columns of the picture of an edge."""
ANGLE_DEG = math.degrees(math.atan(1 / 16))
"""Rows of 16 phases, four of each bin of the estimator, which then has no error of its own."""
FOV_DEG = 2.0
HALF_PLANE = (
    '<shape type="rectangle"><transform name="to_world"><translate x="1"/><scale value="400"/>'
    f'<rotate y="1" angle="180"/><rotate z="1" angle="{ANGLE_DEG}"/><translate z="100"/></transform>'
    '<emitter type="area"><spectrum name="radiance" value="300:1e-3, 1100:1e-3"/></emitter>'
    "</shape>"
)
THIN = '<float name="aperture_radius" value="0.01"/><float name="focus_distance" value="5"/>'


def camera(**fields: Any) -> ms.Camera:
    usual = {"pixel.pitch_x_um": PITCH_UM, "pixel.pitch_y_um": PITCH_UM, "pixel.fill_factor": 1}
    named = {name.replace("__", "."): value for name, value in fields.items()}
    spread = {"lens.diffraction": True}
    return ms.load_camera("konnik_table1").replace(**{**usual, **spread, **named})


def load(
    folder: Path,
    cam: ms.Camera,
    edges_nm: list[float],
    *elements: str,
    kind: str = "perspective",
    more: str = "",
    shape: tuple[int, int] = SHAPE,
    variant: str = LLVM,
) -> Scene:
    use(choose_variant(skip_unless_usable(variant)))
    size = (
        f'<integer name="width" value="{shape[1]}"/><integer name="height" value="{shape[0]}"/>'
    )
    sensor = (
        f'<sensor type="{kind}"><float name="fov" value="{FOV_DEG}"/>{{more}}'
        f'<film type="hdrfilm">{size}{{film}}</film></sensor>'
    )
    text = scene_text('<integrator type="direct"/>', *elements, sensor=sensor, more=more)
    return load_scene(write_scene(folder, text), box_bands(cam, np.array(edges_nm)), {}, cam)


def picture(scene: Scene, samples: int, passes: int = 1) -> Float64Array:
    """Mean of some passes, (rows, columns, bands)."""
    rows = 0, scene.view.crop_size[1]
    total = np.zeros(())
    for number in range(passes):
        total = total + scene.render(number + 1, samples, rows).astype(np.float64)
    return np.asarray(total / passes)


def expected_response(f_number: float, wavelength_nm: float, side: float = 1.0) -> Float64Array:
    """Response to the edge of a pixel with this side and a lens at this f-number, 0 without diffraction: of the picture
    that the product of the closed forms makes, by the same estimator, whose window cuts off the far tail."""
    angle = math.radians(ANGLE_DEG)

    def mtf(frequency: Float64Array) -> Float64Array:
        pixel = np.sinc(frequency * math.cos(angle) * side) * np.sinc(
            frequency * math.sin(angle) * side
        )
        return pixel * diffraction_mtf(frequency * wavelength_nm * 1e-3 * f_number / PITCH_UM)

    return frequency_response(edge_picture(mtf, SHAPE, ANGLE_DEG))


@pytest.mark.parametrize(
    ("f_number", "wavelength_nm", "samples", "tolerance"),
    [
        (8.0, 550.0, 256, 0.02),
        *(
            exhaustive(f, nm, 4096, 0.007)
            for f, nm in ((4.0, 450.0), (16.0, 650.0), (22.0, 550.0))
        ),
    ],
)
def test_edges_have_the_response_of_lens_times_pixel(
    tmp_path: Path, f_number: float, wavelength_nm: float, samples: int, tolerance: float
) -> None:
    """Up to the Nyquist frequency, where 2048 samples have a noise of 0.003 and 256 samples of 0.008; without
    displacement the response is 0.64."""
    edges_nm = [wavelength_nm - 0.5, wavelength_nm + 0.5]
    scene = load(tmp_path, camera(lens__f_number=f_number), edges_nm, HALF_PLANE)
    found = frequency_response(picture(scene, 256, samples // 256)[..., 0])
    expected = expected_response(f_number, wavelength_nm)
    np.testing.assert_allclose(found, expected, atol=tolerance)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("aperture", "response"), [("square", 0.900), ("full", 0.637)])
def test_a_square_of_a_quarter_of_the_pixel_has_0_9_at_nyquist(
    tmp_path: Path, aperture: str, response: float
) -> None:
    """sinc(ν/2) and sinc(ν) at half a cycle per pixel."""
    cam = camera(pixel__fill_factor=0.25, pixel__aperture=aperture, lens__diffraction=False)
    light = picture(load(tmp_path, cam, [549.5, 550.5], HALF_PLANE), 256)
    assert frequency_response(light[..., 0])[-1] == pytest.approx(response, abs=0.02)


LOPSIDED = [[0.1, 0.3, 0.6, 0.2], [0.4, 1.0, 0.9, 0.3], [0.2, 0.8, 0.5, 0.0]]
"""A sensitivity within the pixel of three rows and four columns."""


@pytest.mark.exhaustive
def test_an_edge_has_the_response_of_a_map_of_the_sensitivity_within_the_pixel(
    tmp_path: Path,
) -> None:
    """The modulus of the map's own transform across the edge, through the same estimator, within 0.007 up to the
    Nyquist frequency; a full pixel is off by 0.07 there."""
    cam = camera(pixel__aperture=LOPSIDED, lens__diffraction=False)
    light = picture(load(tmp_path, cam, [549.5, 550.5], HALF_PLANE), 256, 4)
    found, angle = frequency_response(light[..., 0]), math.radians(ANGLE_DEG)
    rows, columns = np.shape(LOPSIDED)
    y, x = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns)
    across = x.T * math.cos(angle) + y.T * math.sin(angle)

    def mtf(frequency: Float64Array) -> Float64Array:
        waves = np.exp(-2j * math.pi * np.multiply.outer(frequency, across))
        cell = np.sinc(frequency * math.cos(angle) / columns)
        cell = cell * np.sinc(frequency * math.sin(angle) / rows)
        return np.abs((waves * LOPSIDED).sum(axis=(1, 2)) / np.sum(LOPSIDED) * cell)

    expected = frequency_response(edge_picture(mtf, SHAPE, ANGLE_DEG))
    np.testing.assert_allclose(found, expected, atol=0.007)
    full = frequency_response(edge_picture(np.sinc, SHAPE, ANGLE_DEG))
    assert found[-1] - full[-1] > 0.05


def test_rays_start_in_each_cell_as_often_as_it_is_sensitive(tmp_path: Path) -> None:
    """χ² of 300 000 rays over cells of half the size: chance fails it once in 100 000 times."""
    cam = camera(pixel__aperture=LOPSIDED, lens__diffraction=False)
    scene = load(tmp_path, cam, [549.5, 550.5], SKY)
    rng, mi = np.random.default_rng(4), mitsuba()
    place = np.array([[28.0], [60.0]]) + 8 * rng.random((2, 300_000))  # of whole pixels
    on_film = [mi.Float(x / size) for x, size in zip(place, (SHAPE[1], SHAPE[0]), strict=True)]
    wavelength = mi.Float(rng.random(300_000))
    samples = wavelength, mi.Point2f(*on_film), mi.Point2f(0.5)
    dx, dy, _, weights = displacements(scene, samples)
    x, y = (place - [dx, dy]) % 1  # the camera looks along z, with x to the left
    counts, _, _ = np.histogram2d(y, x, bins=(6, 8), range=((0, 1), (0, 1)))
    expected = np.repeat(np.repeat(LOPSIDED, 2, axis=0), 2, axis=1)
    expected *= counts.sum() / expected.sum()
    lit = expected > 0
    assert counts[~lit].sum() < 300  # beside a lit cell, by float32 positions on its edge
    expected *= counts[lit].sum() / expected.sum()
    assert scipy.stats.chisquare(counts[lit], expected[lit]).pvalue > 1e-5
    np.testing.assert_allclose(weights, 1, rtol=1e-5)


@pytest.mark.exhaustive
def test_the_wavelengths_of_a_ray_have_each_their_own_response(tmp_path: Path) -> None:
    """Bands of 30 nm at both ends of 400 to 700 nm, which share rays: 0.25 and 0.07 at Nyquist's frequency. Without the
    weights both are 0.16."""
    cam, edges_nm = camera(lens__f_number=8.0), [400.0, 430.0, 670.0, 700.0]
    light = picture(load(tmp_path, cam, edges_nm, HALF_PLANE), 1024, 2)
    for band, wavelength_nm in ((0, 415.0), (2, 685.0)):
        found, expected = (
            frequency_response(light[..., band]),
            expected_response(8.0, wavelength_nm),
        )
        np.testing.assert_allclose(found, expected, atol=0.03)


def random_samples(count: int, seed: int) -> tuple[Any, ...]:
    """Wavelength, position around the middle of the film and aperture of rays."""
    mi, rng = mitsuba(), np.random.default_rng(seed)
    numbers = [mi.Float(column) for column in rng.random((5, count), dtype=np.float32)]
    place = mi.Point2f(0.45 + 0.1 * numbers[1], 0.45 + 0.1 * numbers[2])
    return numbers[0], place, mi.Point2f(numbers[3], numbers[4])


def displacements(
    scene: Scene, samples: tuple[Any, ...]
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """dx and dy (n,) [pixels], wavelengths (4, n) [nm] and weights (4, n) over those of the rays that stay: how far
    apart both meet the plane in focus."""
    wavelength, place, aperture = samples
    near = 5.0 if math.isinf(scene.view.focus_m) else scene.view.focus_m
    at, weights = [], []
    for sensor in (scene.sensor, scene.sharp):
        ray, weight = sensor.sample_ray(0.0, wavelength, place, aperture)
        along = near / ray.d.z
        at.append(
            [np.array(o + along * d) for o, d in ((ray.o.x, ray.d.x), (ray.o.y, ray.d.y))]
        )
        weights.append(np.array(weight, dtype=float))
        lengths = np.array(ray.wavelengths, dtype=float)
    scale = near * scene.view.tangent_per_pixel
    dx, dy = ((a - b) / scale for a, b in zip(*at, strict=True))
    passed = np.where((weights[0] > 0) & (weights[1] > 0), weights[1], np.nan)
    return dx, dy, lengths, weights[0] / passed


@pytest.mark.parametrize(("kind", "more"), [exhaustive("perspective", ""), ("thinlens", THIN)])
def test_airy_disk_has_83_8_percent_at_each_wavelength(
    tmp_path: Path, kind: str, more: str
) -> None:
    """A million rays from 400 to 700 nm, inside 1.22·λN and inside the second dark ring, by the weight of each
    wavelength: standard error 0.05 %, held to 0.3 %."""
    scene = load(
        tmp_path, camera(lens__f_number=8.0), [400, 550, 700], SKY, kind=kind, more=more
    )
    dx, dy, lengths_nm, weights = displacements(scene, random_samples(1_000_000, 1))
    working = 8.0 * (1.0 if kind == "perspective" else 1 + image_over_focus(scene))
    x = math.pi * np.hypot(dx, dy) * PITCH_UM * 1e3 / (lengths_nm * working)
    for zero in scipy.special.jn_zeros(1, 2):
        inside = (weights * (x < zero)).mean()
        assert inside == pytest.approx(float(encircled_energy(zero)), abs=0.003)
    density, edges = np.histogram(x[0], bins=np.arange(2.5, 5.5, 0.02))
    middles = (edges[1:] + edges[:-1]) / 2
    near = np.abs(middles - 3.83) < 0.7
    curve = np.polynomial.Polynomial.fit(middles[near], density[near] / middles[near], 4)
    fine = np.linspace(3.3, 4.4, 1101)
    assert fine[np.argmin(curve(fine))] == pytest.approx(first_zero(), rel=0.01)


def image_over_focus(scene: Scene) -> float:
    half_m = 0.5 * scene.view.size[0] * PITCH_UM * 1e-6
    return half_m / scene.view.half_width / scene.view.focus_m


@pytest.mark.parametrize(("kind", "more"), [exhaustive("perspective", ""), ("thinlens", THIN)])
def test_draws_are_independent_of_what_else_a_ray_has(
    tmp_path: Path, kind: str, more: str
) -> None:
    """Share of the energy and direction of a million draws, at points of regular grids as a stratified sampler makes
    them, against position in the pixel, aperture and wavelength: χ² of 16 × 16 cells. One of 20 tests fails by chance
    once in 50 000. A pinhole takes the numbers of its aperture, which mean nothing else."""
    scene = load(
        tmp_path, camera(lens__f_number=8.0), [549.5, 550.5], SKY, kind=kind, more=more
    )
    mi, count = mitsuba(), 2**20
    number, rng = np.arange(count), np.random.default_rng(2)
    grid = [((number >> (4 * k)) % 16 + rng.random(count)) / 16 for k in range(5)]
    columns = [mi.Float(column.astype(np.float32)) for column in grid]
    place = mi.Point2f((30 + columns[1]) / SHAPE[1], (60 + columns[2]) / SHAPE[0])
    samples = columns[0], place, mi.Point2f(columns[3], columns[4])
    dx, dy, lengths_nm, _ = displacements(scene, samples)
    working = 8.0 if kind == "perspective" else 8.0 * (1 + image_over_focus(scene))
    x = math.pi * np.hypot(dx, dy) * PITCH_UM * 1e3 / (lengths_nm[0] * working)
    share, turn = encircled_energy(x), np.arctan2(dy, dx) / (2 * math.pi) % 1
    near = x < 20  # where the radius says the share; float32 positions cost its last digits
    others = grid[:3] if kind == "perspective" else grid
    for drawn in (share, turn):
        for other in others:
            table = np.histogram2d(drawn[near], other[near], bins=(16, 16))[0]
            chance = scipy.stats.chi2_contingency(table).pvalue
            assert chance > 1e-6
    assert abs(np.corrcoef(share[near], turn[near])[0, 1]) < 5 / math.sqrt(count)


@pytest.mark.parametrize(("kind", "more"), [("perspective", ""), ("thinlens", THIN)])
def test_a_flat_field_stays_the_same_in_the_mean(tmp_path: Path, kind: str, more: str) -> None:
    """Three bands of 100 nm that share rays, 300 000 of them: the weights add 0.4 of noise to each ray's share of a
    band, so 0.1 % to the mean, held to 0.5 %; the sum of the bands has hardly any noise."""
    scene = load(
        tmp_path, camera(), [400, 500, 600, 700], SKY, kind=kind, more=more, shape=(16, 16)
    )
    light = picture(scene, 1024) / (2e-4 * 100)
    np.testing.assert_allclose(light.mean(axis=(0, 1)), 1.0, atol=0.005)
    np.testing.assert_allclose(light.sum(axis=2).mean() / 3, 1.0, atol=0.001)


def test_rays_of_a_crop_see_what_is_beyond_its_edge(tmp_path: Path) -> None:
    """At f/22 the picture of a crop of eight columns beside an edge is that part of the whole picture within five
    standard errors of its mean, although the edge is outside of it."""
    cam, means = camera(lens__f_number=22.0), []
    crop = (
        '<integer name="crop_width" value="8"/><integer name="crop_height" value="8"/>'
        '<integer name="crop_offset_x" value="20"/><integer name="crop_offset_y" value="4"/>'
    )
    for film in ("", crop):
        use(choose_variant(skip_unless_usable(LLVM)))
        size = f'<integer name="width" value="64"/><integer name="height" value="16"/>{film}'
        film_text = f'<film type="hdrfilm">{size}</film>'
        fov = f'<float name="fov" value="{FOV_DEG}"/>'
        sensor = f'<sensor type="perspective">{fov}{film_text}</sensor>'
        text = scene_text('<integrator type="direct"/>', HALF_PLANE, sensor=sensor)
        scene = load_scene(
            write_scene(tmp_path, text), box_bands(cam, np.array([549.5, 550.5])), {}, cam
        )
        light = picture(scene, 1024)[..., 0] * 1e3
        means.append(light.mean() if film else light[4:12, 20:28].mean())
    share = means[0]
    assert share > 0.005  # of light that comes from the other side of the edge
    error = math.sqrt(2 * share / (64 * 1024))
    assert means[1] == pytest.approx(share, abs=5 * error)


def test_depth_and_the_other_aovs_are_not_displaced(tmp_path: Path) -> None:
    use(choose_variant(skip_unless_usable(LLVM)))
    found = [
        render_aovs("cornell_box", camera(lens__diffraction=on), width=24).depth_m
        for on in (False, True)
    ]
    np.testing.assert_array_equal(*found)


def test_guides_of_the_denoiser_are_as_blurred_as_the_picture(tmp_path: Path) -> None:
    """Normals of the half-plane over their value far from the edge, at f/22 and 550 nm: the edge's own profile, in
    columns averaged over rows of no slant; without displacement it would be a step."""
    cam = camera(lens__f_number=22.0)
    upright = HALF_PLANE.replace(f'angle="{ANGLE_DEG}"', 'angle="0"')
    scene = load(tmp_path, cam, [549.5, 550.5], upright, shape=(32, 64))
    normals = trace_guides(scene, np.full((1, 4), 550.0), 1, 256, (0, 32))[..., -1]
    profile = np.abs(normals).mean(axis=0)

    def mtf(frequency: Float64Array) -> Float64Array:
        lens = diffraction_mtf(frequency * 0.55 * 22 / PITCH_UM)
        return np.sinc(frequency) * lens

    expected = edge_picture(mtf, (32, 64), 0.0).mean(axis=0)
    np.testing.assert_allclose(profile, expected, atol=0.03)
    assert 0.05 < profile[30] < 0.4


@pytest.mark.parametrize("aperture", ["square", [[0, 1], [1, 0]]])
def test_a_scalar_variant_traces_the_same_rays_slowly_and_says_so(
    tmp_path: Path, aperture: Any
) -> None:
    """The same numbers of a ray give the same ray within rounding in both variants."""
    rays = []
    for variant in ("scalar_spectral", LLVM):
        cam = camera(lens__f_number=22.0, pixel__fill_factor=0.25, pixel__aperture="full")
        cam = cam.replace(**{"pixel.aperture": aperture, "pixel.fill_factor": 0.5})
        scene = load(
            tmp_path, cam, [400, 500], SKY, kind="thinlens", more=THIN, variant=variant
        )
        mi = mitsuba()
        ray, weight = scene.sensor.sample_ray(
            0.0, 0.25, mi.Point2f(0.25, 0.375), mi.Point2f(0.5, 0.125)
        )
        rays.append(np.concatenate([np.ravel(ray.d), np.ravel(weight)]))
        assert any("0.1 ms per ray" in note for note in scene.notes) == (variant != LLVM)
    np.testing.assert_allclose(*rays, rtol=1e-4, atol=1e-6)


@pytest.mark.exhaustive
def test_a_sequential_lens_has_the_disk_of_its_f_number(tmp_path: Path) -> None:
    """The double Gauss at f/16, focused at 5 m: rays around the middle of the film meet the plane in focus within
    λN/pitch of where they would without diffraction, with 84 % of the energy in the disk; 2 % for its aberrations."""
    cam = camera(lens__f_number=16.0, lens__prescription="double_gauss", lens__focus_m=5.0)
    scene = load(tmp_path, cam, [549.5, 550.5], SKY)
    dx, dy, lengths_nm, weights = displacements(scene, random_samples(300_000, 3))
    lit = np.isfinite(weights[0]) & np.isfinite(dx)
    working = 16 * (1 + 50.0 / (5000 - 50.0))
    x = math.pi * np.hypot(dx, dy)[lit] * PITCH_UM * 1e3 / (lengths_nm[0][lit] * working)
    assert np.mean(x < first_zero()) == pytest.approx(0.838, abs=0.02)


@pytest.mark.parametrize("rendered", [True, False])
def test_the_record_of_a_render_has_the_disk_of_the_working_f_number(
    tmp_path: Path, rendered: bool
) -> None:
    """2.44 λN_w of a thin lens that is focused at 0.5 m, with diffraction or without; the double Gauss within 1 %."""
    lens: dict[str, Any] = {"lens__prescription": "double_gauss", "lens__focus_m": 0.5}
    cam = camera(lens__f_number=4.0, lens__diffraction=rendered, **lens)
    record = image_record(load(tmp_path, cam, [549.5, 550.5], SKY).view, cam)
    disk, spread = cast(dict[str, Any], record["airy_disk"]), record["point_spread"]
    working = 4 * (1 + 50.0 / (500 - 50.0))
    assert disk["diameter_px"] == pytest.approx(2.44 * 0.55 * working / PITCH_UM, rel=0.01)
    assert disk["rendered"] is rendered and (spread is not None) is rendered
