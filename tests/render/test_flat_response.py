"""Boxes of bands are compared, not looked up, where code is compiled: the same film as one of Mitsuba's own spectra."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.marks import exhaustive
from helpers.scenes import BALL, SKY, scene_text, skip_unless_usable, write_scene

import mitsuba_sensor as ms
from mitsuba_sensor.core.llvm import drjit
from mitsuba_sensor.render.light.bands import (
    box_bands,
    response_film,
    round_wavelength_density,
    with_filters,
)
from mitsuba_sensor.render.variants import choose_variant, use

BAYER = ms.load_camera("bayer_2mp")
COLOURED = {
    "lens.transmission_curve": (0.5, 0.9),
    "lens.transmission_wavelengths_nm": (300.0, 1100.0),
}
EDGES = {
    "uneven": [400.0, 412.3, 424.6, 436.9, 449.2, 461.5, 463.1],  # the last band is narrow
    "few": [400.0, 500.0, 505.5],
    "one": [549.5, 550.5],
}


@pytest.mark.parametrize(
    ("edges", "camera"),
    [
        (EDGES["uneven"], BAYER.replace(**COLOURED)),
        exhaustive(EDGES["few"], BAYER.replace(**COLOURED)),
        (EDGES["one"], BAYER),
    ],
)
def test_a_film_of_boxes_measures_what_one_of_mitsubas_own_does(
    edges: list[float], camera: ms.Camera
) -> None:
    """At random wavelengths, at all edges, next to them and beyond; of light that is 0, tiny, huge, infinite and no
    number: the same values to 1e-6. The density of wavelengths is the same."""
    mi = use(choose_variant(skip_unless_usable("llvm_ad_spectral")))
    responses, size = (
        with_filters(box_bands(camera, np.array(edges)), camera).responses,
        {"width": 1, "height": 1},
    )
    ours, theirs = response_film(responses, size), mi.load_dict(
        {"type": "specfilm", **size, **{f"band{k:04d}": dict(one) for k, one in enumerate(responses)}}
    )  # fmt: skip
    round_wavelength_density(theirs)
    densities = [
        np.array(mi.traverse(film.sensor_response_function())["values"])
        for film in (ours, theirs)
    ]
    np.testing.assert_array_equal(*densities)
    random, ends = np.random.default_rng(4), np.float32(edges)
    nm = [
        random.uniform(edges[0] - 5, edges[-1] + 5, 2000),
        ends,
        np.nextafter(ends, 0),
        np.nextafter(ends, 999),
    ]
    nm = np.float32(np.concatenate(nm))
    light = np.resize(np.float32([1.0, 0.0, 3e38, 1e-38, np.inf, np.nan, 7.0]), len(nm))
    wavelengths = mi.Spectrum(*[mi.Float(np.roll(nm, 700 * k)) for k in range(4)])
    spectrum = mi.Spectrum(*[mi.Float(np.roll(light, k * k)) for k in range(4)])
    found = []
    for film in (ours, theirs):
        count = film.prepare([])
        found.append(
            np.array(
                [np.array(x) for x in film.prepare_sample(spectrum, wavelengths, count)[:-1]]
            )
        )
    assert np.nanmax(found[1]) > 0
    np.testing.assert_allclose(*found, rtol=1e-6)


def test_another_render_of_bands_compiles_no_kernel(tmp_path: Path) -> None:
    """The scene loaded again, with another seed: all that runs over 96 pixels or more is compiled already."""
    variant, path = (
        skip_unless_usable("llvm_ad_spectral"),
        write_scene(tmp_path, scene_text(SKY, BALL.format(bsdf=""))),
    )
    dr, used = drjit(), []
    for seed in (1, 2):
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            ms.render(
                path,
                BAYER,
                ms.Exposure(0.02),
                bandwidth_nm=20,
                spp=32,
                seed=seed,
                variant=variant,
                denoise=False,
            )
            used.append(
                [one for one in dr.kernel_history([dr.KernelType.JIT]) if one["size"] >= 12 * 8]
            )
    assert {one["hash"] for one in used[1]} == {one["hash"] for one in used[0]}
    assert used[1] and all(one["cache_hit"] for one in used[1])
