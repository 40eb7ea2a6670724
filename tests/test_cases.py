"""Small inputs on which strangers found the product wrong, each with its right value or the sentence that it gets.

tests/data/cases has the inputs; README.md there and README in each folder tell what happened and what is right.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import DATA
from helpers.scenes import skip_unless_usable

import mitsuba_sensor as ms
from mitsuba_sensor.render.variants import mitsuba

CASES = DATA / "cases"
Check = Callable[[], None]
CHECKS: dict[str, Check] = {}
"""Name of a case, the beginning of its file's or folder's name → what must hold."""

SKY = {
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 24, "height": 18}},
    "sky": {"type": "constant"},
}

PENDING = {
    *("01", "02", "03", "04", "05", "07", "12", "13"),
    *("2026-11-29_01", "2026-11-29_03", "2026-11-29_05", "2026-11-29_06"),
    *("2026-11-29_08", "2026-11-29_09", "2026-11-29_10", "2026-11-29_11", "2026-11-29_12"),
    *("2026-11-29_14", "2026-11-29_16"),
}
"""Cases that have no row yet."""


def case(name: str) -> Callable[[Check], Check]:
    """Enter the decorated check into the table."""

    def enter(check: Check) -> Check:
        CHECKS[name] = check
        return check

    return enter


def names_of_inputs() -> set[str]:
    """The numbers that inputs begin with: 01, 2026-11-29_01."""
    names = (re.match(r"(2026-11-29_)?\d\d(?=_)", path.name) for path in CASES.iterdir())
    return {name.group() for name in names if name}


def rendered(scene: Any, **options: Any) -> ms.Irradiance:
    """The light of a scene for konnik_table1."""
    options = {"spp": 4, "progress": False, **options}
    return ms.render(scene, "konnik_table1", ms.Exposure(0.01), seed=1, **options)


@case("09")
def _variant_left() -> None:
    """The variant that the user has set is the current one afterwards, and their scene renders."""
    mi = mitsuba()
    mi.set_variant("scalar_rgb")
    try:
        scene = mi.load_dict({"type": "scene", "i": {"type": "path"}, **SKY})
        rendered(CASES / "02_default_emitter.xml", variant="scalar_spectral")
        assert mi.variant() == "scalar_rgb"
        assert np.isfinite(mi.render(scene, spp=1)).all()
    finally:
        mi.set_variant("scalar_spectral")


@case("11")
def _dict_prb() -> None:
    """A dict with prb, whose primal image is that of path."""
    variant = skip_unless_usable("llvm_ad_spectral")
    scenes = ({"type": "scene", "i": {"type": name}, **SKY} for name in ("prb", "path"))
    one, other = (rendered(scene, variant=variant).data for scene in scenes)
    np.testing.assert_allclose(one, other, rtol=1e-5)


@case("2026-11-29_04")
def _far_spheres() -> None:
    """A sphere of reflectance ρ under a uniform sky has ρ of its radiance. Far away LLVM is wrong, and says so."""
    folder, llvm = CASES / "2026-11-29_04_far_sphere_llvm", "llvm_ad_spectral"
    skip_unless_usable(llvm)
    far = (folder / "far.xml").read_text(encoding="utf-8")

    def reflectances(scene: str, variant: str) -> tuple[Any, bool]:
        light = rendered(scene, variant=variant, spp=64, denoise=False)
        picture = light.data.sum(axis=-1)
        spheres = [picture[11:13, column : column + 2].mean() for column in (5, 11, 17)]
        found = any("too far from the sensor for float32" in note for note in light.notes)
        return spheres / picture[0].mean(), found

    clipped = far.replace('"1e5"', '"699994"')  # what the finding proposes
    near = (folder / "near.xml").read_text(encoding="utf-8")
    for scene, variant in ((near, llvm), (far, "scalar_spectral"), (clipped, llvm)):
        of_spheres, found = reflectances(scene, variant)
        # Its neighbours hide some of the sky from each sphere.
        np.testing.assert_allclose(of_spheres, (0.8, 0.2, 0.6), rtol=0.07)
        assert not found
    of_spheres, found = reflectances(far, llvm)
    assert max(of_spheres / (0.8, 0.2, 0.6)) < 0.9 and found


def test_each_input_has_a_row() -> None:
    assert {*CHECKS} | PENDING == names_of_inputs()


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_case(name: str) -> None:
    CHECKS[name]()
