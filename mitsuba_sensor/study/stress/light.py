"""Light and electrons: radiance and Poisson means to 1e30, a million samples, 31 bands, full wells, fixed patterns."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from decimal import Decimal, localcontext
from pathlib import Path

import numpy as np
from scipy import stats

from ... import Exposure, Irradiance, Stage, collect, expose, load_camera, render
from ...core import Array, Electrons, Frame, Moments, SensorWindow
from ...core.units import BOLTZMANN_J_PER_K, ELEMENTARY_CHARGE_C, LIGHT_SPEED_M_PER_S, PLANCK_J_S, photon_energy_j
from ...render.light.bands import Bands, box_bands
from ...render.light.photons import photons_per_irradiance
from ...render.scene.scene import load_scene
from ...render.variants import MitsubaObject, choose_variant, mitsuba, use
from ...sensor.effects.dark_current import mean_dark_e
from ...sensor.stage import propagate
from .case import CASES as TABLES
from .case import RARE, SIGMAS, TENTH, Engine, Rows, agree, holds, relative, shown, stage_of, table1, to_numpy, together

SKY = Path(__file__).with_name("sky.xml")
LEVEL = 0.07  # radiance [W m⁻² sr⁻¹ nm⁻¹]; no multiple of it is exact in float32, so that sums are rounded
SPP = 16  # samples per pixel where their number is not the question
LARGEST_PASS = 1024  # samples per pixel that a pass may have, so that it loses 3e-5 at most
MILLION_SAMPLES = "1 000 000 in passes, and in one film of Mitsuba's"
NEARLY = 3e-7  # relative spread of the nodes of a spectrum; float32 numbers next to 1 are 1.2e-7 apart
CAMERA = table1(quantum_efficiency__wavelengths_nm=(400.0, 710.0))
ROUNDED = 1e-12  # exponents reach 1700 at 4 K, and an exponential loses that many unit roundoffs: 4e-13
MEANS = (1e-6, 0.1, 1.0, 9.99, 10.0, 30.0, 1e3, 1e5, 1e7, 1e12)  # from 10 on expanded; above 2^24 not all float32


def variant(engine: Engine) -> AbstractContextManager[None]:
    """This renderer; the variant that was set comes back afterwards."""
    if mitsuba().variant() is None:
        use(choose_variant())
    return mitsuba().util.variant_context(engine.option)  # type: ignore[no-any-return]


def sky(engine: Engine, radiance: float = LEVEL, size: int = 1, **options: float) -> Irradiance:
    """A render of the sky."""
    with variant(engine):
        parameters = {"radiance": radiance, "size": size}
        return render(SKY, CAMERA, TENTH, parameters=parameters, variant=engine.option, denoise=False, **options)  # type: ignore[arg-type]


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
    return math.pi * radiance / (4 * 2.8**2)  # of Table 1's lens


def lost(samples: int) -> float:
    """What n equal numbers lose at most when a float32 adds them up: n roundings of half of the sum, and 4 others."""
    return (samples / 2 + 4) * 2.0**-24  # the unit roundoff of float32 (IEEE 754)


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
    scalar = engine.compiler == "scalar"
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
    """Adjacent bands and a wide one, sampled for the colour filters too, which leaves noise of λ; and 31 with a nearly
    flat density, whose inverse in Mitsuba cancels."""
    cube = sky(engine, size=4, spp=SPP, bandwidth_nm=10.0)
    wide = sky(engine, size=4, spp=SPP, bandwidth_nm=310.0, wavelength_nm=555.0)
    sums = cube.data.astype(np.float64) @ cube.bandwidths_nm / 310
    error = SIGMAS * float(np.mean(wide.standard_error.astype(np.float64) ** 2) ** 0.5)
    found = (sums, 1e-4 * irradiance()), (wide.data[..., 0], error)
    got = together(*(agree(x, irradiance(), allowed, " W/m²/nm") for x, allowed in found))
    expected = "both the closed form: the sum to 1e-4, the wide band within 5 standard errors"
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


def poisson(engine: Engine) -> Rows:
    """Counts of a flat light, and what a well of 33000 e- makes of many."""

    def counts(mean: float, side: int, *stages: Stage) -> Array:
        return engine.through(np.full((side, side), mean), stage_of("shot noise"), *stages, electrons=True)

    for mean in (0.0, 1e-12):
        yield "shot noise", f"λ = {shown(mean)}", "0 electrons in a million pixels", agree(counts(mean, 1024), 0.0)
    for mean in MEANS:
        held, counted = float(np.dtype(engine.precision).type(mean)), counts(mean, 512)
        off = counted - held  # standard errors by μ₄ − λ² = λ + 2λ², μ₆ − λ² = λ + 24λ² + 15λ³
        variances = np.array([held, held + 2 * held**2, held + 24 * held**2 + 15 * held**3])
        allowed = SIGMAS * np.sqrt(variances / off.size) + RARE / off.size
        moments = agree([np.mean(off**power) for power in (1, 2, 3)], [0.0, held, held], allowed)
        whole = (np.floor(counted) == counted).all() and counted.min() >= 0
        got = together(moments, holds("whole numbers" if whole else "not whole", whole))
        expected = "mean λ, variance λ, skewness λ^(−½) within 5 standard errors of 262 144 whole numbers"
        yield "shot noise", f"λ = {shown(mean)}", expected, got
    for mean in (1e12, 1e30, math.inf):
        full = agree(counts(mean, 64, stage_of("full well")), 33_000.0, unit=" e- in the well")
        got = together(relative(counts(mean, 64), min(mean, 1e30), 1e-5, " counted"), full)
        yield "shot noise, full well", f"λ = {shown(mean)}", "finite, no hang, then 33000 e- exactly", got


def full_well(engine: Engine) -> Rows:
    """The whole camera with the dark left out; and light, dark, or both beyond the well."""
    for well in (1.0, 33_000.0, 5e7):
        counted = well * engine.unit < 1  # whole numbers are exact
        light = np.geomspace(well / 100, well * 100, 200).reshape(10, 20)
        camera = table1(pixel__full_well_e=well, adc__bits=16)
        electrons: Array = engine.expose(light, camera, Exposure(0.0), keep="electrons").electrons
        whole, odd = (electrons == np.floor(electrons)).all(), (electrons % 2 == 1).any()
        text = f"at most {electrons.max():.10g}, odd counts {'too' if odd else 'are left out'}"
        got = holds(text, electrons.max() == well, whole, odd or not counted)
        expected = "that many at most, exactly; whole numbers, and odd ones among them up to 2^24 or in float64"
        yield "full well", f"{shown(well)} e-, light from 1 % to 100 wells", expected, got
        both = [0, 1, well - 1, well, well + 1, 1e12, 1e30, 0, 5], [0, 1, 1, 0, 3, 1e12, 7, well + 5, well]
        frame, allowed = engine.frame((1, 9)), 0.0 if counted else 2 * engine.unit * well
        before = (frame.window.backend.from_numpy(np.array([x], np.float64), frame.window) for x in both)
        after = stage_of("full well", pixel__full_well_e=well).sample(Electrons(*before), frame)
        total, *parts = to_numpy([after, after.light, after.dark], frame)
        got = agree(total, np.minimum(np.add(*both), well)[None], allowed, " e-", np.min(parts) >= 0)
        expected = "min(light + dark, full well), exactly up to 2^24 or in float64, else to a float32 step"
        yield "full well", f"{shown(well)} e-, light or dark or both beyond it", expected, got


def activation(kelvin: Decimal, power: str = "1.5", divisor: int = 2) -> Decimal:
    """What a dark current is at T over what it is at 300 K (paper eq. 1, by default, and 2); 0 at 0 K."""
    if not kelvin:
        return Decimal(0)
    gaps = ((Decimal("1.1557") - Decimal("7.021e-4") * t**2 / (1108 + t)) / t for t in (Decimal(300), kelvin))
    warm, cold = (x * Decimal(ELEMENTARY_CHARGE_C) / Decimal(BOLTZMANN_J_PER_K) for x in gaps)  # E_g/kT (paper eq. 3)
    return (kelvin / 300) ** Decimal(power) * ((warm - cold) / divisor).exp()


def rated(rate_e_per_s: float, kelvin: float, **more: object) -> dict[str, object]:
    """A datasheet's dark current that was measured at this temperature."""
    rate = {"fom_na_per_cm2": None, "rate_e_per_s": rate_e_per_s, "at_temperature_k": kelvin}
    return {f"dark_current__{name}": value for name, value in {**rate, **more}.items()}


def dark_current(_: Engine) -> Rows:
    """Ours and that of 50 digits, below the smallest float64 taken for 0 [e-/s]."""
    warm, half, kelvins = Decimal("298.15"), rated(5.0, 298.15), (0.0, 5e-324, 4.0, 77.0, 133.0, 300.0, 400.0, 600.0)
    nanoampere = Decimal("1e-9") * Decimal(5.7e-4**2) / Decimal(ELEMENTARY_CHARGE_C)  # 1 nA/cm² on 5.7 µm [e-/s]
    diffusion, doubling = {"dark_current__diffusion_fom_na_per_cm2": 0.1}, {**half, "dark_current__doubling_k": 7.0}
    models: dict[str, tuple[Mapping[str, object], Callable[[Decimal], Decimal]]] = {
        "figure of merit, 1 nA/cm²": ({}, lambda t: nanoampere * activation(t)),
        "MPP, 0.1 and 1 nA/cm²": (diffusion, lambda t: nanoampere * (activation(t, "3", 1) / 10 + activation(t))),
        "5 e-/s at 298.15 K": (half, lambda t: 5 * activation(t) / activation(warm)),
        "5 e-/s at 298.15 K, doubling in 7 K": (doubling, lambda t: 5 * Decimal(2) ** ((t - warm) / 7)),
    }
    for (name, (changes, rate)), kelvin in itertools.product(models.items(), kelvins):
        with localcontext(prec=50, Emin=-(10**17)):
            exact = float(rate(Decimal(kelvin)))
        got = relative(mean_dark_e(table1(**changes), Exposure(1.0, kelvin)), exact, ROUNDED, " e-/s")
        expected = "closed form with 50 digits to 1e-12, exactly 0 where that underflows"
        yield "dark current", f"{shown(kelvin)} K; {name}", expected, got


SHAPE, ONE_SECOND, TENTHS = (256, 256), Exposure(1.0, 300.0), np.arange(1, 10) / 10
SLIGHT = (5e-324, 1e-150, 1e-9)
FARTHEST = 25.0  # σ of the widest tail, the logistic one's: ln(2³³)·√3/π = 12.6, and as many for coupled neighbours
HEAVY = {  # at a width of 10 a few pixels carry the mean, which does not converge: shares of pixels are looked at
    "lognormal": lambda cv: stats.lognorm(math.sqrt(math.log1p(cv**2)), scale=(1 + cv**2) ** -0.5),
    "gamma": lambda cv: stats.gamma(cv**-2, scale=cv**2),
    "wald": lambda cv: stats.invgauss(cv**2, scale=cv**-2),
}
COUPLED = (1 - 4 * 0.25**2) ** 1.5 / (1 - 2 * 0.25) ** 2  # so much more does the mean of a coupled map vary
SMALLEST_COMPARED = 1e-25  # float32 engines hold e^(−69) at least; what is below is next to nothing anyway


def pattern(engine: Engine, light: float, *stages: Stage) -> tuple[Array, float, float]:
    """Mean electrons (H, W) that these stages make of so many in a second at 300 K; mean and variance in theory."""
    theory = propagate(stages, Moments(light, 0.0, 0.0, Frame(ONE_SECOND, SensorWindow(7, SHAPE))))
    values = engine.through(np.full(SHAPE, light), *stages, electrons=True, exposure=ONE_SECOND)
    return values, float(theory.mean), float(theory.spatial)


def of_family(engine: Engine, option: str, cv: float) -> tuple[Array, float, float]:
    """A map of mean 1, and its moments."""
    if not option:
        return pattern(engine, 1.0, stage_of("prnu", pixel__prnu=cv))
    coupling = {"coupling": 0.25} if option == "ar" else {}
    return pattern(engine, 0.0, stage_of("dark current", **rated(1.0, 300.0, distribution=option, cv=cv, **coupling)))


def fixed_patterns(engine: Engine) -> Rows:
    """Every family at every width. Shapes are cv⁻² and would overflow; variances are differences and would cancel."""
    for family, option in TABLES["families"].items():
        stage, answers, near = "dark current" if option else "prnu", [], []
        for cv in (0.0, 0.01, 0.4, 1.0, 10.0):
            x, exact, variance = of_family(engine, option, cv)
            error = math.sqrt(variance / x.size) * (COUPLED if option == "ar" else 1.0)
            found, allowed = x.mean(), SIGMAS * error + 2 * engine.unit
            if option in HEAVY and cv > 1:
                deciles = HEAVY[option](cv).ppf(TENTHS)
                exact, deciles = TENTHS[deciles > SMALLEST_COMPARED], deciles[deciles > SMALLEST_COMPARED]
                found = (x[..., None] <= deciles).mean(axis=(0, 1))
                allowed = SIGMAS * np.sqrt(exact * (1 - exact) / x.size)
            sign = holds(f"from {x.min():.3g}", np.isfinite(x).all(), x.min() >= 0)
            answers += [agree(found, exact, allowed), sign]
        errors = "5 standard errors of 65 536 pixels"
        kept = f"mean kept within {errors} (of a heavy tail at 10 its deciles), no pixel below 0"
        yield stage, f"{family}; coefficients of variation 0, 0.01, 0.4, 1, 10", kept, together(*answers)
        for cv in SLIGHT:
            x, _, variance = of_family(engine, option, cv)
            near += [agree(x, 1.0, FARTHEST * cv + 2 * engine.unit), relative(variance, cv * cv, ROUNDED)]
        expected = "no pixel farther from 1 than 25 times that, or than roundings; theory has its variance"
        yield stage, f"{family}; {', '.join(map(shown, SLIGHT))}", expected, together(*near)
    for cv in (1e-200, 1e-6, 0.005, 0.1):
        dark = stage_of("dark current", **rated(1e4, 300.0, cv=cv, distribution="lognormal"))
        total, _, variance = pattern(engine, 1e4, stage_of("prnu", pixel__prnu=cv), dark)
        error = math.sqrt((2 + 16 * cv**2) / total.size) * variance  # a narrow log-normal has an excess of 16·cv²
        got = agree(total.var(), variance, SIGMAS * error + (2e4 * 2 * engine.unit) ** 2, " e-²")
        yield "prnu, dark current", f"{shown(cv)} on 1e4 e- each", "σ as in theory, to its standard error", got
