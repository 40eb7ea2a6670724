"""Integrators that compute gradients: the same light as ``path``, in every kind of scene; derivatives of that light."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.marks import one_in
from helpers.scenes import BALL, SKY, scene_text, skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.render.scene.mitsuba_errors import gradient_integrators
from mitsuba_sensor.render.variants import choose_variant, use

CAMERA, EXPOSURE = ms.load_camera("konnik_table1"), ms.Exposure(0.1)
OPTIONS: Any = {"spp": 64, "bandwidth_nm": 100, "denoise": False, "seed": 5}
RGB_ONLY = "volprim_rf_basic"
GREY = BALL.format(
    bsdf='<bsdf type="diffuse"><spectrum name="reflectance" value="0.5"/></bsdf>'
)
IN_SPECTRA = sorted({*gradient_integrators()} - {RGB_ONLY})


def ready(variant: str = "llvm_ad_spectral") -> Any:
    return use(choose_variant(skip_unless_usable(variant)))


DEPTH = '<integrator type="{}"><integer name="max_depth" value="3"/></integrator>'


def text_of(integrator: str) -> str:
    return scene_text(SKY, GREY, DEPTH.format(integrator))


def dict_of(integrator: Any) -> dict[str, Any]:
    film = {"type": "hdrfilm", "width": 12, "height": 8}
    sky = {"type": "constant", "radiance": {"type": "uniform", "value": 2e-4}}
    ball = {"type": "sphere", "center": [0.0, 0.0, 4.0]}
    sensor = {"type": "perspective", "fov": 60.0, "film": film}
    return {
        "type": "scene",
        "integrator": integrator,
        "sensor": sensor,
        "sky": sky,
        "ball": ball,
    }


def assert_same_light(one: ms.Irradiance, other: ms.Irradiance) -> None:
    """Mean over the picture, band by band, within 5 standard errors: chance fails one seed in a million. A millionth is
    left for the rounding of float32."""
    error = np.sqrt((one.standard_error**2 + other.standard_error**2).sum(axis=(0, 1)))
    off = np.abs((one.data - other.data).sum(axis=(0, 1), dtype=np.float64))
    assert (off <= 5 * error + 1e-6 * one.data.sum(axis=(0, 1))).all()


@pytest.mark.parametrize("integrator", one_in(3, [*IN_SPECTRA, "prb distorted"]))
def test_its_light_is_that_of_path(integrator: str) -> None:
    """In a film so small that passes lie side by side on another, and behind a lens with distortion."""
    ready()
    name, _, distorted = integrator.partition(" ")
    coefficients = {"lens.distortion": [-0.2, 0.0, 0.0, 0.0, 0.0]} if distorted else {}
    camera = CAMERA.replace(**coefficients)
    reference, light = (
        ms.render(text_of(kind), camera, EXPOSURE, **OPTIONS) for kind in ("path", name)
    )
    assert_same_light(light, reference)


def test_it_may_be_named_in_a_dict_be_an_object_or_be_loaded() -> None:
    """The same picture, to the rounding of float32."""
    mi = ready()
    named = {"type": "prb"}
    scenes = dict_of(named), dict_of(mi.load_dict(named)), mi.load_dict(dict_of(named))
    first, *others = (ms.render(scene, CAMERA, EXPOSURE, **OPTIONS).data for scene in scenes)
    for other in others:
        np.testing.assert_allclose(other, first, rtol=1e-5)


def test_a_plugin_of_the_user_s_own_may_stand_in_a_dict() -> None:
    """What Python has registered has no file, and is no misspelling."""
    mi = ready()
    mi.register_bsdf("user_s_own", lambda props: mi.load_dict({"type": "diffuse"}))
    scene = dict_of({"type": "path"})
    grey = ms.render(scene, CAMERA, EXPOSURE, **OPTIONS)
    scene["ball"]["bsdf"] = {"type": "user_s_own"}
    np.testing.assert_allclose(
        ms.render(scene, CAMERA, EXPOSURE, **OPTIONS).data, grey.data, rtol=1e-5
    )


def test_native_code_beside_a_dict_is_refused_before_anything_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready()
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "user_s_code.so").write_bytes(b"no code")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ms.InputError, match="native code that would be run"):
        ms.render(dict_of({"type": "user_s_code"}), CAMERA, EXPOSURE)


def test_a_spectral_response_of_the_sensor_is_replaced_by_that_of_the_camera() -> None:
    """The same picture, bit for bit, and a note."""
    ready("scalar_spectral")
    response = '<spectrum name="srf" value="400:0.5, 700:0.9"/>'
    scenes = scene_text(SKY, GREY), scene_text(SKY, GREY, more=response)
    without, light = (
        ms.render(scene, CAMERA, EXPOSURE, **{**OPTIONS, "spp": 8}) for scene in scenes
    )
    np.testing.assert_array_equal(light.data, without.data)
    assert any("srf of the sensor is ignored" in note for note in light.statistics.notes)


OURS = """<scene version="3.0.0">{integrator}<sensor type="camera"><float name="focal_length_mm" value="0.05"/>
<film type="photosensor"><string name="camera" value="konnik_table1"/><float name="wavelength_nm" value="550"/>
<float name="exposure_s" value="0.002"/><integer name="width" value="12"/><integer name="height" value="8"/>{film}
</film></sensor><shape type="sphere" id="ball"><point name="center" value="0, 0, 4"/><bsdf type="diffuse">
<spectrum name="reflectance" value="0.5"/></bsdf></shape><emitter type="constant">
<spectrum name="radiance" value="2e-4"/></emitter></scene>"""
RAW = '<string name="output" value="raw"/>'


@pytest.mark.parametrize("integrator", ["path", "prb"])
def test_the_light_of_a_photosensor_has_the_derivative_of_a_central_difference(
    integrator: str,
) -> None:
    """With respect to the reflectance of a ball that lights nothing else, in which the light is linear. Of 24 576
    paths; the derivative has a seed of its own, and they agree to about 1 %, so that 6 % are never left by chance."""
    mi, dr = ready(), drjit()
    scene = mi.load_string(
        OURS.format(integrator=f'<integrator type="{integrator}"/>', film="")
    )
    parameters = mi.traverse(scene)
    name = next(key for key, _ in parameters if "reflectance" in key)

    def light(reflectance: Any) -> Any:
        parameters[name] = reflectance
        parameters.update()
        return dr.sum(mi.render(scene, parameters, spp=256, seed=1), axis=None)

    low, high = (float(np.ravel(light(mi.Float(x)))[0]) for x in (0.4, 0.6))
    reflectance = mi.Float(0.5)
    dr.enable_grad(reflectance)
    dr.backward(light(reflectance))
    assert float(dr.grad(reflectance)[0]) == pytest.approx((high - low) / 0.2, rel=0.06)


def test_a_raw_frame_has_the_light_of_its_integrator_and_no_derivative() -> None:
    """The frame of ms.capture for the same seed, bit for bit; one sentence instead of a gradient of zero."""
    mi, dr = ready(), drjit()
    around = OURS.format(
        integrator='<integrator type="raw_frame"><integrator type="prb"/></integrator>',
        film=RAW,
    )
    scene = mi.load_string(around)
    frame = np.array(mi.render(scene, spp=16, seed=3))[..., 0]
    inside = OURS.format(integrator='<integrator type="prb"/>', film="")
    np.testing.assert_array_equal(frame, ms.capture(inside, spp=16, seed=3).frames.digital[0])
    parameters = mi.traverse(scene)
    name = next(key for key, _ in parameters if "reflectance" in key)
    dr.enable_grad(parameters[name])
    parameters.update()
    with pytest.raises(
        ms.InputError,
        match="the digital numbers of a raw frame have no derivative; render the light",
    ):
        dr.backward(dr.sum(mi.render(scene, parameters, spp=4), axis=None))
