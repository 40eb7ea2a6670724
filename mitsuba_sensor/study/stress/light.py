"""Light: radiance from 1e-30 to 1e30 W, 1 to a million samples, 31 bands, photons from 200 to 1100 nm."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import replace
from decimal import Decimal, localcontext
from pathlib import Path

import numpy as np

from ... import Exposure, Irradiance, collect, expose, load_camera, render
from ...core import Array
from ...core.units import LIGHT_SPEED_M_PER_S, PLANCK_J_S, photon_energy_j
from ...render.bands import Bands, box_bands
from ...render.photons import photons_per_irradiance
from ...render.scene import load_scene
from ...render.variants import MitsubaObject, choose_variant, mitsuba, use
from .case import FLOAT32, RENDERERS, SIGMAS, TENTH, Engine, Rows, agree, holds, relative, shown, table1, together

SKY = Path(__file__).with_name("sky.xml")
F_NUMBER = 2.8  # of Table 1's lens (cameras/konnik_table1.toml)
LEVEL = 0.07  # radiance [W m⁻² sr⁻¹ nm⁻¹]; no multiple of it is exact in float32, so that sums are rounded
SPP = 16  # samples per pixel where their number is not the question
LARGEST_PASS = 1024  # samples per pixel that a pass may have, so that it loses 3e-5 at most
MILLION_SAMPLES = "1 000 000 in passes, and in one film of Mitsuba's"
NEARLY = 3e-7  # relative spread of the nodes of a spectrum; float32 numbers next to 1 are 1.2e-7 apart
CAMERA = table1(quantum_efficiency__wavelengths_nm=(400.0, 710.0))


def variant(engine: Engine) -> AbstractContextManager[None]:
    """This renderer; the variant that was set comes back afterwards."""
    if mitsuba().variant() is None:
        use(choose_variant())
    context: AbstractContextManager[None] = mitsuba().util.variant_context(engine.option)
    return context


def sky(engine: Engine, radiance: float = LEVEL, size: int = 1, **options: float) -> Irradiance:
    """A render of the sky."""
    with variant(engine):
        parameters = {"radiance": radiance, "size": size}
        return render(SKY, CAMERA, TENTH, parameters=parameters, variant=engine.option, **options)  # type: ignore[arg-type]


def one_film(engine: Engine, bands: Bands, samples: int, size: int, repaired: bool = True) -> Array:
    """Plain Mitsuba: all samples of a pixel in one float32 film, ∫L dλ of 10 nm over that of the sky (H, W, B)."""
    with variant(engine):
        scene = load_scene(SKY, bands, {"radiance": LEVEL, "size": size}, CAMERA)
        if not repaired:  # as Mitsuba has it: every node of the density a little different from its neighbours
            density: MitsubaObject = mitsuba().traverse(scene.sensor.film().sensor_response_function())
            values = np.array(density["values"], dtype=float)
            values *= 1 + NEARLY * np.random.default_rng(4).standard_normal(values.size)
            density["values"] = type(density["values"])(values.tolist())
            density.update()
        return np.asarray(scene.render(1, samples, (0, size)), dtype=np.float64) / (10 * LEVEL)


def irradiance(radiance: float = LEVEL) -> float:
    """E = π·L/(4N²) [W m⁻² nm⁻¹]."""
    return math.pi * radiance / (4 * F_NUMBER**2)


def lost(samples: int) -> float:
    """What n equal numbers lose at most when a float32 adds them up: n roundings of half of the sum, and 4 others."""
    return samples * FLOAT32 / 2 + 4 * FLOAT32


def radiances(engine: Engine) -> Rows:
    """Irradiance by its closed form, photons by theirs, and a frame."""
    (per_irradiance,) = photons_per_irradiance(CAMERA, TENTH, [550.0], [10.0])
    for radiance in (1e-30, 1e-20, 1e-10, 2e-4, 1.0, 1e10, 1e20, 1e30):
        light, exact = sky(engine, radiance, 2, wavelength_nm=550.0, spp=SPP), irradiance(radiance)
        photons = collect(light, CAMERA, TENTH)
        digital = expose(photons, CAMERA, TENTH).digital
        full = photons.mean.min() * 0.6 > 2 * CAMERA.pixel.full_well_e
        good = np.isfinite(light.standard_error).all(), digital.min() == 4095 if full else digital.max() < 4095
        frame, irradiances = holds(f"up to {digital.max()} DN", *good), relative(light.data, exact, lost(1), " W/m²/nm")
        got = together(irradiances, relative(photons.mean, exact * per_irradiance, lost(1)), frame)
        expected = "closed forms to 5 roundings; 4095 DN beyond the well"
        yield "irradiance, photons, frame", f"{shown(radiance)} W m⁻² sr⁻¹ nm⁻¹", expected, got


def samples(engine: Engine) -> Rows:
    """Passes are added up in float64; what is left is what one pass loses, and a million samples in one film."""
    scalar = engine == RENDERERS[0]
    for spp in (1, 2, 100, 10**4, *([10**5, 10**6] if scalar else [])):
        light = sky(engine, spp=spp, wavelength_nm=550.0)
        done, off = light.statistics, float(light.data.ravel()[0]) / irradiance() - 1
        each = done.samples_per_pixel // done.passes
        if spp < 10**6:
            got = holds(f"{off:+.1e}: {done.passes} passes of {each}", abs(off) <= lost(min(each, LARGEST_PASS)))
            expected = "E = π·L/(4N²) to n·2^(−25) for n ≤ 1024 samples of a pass, and 4 roundings"
            yield "irradiance", str(spp), expected, got
    if scalar:
        film = float(one_film(engine, box_bands(CAMERA, np.array([545.0, 555.0])), 10**6, 1).ravel()[0]) - 1
        got = holds(f"passes {off:+.1e}, one film {film:+.1e}", abs(off) <= lost(LARGEST_PASS))
        expected = "E = π·L/(4N²) to 1024·2^(−25) = 3.1e-5 in passes, whatever the film loses"
        yield "irradiance", MILLION_SAMPLES, expected, got


def bands(engine: Engine) -> Rows:
    """Each wavelength falls into some band, so that the sum of adjacent ones has no noise at all; and 31 bands with a
    density of wavelengths that is nearly flat, which Mitsuba inverts by a formula that cancels (render/bands.py)."""
    cube = sky(engine, size=4, spp=SPP, bandwidth_nm=10.0)
    wide = sky(engine, size=4, spp=SPP, bandwidth_nm=310.0, wavelength_nm=555.0)
    sums = cube.data.astype(np.float64) @ cube.bandwidths_nm / 310
    got = together(*(relative(x, irradiance(), lost(SPP), " W/m²/nm") for x in (sums, wide.data)))
    expected = "both the closed form: sums of 16 float32 numbers"
    yield "irradiance", "31 adjacent bands of 10 nm, and one of 310 nm", expected, got
    edges = np.linspace(400, 710, 32)
    heights = 1 + NEARLY * np.random.default_rng(3).standard_normal(31)
    rows = zip(edges[:-1].tolist(), edges[1:].tolist(), heights.tolist(), strict=True)
    nodes = ({"wavelengths": f"{low}, {high}", "values": f"{y!r}, {y!r}"} for low, high, y in rows)
    nearly = replace(box_bands(CAMERA, edges), responses=tuple({"type": "irregular", **node} for node in nodes))
    mended, plain = (one_film(engine, nearly, 400, 16, repaired) for repaired in (True, False))
    error, highest = mended.std(axis=(0, 1)).max() / 16, plain.mean(axis=(0, 1)).max()
    means = agree(mended.mean(axis=(0, 1)), 1.0, SIGMAS * error)
    got = holds(f"{means.text} ± {error:.4f}; without the repair up to {highest:.2f}", means.passed)
    yield "irradiance", "31 bands of height 1 ± 3e-7", "1 in each, within 5 standard errors", got


def wavelength_formulas(_: Engine) -> Rows:
    """hc/λ; the CCD's curve, 320 to 1100 nm, at its ends and one step beyond them."""
    for nm in (200.0, 550.0, 1100.0):
        with localcontext(prec=50):
            exact = Decimal(PLANCK_J_S) * Decimal(LIGHT_SPEED_M_PER_S) / Decimal(nm) * 10**9
        got = relative(photon_energy_j(nm), float(exact), 1e-15, " J")
        yield "photons", f"{shown(nm)} nm", "hc/λ with 50 digits, to 1e-15", got
    for nm, qe in ((200.0, 0.0), (319.99, 0.0), (320.0, 0.608), (1100.0, 0.0009), (1100.01, 0.0)):
        got = agree(load_camera("eev_44_82").qe([nm]).item(), qe, 1e-12)
        yield "detection", f"{shown(nm)} nm, a curve from 320 to 1100 nm", f"QE {shown(qe)}", got


def wavelengths(engine: Engine) -> Rows:
    """Three bands, the middle one inside the QE curve."""
    layers, nm = np.tile([1e4, 1000.0, 1e4], (2, 2, 1)), [200.0, 550.0, 1100.0]
    frames = engine.expose(layers, CAMERA, Exposure(0.0), wavelengths_nm=nm, keep="electrons")
    alone = engine.expose(layers[..., 1], CAMERA, Exposure(0.0), keep="electrons")
    told = frames.report["outside_qe"]
    named = holds(f"reported: {told['wavelengths_nm']} nm", told["wavelengths_nm"] == [200.0, 1100.0])
    share = agree(told["share_of_photons"], 20 / 21, 1e-12, " of the photons")
    got = together(agree(frames.electrons, alone.electrons, unit=" e-"), named, share)
    given = "200, 550 and 1100 nm, a curve from 400 to 710 nm"
    yield "detection", given, "550 nm alone; the report names the others", got
