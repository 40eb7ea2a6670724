"""Benches that used to be measured wrongly without a word: refused, right, or without a figure and with a note."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy
from helpers.small_cameras import SmallCamera

import mitsuba_sensor as ms
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.measure.emva_linear import emva_linear

CAMERA, SHAPE = SmallCamera(prnu=0.01), (64, 64)
TILE = np.tile([[0.5, 1.0], [1.0, 0.4]], (32, 32))
BAYER = (("R", "G"), ("G", "B"))
Change = Callable[[Stack], Stack]


def bench(seed: int = 1, **change: Change) -> Bench:
    """Dark frames of three exposures, flat fields of 12 levels, 4 frames each; stacks of some kinds changed."""
    rng = np.random.default_rng(seed)
    darks, flats = CAMERA.bench(rng, 4, SHAPE, 12)
    for time in (1.0, 4.0):
        taken = CAMERA.stack(rng, 200.0 * time, 4, SHAPE)
        darks.append(replace(taken, exposure_s=time, photons=0.0))
    made = Bench((), tuple(darks), tuple(flats))
    return replace(
        made, **{kind: tuple(map(f, getattr(made, kind))) for kind, f in change.items()}
    )


def frames_of(change: Callable[[np.ndarray], Any]) -> Change:
    return lambda stack: replace(stack, frames=np.asarray(change(stack.frames)))


def behind_filters(flat: Stack) -> Stack:
    light = CAMERA.stack(np.random.default_rng(7), TILE * flat.photons, 4, SHAPE)
    return replace(light, photons=flat.photons)


def smooth(frames: np.ndarray) -> np.ndarray:
    averaged = scipy.ndimage.uniform_filter(frames.astype(float), (0, 3, 3))
    return np.rint(averaged).astype(np.uint16)


REFUSED: dict[str, tuple[dict[str, Change], str]] = {
    "copies": ({"flats": frames_of(lambda f: f[[0, 1, 2, 1]])}, "frames 2 and 4 are identical"),
    "a mosaic without a tile": ({"flats": behind_filters}, r"16[0-9]{2}, 3000, 3000, 13.*tile"),
    "two mosaics": ({"flats": lambda s: replace(s, tile=BAYER)}, "different mosaics"),
}
BOTH = ("darks", "flats")
NO_TWIN: dict[str, tuple[dict[str, Change], str]] = {
    "denoised": ({"flats": frames_of(smooth)}, "correlated by 0.6"),
    "one dark frame": ({"darks": frames_of(lambda f: f[:1])}, "no dark stack has 2 frames|2 frames or more"),
    "one flat frame": ({"flats": frames_of(lambda f: f[:1])}, "single frames"),
    "all black": (dict.fromkeys(BOTH, frames_of(lambda f: f * 0)), "every value is 0"),
    "all saturated": ({"flats": frames_of(lambda f: f * 0 + 4095)}, "K cannot be measured"),
    "other sizes": ({"darks": frames_of(lambda f: f[:, :-1])}, "differ in size"),
    "few rows": (dict.fromkeys(BOTH, frames_of(lambda f: f[:, :6])), "6 rows or columns"),
    "cut black": (dict.fromkeys(BOTH, frames_of(lambda f: f.clip(64) - 64)), "black level is too low"),
    "photons per µm²": ({"flats": lambda s: replace(s, photons=s.photons / 49)}, "are they per µm².*Correct photons"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_benches_that_are_measured_wrongly_are_refused(name: str) -> None:
    change, sentence = REFUSED[name]
    for measure in (ms.lab.measure_bench, ms.lab.fit):
        with pytest.raises(ms.InputError, match=sentence):
            measure(bench(**change))


@pytest.mark.parametrize("name", NO_TWIN)
def test_benches_that_show_no_camera_have_no_twin_and_no_figure_without_a_note(
    name: str,
) -> None:
    """Where figures can be measured nevertheless, they hold the truth or have a note."""
    change, sentence = NO_TWIN[name]
    with pytest.raises(ms.InputError, match=sentence):
        ms.lab.fit(bench(**change))
    if name == "other sizes":
        return
    (found,) = ms.lab.measure_bench(bench(**change))
    for symbol, true in (("K", 0.3), ("η", 0.6), ("σ_d", 6.0)):
        figure = found.figures.get(symbol)
        if figure is None:
            assert "2 frames or more" in found.refused["photon transfer"]
        else:
            assert (math.isnan(figure.value) and figure.note) or figure.covers(true), figure


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda darks, flats: ([], flats), "0 dark stacks and 12 flat"),
        (lambda darks, flats: (darks, [flats[0].window(slice(20), slice(20)), *flats]), "differ in shape"),
        (lambda darks, flats: (darks, [replace(flats[0], gain="800"), *flats]), "differ in gain"),
        (lambda darks, flats: (darks, [replace(flats[9], bits=8), *flats]), "is above 8 bits"),
        (lambda darks, flats: (darks, [replace(flats[0], photons=None), *flats]), "all of them or none"),
        (lambda darks, flats: (darks, [replace(flats[0], photons=np.ones(SHAPE))]), "photons is an array"),
        (lambda darks, flats: ([replace(darks[0], tile=BAYER)], flats), "of_filters"),
    ],
)  # fmt: skip
def test_stacks_that_do_not_belong_together_are_refused(change: Any, said: str) -> None:
    given = bench()
    with pytest.raises(ms.InputError, match=said):
        emva_linear(*change(given.darks[:1], given.flats))


def test_dark_frames_at_the_full_well_are_left_out_and_named() -> None:
    sound = bench()
    full = CAMERA.stack(np.random.default_rng(2), 60_000.0, 4, SHAPE)
    full = replace(full, exposure_s=600.0, photons=0.0)
    with_full = replace(sound, darks=(*sound.darks, full))
    (found,) = ms.lab.measure_bench(with_full)
    assert "dark frames of 600 s are saturated" in " ".join(found.notes)
    assert found.figures["µ_I.mean"].covers(120)
    assert ms.lab.fit(with_full).figures()["µ_I"].quantity.covers(120)


def test_no_interval_has_no_width_and_no_unit_is_1() -> None:
    (found,) = ms.lab.measure_bench(bench())
    for figure in found.figures.values():
        assert figure.unit != "1" and figure.low != figure.high, figure
    assert "dB (" in str(found.figures["DR"]) and str(found.figures["η"]).split()[3][0] == "("


def test_an_instrument_of_ones_own_is_one_function_and_one_row() -> None:
    """One that returns nothing is refused, one without scatter has no interval, and the others measure."""

    def warmest(dark: Stack) -> tuple[float, float, float]:
        return float(dark.mean.max()), float(dark.mean.min()), float(dark.mean.max())

    row = ms.lab.Instrument(
        "warmest", lambda found: found.bench.darks[:1], warmest, "DN", "our rule"
    )
    exact = row._replace(title="exact", function=lambda dark: (3, 3, 3))
    nothing = row._replace(title="nothing", function=lambda dark: None)
    rows = [nothing, *ms.lab.INSTRUMENTS, row, exact]
    (found,) = ms.lab.measure_bench(bench(), instruments=rows)
    figure = found.figures["warmest"]
    assert figure.value == pytest.approx(found.bench.darks[0].mean.max())
    assert figure.section == "our rule" and "do not scatter" in found.figures["exact"].note
    assert "returned NoneType" in found.refused["nothing"] and found.figures["K"].covers(0.3)


def test_frames_of_zeros_have_no_figure_but_notes_and_a_bench_without_frames_is_refused() -> (
    None
):
    flats = [
        Stack(np.zeros((count, 8, 8), np.uint16), 0.01, photons, bits=8)
        for count, photons in ((2, 100.0), (2, 200.0), (2, 400.0), (8, 300.0))
    ]
    dark = Stack(np.zeros((8, 8, 8), np.uint16), 0.01, 0, bits=8)
    (measured,) = ms.lab.measure_bench(Bench((), (dark,), tuple(flats)))
    for figure in measured.figures.values():
        assert math.isnan(figure.value) and figure.note
    with pytest.raises(ms.InputError, match="no frames"):
        ms.lab.measure_bench(Bench((), (), ()))
    for lack in ("darks", "flats"):
        with pytest.raises(ms.InputError, match="the bench has no"):
            ms.lab.fit(replace(bench(), **{lack: ()}))
