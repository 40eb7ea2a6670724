"""Light: radiance from 1e-30 to 1e30 W, 1 to a million samples, 31 bands, photons from 200 to 1100 nm."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from decimal import Decimal, localcontext
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.exposure import Exposure
from ...core.units import LIGHT_SPEED_M_PER_S, PLANCK_J_S, photon_energy_j
from ...render.bands import Bands, box_bands
from ...render.photons import collect, photons_per_irradiance
from ...sensor.camera import Camera, load_camera
from ...sensor.expose import expose
from .case import FLOAT32, RENDERERS, SIGMAS, Case, Engine, Got, largest, once, relative, shown

EXPOSURE = Exposure(0.1)
F_NUMBER = 2.8
"""Of Table 1's lens (cameras/konnik_table1.toml)."""
LEVEL = 0.07
"""Radiance [W m⁻² sr⁻¹ nm⁻¹]; no multiple of it is exact in float32, so that sums are rounded."""

EDGES_NM = np.linspace(400, 710, 32)
"""Of 31 bands of 10 nm."""


def camera() -> Camera:
    """Table 1, which sees 400 to 710 nm."""
    return load_camera("konnik_table1").replace(**{"quantum_efficiency.wavelengths_nm": (400.0, 710.0)})


@contextmanager
def variant(engine: Engine) -> Iterator[Path]:
    """The scene file, with this renderer; the variant that was set comes back afterwards."""
    from ...render.variants import choose_variant, mitsuba, use

    mi = mitsuba()
    before = mi.variant() or choose_variant().name
    with resources.as_file(resources.files(__package__) / "sky.xml") as path:
        try:
            use(choose_variant(engine.word))
            yield path
        finally:
            if mi.variant() != before:
                mi.set_variant(before)


def sky(engine: Engine, radiance: float = LEVEL, size: int = 1, **words: Any) -> Any:
    """A render of it."""
    from ...render.irradiance import render

    with variant(engine) as path:
        given = {"radiance": radiance, "size": size}
        return render(path, camera(), EXPOSURE, parameters=given, variant=engine.word, **words)


def one_film(engine: Engine, bands: Bands, samples: int, size: int = 1, touch: Any = None) -> NDArray[np.float64]:
    """Plain Mitsuba: all samples of a pixel in one float32 film, ∫L dλ of each band (H, W, B).

    touch : called with the film before it is used.
    """
    from ...render.scene import load_scene

    with variant(engine) as path:
        scene = load_scene(path, bands, {"radiance": LEVEL, "size": size}, camera())
        if touch is not None:
            touch(scene.sensor.film())
        return scene.render(1, samples, (0, size)).astype(np.float64)


def irradiance(radiance: float) -> float:
    """E = π·L/(4N²) [W m⁻² nm⁻¹]."""
    return math.pi * radiance / (4 * F_NUMBER**2)


def lost(samples: int) -> float:
    """What n equal numbers lose at most when a float32 adds them up: each sum is rounded to 2^(−24) of itself, and is
    half of the last on average. Beside it: a few roundings of what is added up, and of what comes out."""
    return samples * FLOAT32 / 2 + 4 * FLOAT32


SPP = 16
"""Samples per pixel where their number is not the question."""


def scales(engine: Engine, radiance: float) -> Got:
    """Irradiance by its closed form, photons by theirs, and a frame."""
    light = sky(engine, radiance, 2, wavelength_nm=550.0, spp=SPP)
    photons, exact = collect(light, camera(), EXPOSURE), irradiance(radiance)
    (per_irradiance,) = photons_per_irradiance(camera(), EXPOSURE, [550.0], [10.0])
    off = max(np.abs(x / e - 1).max() for x, e in ((light.data, exact), (photons.mean, exact * per_irradiance)))
    digital = expose(photons, camera(), EXPOSURE).digital
    full = photons.mean.min() * 0.6 > 2 * camera().pixel.full_well_e
    ends = digital.min() == 4095 if full else digital.max() < 4095
    words = f"{light.data.max():.6g} W/m²/nm, {photons.mean.max():.6g} photons, off by {off:.1g}; {digital.max()} DN"
    return Got(words, bool(off <= lost(1) and np.isfinite(light.standard_error).all() and ends))


LARGEST_PASS = 1024
"""Samples per pixel that a pass may have, so that it loses 3e-5 at most."""


def sampled(engine: Engine, spp: int) -> Got:
    """Passes are added up in float64; what is left is what one pass loses."""
    light = sky(engine, spp=spp, wavelength_nm=550.0)
    done = light.statistics
    each = done.samples_per_pixel // done.passes
    off = float(light.data.ravel()[0]) / irradiance(LEVEL) - 1
    return Got(f"{off:+.1e}: {done.passes} passes of {each}", abs(off) <= lost(min(each, LARGEST_PASS)))


MILLION, MILLION_WORDS = 10**6, "1 000 000 in passes, and in one film of Mitsuba's"


def passes_against_one_film(engine: Engine) -> Got:
    """What a million samples lose in one film."""
    passes = sky(engine, spp=MILLION, wavelength_nm=550.0)
    bands = box_bands(camera(), np.array([545.0, 555.0]))
    film = float(one_film(engine, bands, MILLION).ravel()[0]) / (10 * LEVEL) - 1
    ours = float(passes.data.ravel()[0]) / irradiance(LEVEL) - 1
    return Got(f"passes {ours:+.1e}, one film {film:+.1e}", abs(ours) <= lost(LARGEST_PASS))


def adjacent(engine: Engine) -> Got:
    """31 bands of 10 nm and one of 310 nm; each wavelength falls into some band, so their sum has no noise at all."""
    cube = sky(engine, size=4, spp=SPP, bandwidth_nm=10.0)
    wide = sky(engine, size=4, spp=SPP, bandwidth_nm=310.0, wavelength_nm=555.0)
    sums = cube.data.astype(np.float64) @ cube.bandwidths_nm / (310 * irradiance(LEVEL)) - 1
    whole = wide.data[..., 0] / irradiance(LEVEL) - 1
    tolerance = lost(SPP)
    words = f"{cube.data.shape[2]} bands {np.abs(sums).max():.1e} off, one band {np.abs(whole).max():.1e}"
    return Got(words, max(np.abs(sums).max(), np.abs(whole).max()) <= tolerance)


NEARLY = 3e-7
"""Relative spread of the nodes; float32 numbers next to 1 are 1.2e-7 apart."""
FILM, SAMPLES = 16, 400


def nearly_equal_nodes(engine: Engine) -> Got:
    """31 bands of height 1 ± 3e-7, with the repaired density of wavelengths, and with one as nearly flat as they.

    (Mitsuba inverts the density by a formula that cancels in float32 there; render/film.py.)
    """
    random = np.random.default_rng(3)
    bands = box_bands(camera(), EDGES_NM)
    heights = 1 + NEARLY * random.standard_normal(len(bands))
    responses = tuple(
        {"type": "irregular", "wavelengths": f"{low}, {high}", "values": f"{height!r}, {height!r}"}
        for low, high, height in zip(EDGES_NM[:-1].tolist(), EDGES_NM[1:].tolist(), heights.tolist(), strict=True)
    )
    nearly = replace(bands, responses=responses)
    mended, plain = (
        one_film(engine, nearly, SAMPLES, FILM, touch) / (10 * LEVEL) for touch in (None, _as_mitsuba_has_it)
    )
    means, highest = mended.mean(axis=(0, 1)), plain.mean(axis=(0, 1)).max()
    error = mended.std(axis=(0, 1)).max() / FILM
    words = f"{means.min():.4f} … {means.max():.4f} ± {error:.4f}; without the repair up to {highest:.2f}"
    return Got(words, bool(np.abs(means - 1).max() <= SIGMAS * error))


def _as_mitsuba_has_it(film: Any) -> None:
    """Undo the repair: every node of the density a little different from its neighbours."""
    from ...render.variants import mitsuba

    parameters = mitsuba().traverse(film.sensor_response_function())
    values = np.array(parameters["values"], dtype=float)
    values *= 1 + NEARLY * np.random.default_rng(4).standard_normal(values.size)
    parameters["values"] = type(parameters["values"])(values.tolist())
    parameters.update()


def energy(wavelength_nm: float) -> Got:
    """hc/λ."""
    with localcontext() as context:
        context.prec = 50
        exact = Decimal(PLANCK_J_S) * Decimal(LIGHT_SPEED_M_PER_S) / Decimal(wavelength_nm) * 10**9
    return relative(photon_energy_j(wavelength_nm), float(exact), 1e-15, " J")


def outside(engine: Engine) -> Got:
    """Three bands, the middle one inside the QE curve."""
    bands, lengths = np.stack([np.full((2, 2), n) for n in (1e4, 1000.0, 1e4)], axis=-1), [200.0, 550.0, 1100.0]
    how = {"keep": "electrons", **engine.how}
    frames = expose(bands, camera(), Exposure(0.0), wavelengths_nm=lengths, **how)
    alone = expose(bands[..., 1], camera(), Exposure(0.0), **how)
    assert frames.electrons is not None and alone.electrons is not None
    told = frames.report["outside_qe"]
    named, share = told["wavelengths_nm"], told["share_of_photons"]
    same = bool((frames.electrons == alone.electrons).all())
    words = f"{frames.electrons.mean():g} e-; reported: {named} nm, {share:.4f} of the photons"
    return Got(words, same and named == [200.0, 1100.0] and abs(share - 20 / 21) < 1e-12)


def ends(wavelength_nm: float, qe: float) -> Got:
    """The CCD's curve, 320 to 1100 nm, at its ends and one step beyond them."""
    found = load_camera("eev_44_82").qe([wavelength_nm]).item()
    return largest(abs(found - qe), 1e-12, f"QE {found:g}, off by")


def cases() -> list[Case]:
    """Renders, then photons."""
    return [*_radiance_cases(), *_film_cases(), *_wavelength_cases()]


def _radiance_cases() -> list[Case]:
    expected = "closed forms to 5 roundings; 4095 DN beyond the well"
    return [
        Case("radiance", "irradiance, photons, frame", f"{shown(level)} W m⁻² sr⁻¹ nm⁻¹", expected,
             partial(scales, radiance=level), RENDERERS, 0.2)
        for level in (1e-30, 1e-20, 1e-10, 2e-4, 1.0, 1e10, 1e20, 1e30)
    ]  # fmt: skip


def _film_cases() -> list[Case]:
    scalar = RENDERERS[:1]
    samples, bands = partial(Case, "samples per pixel", "irradiance"), partial(Case, "bands", "irradiance")
    loss = "E = π·L/(4N²) to n·2^(−25) for n ≤ 1024 samples of a pass, and 4 roundings"
    most = "E = π·L/(4N²) to 1024·2^(−25) = 3.1e-5 in passes, whatever the film loses"
    sums = "both the closed form: sums of 16 float32 numbers"
    return [
        *(samples(f"{spp}", loss, partial(sampled, spp=spp), RENDERERS, 0.2) for spp in (1, 2, 100, 10**4)),
        samples(f"{10**5}", loss, partial(sampled, spp=10**5), scalar, 0.2),
        samples(MILLION_WORDS, most, passes_against_one_film, scalar, 2.5),
        bands("31 adjacent bands of 10 nm, and one of 310 nm", sums, adjacent, scalar, 0.1),
        bands("31 bands of height 1 ± 3e-7", "1 in each, within 5 standard errors", nearly_equal_nodes, scalar, 0.5),
    ]


def _wavelength_cases() -> list[Case]:
    curve = ((200.0, 0.0), (319.99, 0.0), (320.0, 0.608), (1100.0, 0.0009), (1100.01, 0.0))
    three = "200, 550 and 1100 nm, a curve from 400 to 710 nm"
    return [
        *(once("wavelength", "photons", f"{shown(nm)} nm", "hc/λ with 50 digits, to 1e-15", partial(energy, nm))
          for nm in (200.0, 550.0, 1100.0)),
        *(once("wavelength", "detection", f"{shown(nm)} nm, a curve from 320 to 1100 nm", f"QE {qe:g}",
               partial(ends, nm, qe)) for nm, qe in curve),
        Case("wavelength", "detection", three, "550 nm alone; the report names the others", outside),
    ]  # fmt: skip
