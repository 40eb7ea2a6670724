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

from ...core.exposure import Exposure
from ...core.units import LIGHT_SPEED_M_PER_S, PLANCK_J_S, photon_energy_j
from ...render.bands import Bands, box_bands
from ...render.irradiance import Irradiance
from ...render.photons import collect, photons_per_irradiance
from ...render.prepared import render
from ...render.scene import load_scene
from ...render.variants import choose_variant, mitsuba, use
from ...sensor.camera import Camera, load_camera
from ...sensor.expose import expose
from ..statistics import Array
from .case import FLOAT32, ONLY_ONCE, RENDERERS, SIGMAS, TENTH, Case, Engine, cases_of, table1
from .got import Got, agree, holds, relative, together

F_NUMBER = 2.8  # of Table 1's lens (cameras/konnik_table1.toml)
LEVEL = 0.07  # radiance [W m⁻² sr⁻¹ nm⁻¹]; no multiple of it is exact in float32, so that sums are rounded
EDGES_NM = np.linspace(400, 710, 32)  # of 31 bands of 10 nm
SPP = 16  # samples per pixel where their number is not the question
LARGEST_PASS = 1024  # samples per pixel that a pass may have, so that it loses 3e-5 at most


def camera() -> Camera:
    """Table 1, which sees 400 to 710 nm."""
    return table1(quantum_efficiency__wavelengths_nm=(400.0, 710.0))


@contextmanager
def variant(engine: Engine) -> Iterator[Path]:
    """The scene file, with this renderer; the variant that was set comes back afterwards."""
    mi = mitsuba()
    before = mi.variant() or choose_variant().name
    with resources.as_file(resources.files(__package__) / "sky.xml") as path:
        try:
            use(choose_variant(engine.word))
            yield path
        finally:
            if mi.variant() != before:
                mi.set_variant(before)


def sky(engine: Engine, radiance: float = LEVEL, size: int = 1, **options: Any) -> Irradiance:
    """A render of it."""
    with variant(engine) as path:
        given = {"radiance": radiance, "size": size}
        return render(path, camera(), TENTH, parameters=given, variant=engine.word, **options)


def one_film(engine: Engine, bands: Bands, samples: int, size: int = 1, touch: Any = None) -> Array:
    """Plain Mitsuba: all samples of a pixel in one float32 film, ∫L dλ of each band (H, W, B).

    touch : called with the film before it is used.
    """
    with variant(engine) as path:
        scene = load_scene(path, bands, {"radiance": LEVEL, "size": size}, camera())
        if touch is not None:
            touch(scene.sensor.film())
        return np.asarray(scene.render(1, samples, (0, size)), dtype=np.float64)


def irradiance(radiance: float) -> float:
    """E = π·L/(4N²) [W m⁻² nm⁻¹]."""
    return math.pi * radiance / (4 * F_NUMBER**2)


def lost(samples: int) -> float:
    """What n equal numbers lose at most when a float32 adds them up: each sum is rounded to 2^(−24) of itself, and is
    half of the last on average. Beside it: a few roundings of what is added up, and of what comes out."""
    return samples * FLOAT32 / 2 + 4 * FLOAT32


def scales(engine: Engine, radiance: float) -> Got:
    """Irradiance by its closed form, photons by theirs, and a frame."""
    light = sky(engine, radiance, 2, wavelength_nm=550.0, spp=SPP)
    photons, exact = collect(light, camera(), TENTH), irradiance(radiance)
    (per_irradiance,) = photons_per_irradiance(camera(), TENTH, [550.0], [10.0])
    digital = expose(photons, camera(), TENTH).digital
    full = photons.mean.min() * 0.6 > 2 * camera().pixel.full_well_e
    good = np.isfinite(light.standard_error).all(), digital.min() == 4095 if full else digital.max() < 4095
    closed = relative(light.data, exact, lost(1), " W/m²/nm"), relative(photons.mean, exact * per_irradiance, lost(1))
    return together(*closed, holds(f"up to {digital.max()} DN", *good))


def sampled(engine: Engine, spp: int) -> Got:
    """Passes are added up in float64; what is left is what one pass loses."""
    light = sky(engine, spp=spp, wavelength_nm=550.0)
    done = light.statistics
    each = done.samples_per_pixel // done.passes
    off = float(light.data.ravel()[0]) / irradiance(LEVEL) - 1
    return holds(f"{off:+.1e}: {done.passes} passes of {each}", abs(off) <= lost(min(each, LARGEST_PASS)))


MILLION, MILLION_SAMPLES = 10**6, "1 000 000 in passes, and in one film of Mitsuba's"


def passes_against_one_film(engine: Engine) -> Got:
    """What a million samples lose in one film."""
    passes = sky(engine, spp=MILLION, wavelength_nm=550.0)
    bands = box_bands(camera(), np.array([545.0, 555.0]))
    film = float(one_film(engine, bands, MILLION).ravel()[0]) / (10 * LEVEL) - 1
    ours = float(passes.data.ravel()[0]) / irradiance(LEVEL) - 1
    return holds(f"passes {ours:+.1e}, one film {film:+.1e}", abs(ours) <= lost(LARGEST_PASS))


def adjacent(engine: Engine) -> Got:
    """31 bands of 10 nm and one of 310 nm; each wavelength falls into some band, so their sum has no noise at all."""
    cube = sky(engine, size=4, spp=SPP, bandwidth_nm=10.0)
    wide = sky(engine, size=4, spp=SPP, bandwidth_nm=310.0, wavelength_nm=555.0)
    sums = cube.data.astype(np.float64) @ cube.bandwidths_nm / 310
    return together(*(relative(x, irradiance(LEVEL), lost(SPP), " W/m²/nm") for x in (sums, wide.data)))


NEARLY = 3e-7  # relative spread of the nodes; float32 numbers next to 1 are 1.2e-7 apart
FILM, SAMPLES = 16, 400


def nearly_equal_nodes(engine: Engine) -> Got:
    """31 bands of height 1 ± 3e-7, with the repaired density of wavelengths, and with one as nearly flat as they.

    (Mitsuba inverts the density by a formula that cancels in float32 there; render/bands.py.)
    """
    bands = box_bands(camera(), EDGES_NM)
    heights = 1 + NEARLY * np.random.default_rng(3).standard_normal(len(bands))
    responses = tuple(
        {"type": "irregular", "wavelengths": f"{low}, {high}", "values": f"{height!r}, {height!r}"}
        for low, high, height in zip(EDGES_NM[:-1].tolist(), EDGES_NM[1:].tolist(), heights.tolist(), strict=True)
    )
    nearly = replace(bands, responses=responses)
    mended, plain = (one_film(engine, nearly, SAMPLES, FILM, touch) / (10 * LEVEL) for touch in (None, unrepaired))
    error, highest = mended.std(axis=(0, 1)).max() / FILM, plain.mean(axis=(0, 1)).max()
    means = agree(mended.mean(axis=(0, 1)), 1.0, SIGMAS * error)
    return holds(f"{means.text} ± {error:.4f}; without the repair up to {highest:.2f}", means.passed)


def unrepaired(film: Any) -> None:
    """As Mitsuba has it: every node of the density a little different from its neighbours."""
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
    bands, nm = np.stack([np.full((2, 2), n) for n in (1e4, 1000.0, 1e4)], axis=-1), [200.0, 550.0, 1100.0]
    options: dict[str, Any] = {"keep": "electrons", **engine.how}
    frames = expose(bands, camera(), Exposure(0.0), wavelengths_nm=nm, **options)
    alone = expose(bands[..., 1], camera(), Exposure(0.0), **options)
    told = frames.report["outside_qe"]
    named = holds(f"reported: {told['wavelengths_nm']} nm", told["wavelengths_nm"] == [200.0, 1100.0])
    share = agree(told["share_of_photons"], 20 / 21, 1e-12, " of the photons")
    return together(agree(frames.electrons, alone.electrons, unit=" e-"), named, share)


def curve_ends(wavelength_nm: float, qe: float) -> Got:
    """The CCD's curve, 320 to 1100 nm, at its ends and one step beyond them."""
    return agree(load_camera("eev_44_82").qe([wavelength_nm]).item(), qe, 1e-12)


def light_cases() -> list[Case]:
    """Renders, then photons."""
    rendered = partial(cases_of, asked=RENDERERS)
    scalar = partial(cases_of, asked=RENDERERS[:1])
    radiances, counts = (1e-30, 1e-20, 1e-10, 2e-4, 1.0, 1e10, 1e20, 1e30), (1, 2, 100, 10**4)
    curve = ((200.0, 0.0), (319.99, 0.0), (320.0, 0.608), (1100.0, 0.0009), (1100.01, 0.0))
    closed = "closed forms to 5 roundings; 4095 DN beyond the well"
    loss = "E = π·L/(4N²) to n·2^(−25) for n ≤ 1024 samples of a pass, and 4 roundings"
    most = "E = π·L/(4N²) to 1024·2^(−25) = 3.1e-5 in passes, whatever the film loses"
    two, adjacent_bands = (
        "both the closed form: sums of 16 float32 numbers",
        "31 adjacent bands of 10 nm, and one of 310 nm",
    )
    nearly, each = "31 bands of height 1 ± 3e-7", "1 in each, within 5 standard errors"
    three = "200, 550 and 1100 nm, a curve from 400 to 710 nm"
    samples = ("samples per pixel", "irradiance")
    return [
        *rendered(
            "radiance", "irradiance, photons, frame", "{} W m⁻² sr⁻¹ nm⁻¹", closed, scales, radiances, seconds=0.2
        ),
        *rendered(*samples, "{}", loss, sampled, counts, seconds=0.2),
        *scalar(*samples, "{}", loss, sampled, (10**5,), seconds=0.2),
        *scalar(*samples, MILLION_SAMPLES, most, passes_against_one_film, seconds=2.5),
        *scalar("bands", "irradiance", adjacent_bands, two, adjacent, seconds=0.1),
        *scalar("bands", "irradiance", nearly, each, nearly_equal_nodes, seconds=0.5),
        *cases_of(
            "wavelength", "photons", "{} nm", "hc/λ with 50 digits, to 1e-15", energy, (200.0, 550.0, 1100.0), ONLY_ONCE
        ),
        *cases_of(
            "wavelength", "detection", "{} nm, a curve from 320 to 1100 nm", "QE {1}", curve_ends, curve, ONLY_ONCE
        ),
        *cases_of("wavelength", "detection", three, "550 nm alone; the report names the others", outside),
    ]
