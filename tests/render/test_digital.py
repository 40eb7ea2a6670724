"""Digital numbers and likelihoods of images that Mitsuba has rendered, and their derivatives back into the scene.

Derivatives are compared with central differences of renders with equal random numbers; those of a scene have a seed of
their own, and the number of samples is such that their error is a third of the limit.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.expected_codes import bare_camera
from helpers.marks import one_in
from helpers.scenes import skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.render.variants import choose_variant, use

FILM = """<film type="photosensor"><string name="camera" value="{camera}"/>
<float name="exposure_s" value="{time_s}"/><integer name="width" value="16"/><integer name="height" value="12"/>{more}
</film>"""
SCENE = """<scene version="3.0.0"><integrator type="{integrator}"/>
<sensor type="camera"><float name="focal_length_mm" value="{focal_mm}"/>{lens}{film}</sensor>{world}</scene>"""
BALL = """<shape type="sphere" id="ball"><point name="center" value="0, 0, 4"/><bsdf type="diffuse">
<spectrum name="reflectance" value="0.5"/></bsdf></shape>
<emitter type="constant" id="sky"><spectrum name="radiance" value="2e-4"/></emitter>"""
GREEN = '<float name="wavelength_nm" value="550"/>'
CROP = """<integer name="crop_width" value="7"/><integer name="crop_height" value="5"/>
<integer name="crop_offset_x" value="3"/><integer name="crop_offset_y" value="2"/>"""
QE = 0.6  # of konnik_table1
INTEGRATORS = "prb", "prb_basic", "prbvolpath", "direct_projective", "prb_projective"


def ready(variant: str = "llvm_ad_spectral") -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


def text_of(
    *,
    integrator: str = "prb",
    camera: str = "bayer_2mp",
    time_s: float = 0.002,
    more: str = GREEN,
    focal_mm: float = 0.05,
    lens: str = "",
    world: str = BALL,
) -> str:
    film = FILM.format(camera=camera, time_s=time_s, more=more)
    return SCENE.format(
        integrator=integrator, focal_mm=focal_mm, lens=lens, film=film, world=world
    )


def sum_of(values: Any) -> Any:
    """A sum in which no two columns weigh the same."""
    dr = drjit()
    columns = values.shape[1]
    weights = np.tile(0.3 + np.arange(columns) / columns, (values.shape[0], 1))
    return dr.sum(values.array * type(values.array)(weights.ravel().astype(np.float32)))


def compare(loss: Callable[[Any, int], Any], value: float, step: float, samples: int) -> None:
    """A derivative and a central difference, of four times the samples, within 1 %."""
    mi, dr = ready(), drjit()
    high, low = (
        float(loss(mi.Float(value + sign * step), 4 * samples).numpy()[0]) for sign in (1, -1)
    )
    variable = mi.Float(value)
    dr.enable_grad(variable)
    dr.backward(loss(variable, samples))
    assert float(dr.grad(variable).numpy()[0]) == pytest.approx(
        (high - low) / (2 * step), rel=0.01
    )


FILMS = [
    ("konnik_table1", ""),
    ("bayer_2mp", '<float name="bandwidth_nm" value="100"/>' + CROP),
    ("bayer_2mp", '<string name="spectral" value="channels"/>'),
    ("bayer_2mp", GREEN),
]


@pytest.mark.parametrize("case", one_in(4, FILMS))
def test_the_digital_numbers_are_those_of_a_capture(case: tuple[str, str]) -> None:
    """Of bands, channels, Bayer tiles and crops: the sampled codes have the random numbers of ``expose``, so that most
    agree in a light of 2000 samples; and the expected ones are the mean of frames, within 5 standard errors and the 2 %
    of the render: chance fails 400 pixels once in 4000 seeds."""
    mi = ready()
    camera, more = case
    text = text_of(camera=camera, more=more)
    scene = mi.load_string(text)
    image = mi.render(scene, spp=2000, seed=3)
    sensor = scene.sensors()[0]
    options: Any = {"spp": 2000, "denoise": False, "engine": "numpy"}
    codes = ms.capture(text, frames=100, **options).frames.digital
    sampled = np.array(ms.digital(image, sensor=sensor, expected=False))
    assert np.abs(sampled - codes[0]).max() <= 2
    assert (sampled != codes[0]).mean() < 0.25
    expected, noise = np.array(ms.digital(image, sensor=sensor)), codes.std(axis=0) / 10
    assert (np.abs(expected - codes.mean(axis=0)) <= 5 * noise + 0.02 * expected).all()


@pytest.mark.parametrize("integrator", one_in(5, INTEGRATORS))
def test_the_derivative_by_an_albedo_and_by_an_emitter_are_central_differences(
    integrator: str,
) -> None:
    mi = ready()
    scene = mi.load_string(text_of(integrator=integrator))
    parameters = mi.traverse(scene)

    def loss_of(name: str) -> Callable[[Any, int], Any]:
        def loss(value: Any, samples: int) -> Any:
            parameters[name] = value
            parameters.update()
            image = mi.render(scene, parameters, spp=samples, seed=1, seed_grad=2)
            return sum_of(ms.digital(image, sensor=scene.sensors()[0]))

        return loss

    compare(loss_of("ball.bsdf.reflectance.value"), 0.5, 0.02, 512)
    parameters["ball.bsdf.reflectance.value"] = 0.5
    compare(loss_of("sky.radiance.value"), 2e-4, 1e-5, 256)


NUMBERS = {
    "exposure.time_s": (0.002, 1e-4),
    "lens.f_number": (2.8, 0.03),
    "readout.sense_gain_uv_per_e": (5.0, 0.05),
    "lens.transmission": (0.8, 0.01),
    "exposure.temperature_k": (320.0, 0.5),
    "pixel.fill_factor": (0.5, 0.005),
}


@pytest.mark.parametrize("name", one_in(6, list(NUMBERS)))
def test_the_derivative_by_a_number_of_camera_and_exposure_is_a_central_difference(
    name: str,
) -> None:
    """Through the light, the dark current and the chain together."""
    mi = ready()
    value, step = NUMBERS[name]
    scene = mi.load_string(text_of())
    image = mi.render(scene, spp=64, seed=1)
    camera = bare_camera(1.5, adc__black_level_dn=1.0).replace(
        **{"dark_current.fom_na_per_cm2": 1.0}
    )

    def loss(number: Any, samples: int) -> Any:
        del samples
        given = {name: number}
        return sum_of(
            ms.digital(
                image, camera, ms.Exposure(0.002), sensor=scene.sensors()[0], parameters=given
            )
        )

    compare(loss, value, step, 1)


QUAD = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
-0.6 -0.5 0
-0.6 0.5 0
0.6 0.5 0
0.6 -0.5 0
3 0 1 2
3 0 2 3
"""


@pytest.mark.exhaustive
@pytest.mark.parametrize("integrator", ["direct_projective", "prb_projective"])
def test_the_derivative_by_the_position_of_vertices_is_a_central_difference(
    tmp_path: Path, integrator: str
) -> None:
    """Of a lamp that becomes wider: all of it is at its silhouette."""
    mi, dr = ready(), drjit()
    (tmp_path / "quad.ply").write_text(QUAD, encoding="ascii")
    world = f"""<shape type="ply" id="lamp"><string name="filename" value="{tmp_path / "quad.ply"}"/>
    <transform name="to_world"><rotate y="1" angle="20"/><translate x="0.1" z="5"/></transform>
    <bsdf type="diffuse"><spectrum name="reflectance" value="0"/></bsdf>
    <emitter type="area"><spectrum name="radiance" value="2e-3"/></emitter></shape>"""
    scene = mi.load_string(text_of(integrator=integrator, world=world))
    parameters = mi.traverse(scene)
    at_rest = mi.Float(parameters["lamp.vertex_positions"])

    def loss(wider: Any, samples: int) -> Any:
        places = dr.unravel(mi.Point3f, at_rest)
        places.x = places.x * (1 + wider)
        parameters["lamp.vertex_positions"] = dr.ravel(places)
        parameters.update()
        image = mi.render(scene, parameters, spp=samples, seed=1, seed_grad=2)
        return sum_of(ms.digital(image, sensor=scene.sensors()[0]))

    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)  # it warns of shapes at the border of the picture
    try:
        compare(loss, 0.0, 0.1, 4096)
    finally:
        mi.set_log_level(level)


LAMP = """<shape type="rectangle"><transform name="to_world"><scale value="0.008"/><rotate y="1" angle="180"/>
<translate z="0.4"/></transform><emitter type="area"><texture type="bitmap" name="radiance">
<string name="filename" value="{file}"/><boolean name="raw" value="true"/></texture></emitter></shape>"""
LENS = """<float name="f_number" value="1"/><float name="focus_distance_m" value="0.3"/>
<sampler type="multijitter"/>"""


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["focus_distance", "aperture_radius"])
def test_the_derivative_by_a_thin_lens_is_a_central_difference(
    tmp_path: Path, name: str
) -> None:
    """Where the picture is smooth: of a lamp whose radiance grows with the square of the distance from its centre, so
    that a blur makes it brighter. What the focus changes of the f-number that works is in it."""
    mi = ready()
    place = np.linspace(-1.0, 1.0, 128)
    radiance = 1e-3 * (0.02 + place[:, None] ** 2 + place[None, :] ** 2)
    mi.Bitmap(radiance[..., None].astype(np.float32)).write(str(tmp_path / "lamp.exr"))
    world = LAMP.format(file=tmp_path / "lamp.exr")
    text = text_of(integrator="direct", focal_mm=5.0, lens=LENS, world=world, time_s=0.001)
    scene = mi.load_string(text)
    parameters = mi.traverse(scene)
    key = next(key for key, _ in parameters if key.endswith(name))
    value = float(np.ravel(parameters[key])[0])

    def loss(number: Any, samples: int) -> Any:
        parameters[key] = number
        parameters.update()
        image = mi.render(scene, parameters, spp=samples, seed=1, seed_grad=2)
        return sum_of(ms.digital(image, sensor=scene.sensors()[0]))

    compare(loss, value, 0.02 * value, 1024)


@pytest.mark.exhaustive
def test_a_likelihood_finds_an_albedo_in_5_electrons_where_least_squares_does_not() -> None:
    """Of 200 frames of 32 × 32 pixels, whose read noise of 3 e- is clipped at 0. The mean of the albedos that are most
    likely is right within its standard error; that of least squares is off by more than 10 of them. The seed is the
    first that was tried; one in three would leave a standard error."""
    mi = ready()
    camera, exposure = bare_camera(1.5, dn_per_e=0.5, adc__black_level_dn=0.0), ms.Exposure(0.1)
    text = text_of(focal_mm=50.0).replace('"16"', '"32"').replace('"12"', '"32"')
    sensor = mi.load_string(text).sensors()[0]

    def image_of(value: float) -> Any:
        return mi.TensorXf(np.full((32, 32, 1), value, np.float32))

    probe = np.array(ms.digital(image_of(1e-2), camera, exposure, sensor=sensor)).mean() / 0.5
    true, albedos = 0.5, np.linspace(0.46, 0.54, 9)
    photons = np.full((32, 32), 5.0 / QE)
    raw = ms.expose(photons, camera, exposure, frames=200, seed=1).digital.reshape(200, -1)
    counts = np.stack([np.bincount(frame, minlength=1024) for frame in raw])
    codes = np.arange(1024).reshape(32, 32)
    chances = [
        ms.raw_log_likelihood(
            codes, image_of(1e-2 * 5.0 / probe * albedo / true), camera, exposure, sensor=sensor
        )
        for albedo in albedos
    ]
    likely = counts @ np.stack([np.array(chance).ravel() for chance in chances], axis=1)
    bend, slope, _ = np.polyfit(albedos - true, likely.T, 2)
    found = true - slope / (2 * bend)
    squares = true * raw.mean(axis=1) / 0.5 / 5.0
    error, other = (x.std(ddof=1) / np.sqrt(200) for x in (found, squares))
    assert abs(found.mean() - true) < error
    assert abs(squares.mean() - true) > 10 * other
    spread = 1 / np.sqrt(
        -2 * bend.mean()
    )  # of the bound of Cramer and Rao, by the mean curvature
    assert found.std(ddof=1) == pytest.approx(spread, rel=0.15)


def test_a_likelihood_of_two_noisy_halves_is_unbiased_and_no_pixel_outweighs_the_others() -> (
    None
):
    """Light up to twice the full scale, rendered with gamma-distributed noise of 20 % in each half. A Newton step
    for the brightness, from the true one, is below 2 %, whose standard error is 0.4 %; without the variance of the
    render it is larger."""
    mi, dr = ready(), drjit()
    text = (
        text_of(camera="konnik_table1", time_s=0.2, focal_mm=50.0)
        .replace('"16"', '"64"')
        .replace('"12"', '"64"')
    )
    sensor = mi.load_string(text).sensors()[0]
    rng = np.random.default_rng(1)
    true = np.geomspace(2e-3, 0.2, 4096).reshape(64, 64, 1)
    raw = np.array(ms.digital(mi.TensorXf(true), sensor=sensor, expected=False)).round()
    assert 0.1 < (raw == 4095).mean() < 0.5
    halves = true * rng.gamma(25.0, 1 / 25.0, (2, *true.shape))

    def slopes(scale: float, variance: Any = None) -> Any:
        """Derivatives of the logarithm of the likelihood by the logarithm of the light of each pixel."""
        images = [mi.TensorXf(half * scale) for half in halves]
        image = (images[0] + images[1]) / 2
        dr.enable_grad(*images, image)
        given = images if variance is None else image
        chance = ms.raw_log_likelihood(raw, given, sensor=sensor, render_variance=variance)
        dr.backward(dr.sum(chance, axis=None))
        leaves = images if variance is None else [image]
        return sum(np.array(dr.grad(leaf)) for leaf in leaves) * true * scale

    def step(variance: Any = None) -> float:
        low, here, high = (slopes(x, variance).sum() for x in (0.95, 1.0, 1.05))
        return float(here / ((low - high) / 0.1))

    alone, told = step(np.zeros((64, 64))), step(np.full((64, 64), 1 / 50))
    assert abs(step()) < 0.02
    assert abs(told) < 0.02
    assert abs(alone) > 0.04
    raw[32, 32] = 0
    assert abs(slopes(1.0)[32, 32, 0]) < 0.02 * np.abs(slopes(1.0)).sum()


BOX = """<bsdf type="diffuse" id="grey"><spectrum name="reflectance" value="0.4"/></bsdf>
<shape type="cube"><transform name="to_world"><translate z="0.95"/></transform>
<boolean name="flip_normals" value="true"/><bsdf type="diffuse">
<spectrum name="reflectance" value="0.6"/></bsdf></shape>
<shape type="sphere"><point name="center" value="0.2, -0.4, 1.05"/><float name="radius" value="0.5"/>
<ref id="grey"/></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.25"/><rotate x="1" angle="90"/>
<translate y="0.98" z="0.95"/></transform><emitter type="area"><spectrum name="radiance" value="3e-2"/>
</emitter></shape>"""


@pytest.mark.exhaustive
@pytest.mark.parametrize("samples", [16, 64])
@pytest.mark.parametrize("time_s", [0.01, 0.1, 0.2])
def test_a_fit_by_the_likelihood_finds_reflectance_and_emitter_within_5_percent(
    time_s: float, samples: int
) -> None:
    """From starting values half as large again, with 30 steps of Adam; in 0.2 s 40 % of the pixels are clipped."""
    mi, dr = ready(), drjit()
    band = '<float name="bandwidth_nm" value="100"/>'
    text = text_of(time_s=time_s, world=BOX, more=band, focal_mm=0.08)
    scene = mi.load_string(text)
    sensor, parameters = scene.sensors()[0], mi.traverse(scene)
    raw = np.array(ms.digital(mi.render(scene, spp=8192), sensor=sensor, expected=False))
    names = ["grey.reflectance.value"]
    names += [key for key, _ in parameters if key.endswith("emitter.radiance.value")]
    true = np.array([0.4, 3e-2])
    at, first, second, path = np.log(1.5 * true), np.zeros(2), np.zeros(2), []
    for k in range(30):
        values = [mi.Float(float(x)) for x in np.exp(at)]
        dr.enable_grad(*values)
        for name, value in zip(names, values, strict=True):
            parameters[name] = value
        parameters.update()
        halves = [
            mi.render(scene, parameters, spp=samples // 2, seed=2 * k + n, seed_grad=900 + 2 * k + n)
            for n in (0, 1)
        ]  # fmt: skip
        dr.backward(-dr.mean(ms.raw_log_likelihood(raw, halves, sensor=sensor), axis=None))
        slope = np.array([dr.grad(value).numpy()[0] for value in values]) * np.exp(at)
        first, second = 0.8 * first + 0.2 * slope, 0.9 * second + 0.1 * slope**2
        size = np.sqrt(second / (1 - 0.9 ** (k + 1))) * (1 - 0.8 ** (k + 1))
        at -= (0.1 if k < 15 else 0.03) * first / size
        path.append(np.exp(at))
    np.testing.assert_allclose(np.mean(path[-8:], axis=0), true, rtol=0.05)


def test_what_is_no_image_of_a_photosensor_is_one_sentence() -> None:
    mi = ready()
    scene = mi.load_string(text_of())
    sensor, image = scene.sensors()[0], mi.render(scene, spp=4)
    other = mi.load_dict({"type": "perspective", "film": {"type": "hdrfilm"}})
    exposure, ones = ms.Exposure(0.01), np.ones((12, 16))
    wrong: list[tuple[Any, str]] = [
        (lambda: ms.digital(np.zeros((12, 16, 1)), sensor=sensor), "image is ndarray"),
        (lambda: ms.digital(image, sensor=other), "no sensor of Mitsuba with a photosensor"),
        (lambda: ms.digital(mi.TensorXf(np.zeros((3, 4, 1))), sensor=sensor), "image has shape"),
        (lambda: ms.digital(image, sensor=sensor, parameters={"lens.f_numbr": mi.Float(2)}), "f_number"),
        (lambda: ms.digital(image, sensor=sensor, parameters={"lens.f_number": 2.0}), "Dr.Jit number"),
        (lambda: ms.digital(image, sensor=sensor, parameters={"exposure.gain": mi.Float(1)}), "time_s"),
        (lambda: ms.digital(image, "konnik_table1", exposure, sensor=sensor, serial=-1), "serial is -1"),
        (lambda: ms.raw_log_likelihood(np.zeros((2, 2)), image, sensor=sensor), "shape"),
        (lambda: ms.raw_log_likelihood(np.full((12, 16), -1), image, sensor=sensor), "from -1"),
        (lambda: ms.raw_log_likelihood(ones, image, sensor=sensor, render_variance=-ones), "render_variance has"),
        (lambda: ms.raw_log_likelihood(ones, [], sensor=sensor), "of 0 shapes"),
        (lambda: ms.raw_log_likelihood(ones, [image, image[:3]], sensor=sensor), "of 2 shapes"),
        (lambda: ms.raw_log_likelihood(ones, image, sensor=sensor, render_variance=0.1), "shape of the image"),
    ]  # fmt: skip
    for call, sentence in wrong:
        with pytest.raises(ms.InputError, match=sentence) as caught:
            call()
        assert "\n" not in str(caught.value)


def test_a_chain_without_a_closed_form_has_expected_codes_and_no_likelihood() -> None:
    mi, dr = ready(), drjit()
    scene = mi.load_string(text_of())
    sensor, image = scene.sensors()[0], mi.render(scene, spp=4)
    rts = ms.load_camera("konnik_table1").replace(
        **{"dark_current.rts_fraction": 0.1, "dark_current.rts_amplitude_e_per_s": 100.0}
    )
    with pytest.raises(ms.InputError, match=r"likelihood, .*rts_state.*ms.digital"):
        ms.raw_log_likelihood(np.full((12, 16), 100), image, rts, sensor=sensor)
    plain, found = (
        np.array(ms.digital(image, camera, sensor=sensor))
        for camera in (rts.without("rts_pixels"), rts)
    )
    assert np.abs(found - plain).mean() < 0.5
    factor = mi.Float(1.0)
    dr.enable_grad(factor)
    dr.backward(sum_of(ms.digital(image * factor, rts, sensor=sensor)))
    low, high = (
        float(
            sum_of(ms.digital(image * x, rts.without("rts_pixels"), sensor=sensor)).numpy()[0]
        )
        for x in (mi.Float(0.9), mi.Float(1.1))
    )
    # The slopes of a lattice of 32 frames are right to a few percent.
    assert dr.grad(factor).numpy()[0] == pytest.approx((high - low) / 0.2, rel=0.06)
