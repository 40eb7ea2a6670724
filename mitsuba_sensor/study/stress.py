"""``study stress``: stiff and extreme cases on every engine, each compared with the expected result.

stress.toml has the cases. A case gives one number per engine: the deviation over the allowed deviation. Up to 1 holds;
NaN, NumPy warnings and exceptions fail.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import mitsuba_sensor as ms

from ..files.texts import read_toml
from ..pages.page import Dots, Mark, MarkedRow, Section, Study, Table, study_of, table
from .kit import Options, Progress, measured

CASES = read_toml(Path(__file__).with_suffix(".toml"))
SKY = Path(__file__).with_name("sky.xml")
SIGMAS = 5.0
"""Allowed deviation in standard errors: chance exceeds it in 6 of 10 million normal values."""
TENTH = ms.Exposure(0.1)
SHAPE, COUNTED, FRAMES = (16, 16), (512, 512), 8
"""Shape of a frame, shape of averaged counts, and frames for a variance."""
RARE_COUNTS = 5.0
"""Allowed counts beyond a mean far below 1: chance exceeds them in one of a million cases."""
ROUNDINGS = 16.0
"""Allowed rounding errors of a mean, as many as operations of the chain."""
QUANTILES_DN = 2e-3
"""Allowed error of a mean and a variance from the quantile tables [DN, DN²]."""
WELLS = 50.0
"""Largest compared electrons of a pixel in full wells; theory counts no further."""
LEVEL = 0.07
"""Radiance of the sky [W m⁻² sr⁻¹ nm⁻¹]; no multiple is exact in float32, so sums are rounded."""
PASS_SPP, FLOAT32, FLOAT64 = 1024, 2.0**-24, 2.0**-53
"""Most samples that a pass sums in float32, and rounding errors of one operation (IEEE 754)."""
FAILED_SHOWN = 5
"""Unexpected results in the findings."""


class Engine(NamedTuple):
    """An engine.  option : of ``expose``, or the variant of a render, which has no precision."""

    name: str
    option: str
    precision: str = ""

    def expose(
        self, light: ArrayLike, camera: ms.Camera, exposure: ms.Exposure = TENTH, **more: Any
    ) -> ms.Frames:
        """Expose with this engine."""
        asked = {"engine": self.option, "precision": self.precision, **more}
        return ms.expose(light, camera, exposure, **asked)

    def render(self, spp: int, **parameters: float) -> ms.Irradiance:
        """Render the sky in one band at 550 nm."""
        asked: Options = {
            "wavelength_nm": 550.0,
            "variant": self.option,
            "denoise": False,
        }
        return ms.render(SKY, table1(), TENTH, spp=spp, parameters=parameters, **asked)


@cache
def problem_of(engine: Engine) -> str | None:
    """Return the reason why an engine does not work here, or None."""
    try:
        if engine.precision:
            engine.expose(np.ones((1, 1)), table1())
        else:
            engine.render(1)
    except ms.InputError as error:
        return str(error)
    return None


SENSORS = tuple(Engine(*row) for row in CASES["engines"]["sensor"])
RENDERERS = tuple(Engine(*row) for row in CASES["engines"]["renderers"])


class Case(NamedTuple):
    """One case.  off : returns an engine's deviation over the allowed one.  engines : to run."""

    theme: str
    given: str
    off: Callable[[Engine], float]
    engines: tuple[Engine, ...] = SENSORS


def table1(**changes: Any) -> ms.Camera:
    """Return the paper's camera with these changes."""
    return ms.load_camera("konnik_table1").replace(**changes)


@cache
def cameras() -> dict[str, ms.Camera]:
    """Return the paper's camera, the same with every option, and a mosaic camera."""
    every = table1(**CASES["every_option"])
    return {"table 1": table1(), "every option": every, "RGB-IR": ms.load_camera("rgbir_2mp")}


def cases() -> Iterator[Case]:
    """Yield all cases in the order of the page."""
    for theme, conditions in CASES["conditions"].items():
        for photons, time_s, temperature_k in conditions:
            for name, camera in cameras().items():
                given = f"{name}: {photons:g} photons, {time_s:g} s, {temperature_k:g} K"
                exposure = ms.Exposure(time_s, temperature_k)
                yield Case(theme, given, partial(frames_off, photons, camera, exposure))
    for mean_e in CASES["counts"]["means_e"]:
        yield Case("counts", f"λ = {mean_e:g} e-", partial(counts_off, mean_e))
    for given, (mean_e, changes) in CASES["special"].items():
        yield Case("special noise", given, partial(moments_off, mean_e, changes))
    for field, (smallest, needed) in CASES["smallest"].items():
        changes = {field: smallest, **needed}
        yield Case(
            "smallest divisors", f"{field} = {smallest:g}", partial(float64_off, changes)
        )
    for radiance in CASES["renders"]["radiances"]:
        given = f"{radiance:g} W m⁻² sr⁻¹ nm⁻¹"
        yield Case("radiance", given, partial(radiance_off, radiance), RENDERERS)
    for spp in CASES["renders"]["samples"]:
        yield Case("samples per pixel", f"{spp}", partial(samples_off, spp), RENDERERS)


def frames_off(
    photons: float, camera: ms.Camera, exposure: ms.Exposure, engine: Engine
) -> float:
    """Compare the stage means of NumPy in float64 with theory, and other engines' electrons and codes with NumPy's.

    Infinite for electrons outside the well and for codes out of range.
    """
    light = np.full(SHAPE, photons)
    frames = engine.expose(light, camera, exposure, keep=("electrons",))
    electrons, digital = np.float64(frames.electrons), np.float64(frames.digital)
    if electrons.min() < 0 or electrons.max() > camera.pixel.full_well_e:
        return math.inf
    if digital.max() >= 2**camera.adc.bits:
        return math.inf
    if engine == SENSORS[0]:
        return stages_off(frames)
    exact = SENSORS[0].expose(light, camera, exposure, keep=("electrons",))
    gain = camera.system_gain_dn_per_e
    pairs = (electrons, np.float64(exact.electrons), 1.0), (digital, exact.digital, gain)
    off = []
    for found, other, step in pairs:
        error = (
            np.std(other) / math.sqrt(light.size) + RARE_COUNTS * max(step, 1.0) / light.size
        )
        roundoff = ROUNDINGS * FLOAT32 * np.abs(other).max()
        off.append(abs(found.mean() - np.mean(other)) / (error + roundoff))
    return float(max(off))


def stages_off(frames: ms.Frames) -> float:
    """Return the largest deviation of a stage's mean from theory over the allowed one."""
    camera, worst, patterned, pixels = frames.camera, 0.0, False, SHAPE[0] * SHAPE[1]
    steps = {"electrons": 1.0, "volts": camera.readout.sense_gain_uv_per_e * 1e-6}
    steps["DN"] = camera.system_gain_dn_per_e
    for told in frames.report["stages"]:
        patterned = patterned or not {"column", "row"}.isdisjoint(told["name"].split())
        mean, expected, domain = told["mean_frame"], told["mean_expected"], told["domain"]
        temporal, spatial = told["sigma_temporal_expected"], told["sigma_spatial_expected"]
        if not np.isfinite([mean, expected, temporal, spatial]).all():
            return math.nan
        if domain == "electrons":
            mean, expected = (
                min(x, WELLS * camera.pixel.full_well_e) for x in (mean, expected)
            )
        independent = min(SHAPE) if patterned else pixels  # pixels of a line share a pattern
        error = math.sqrt(temporal**2 / pixels + 2 * spatial**2 / independent)
        rest = RARE_COUNTS * steps.get(domain, 0.0) / pixels + QUANTILES_DN * (domain == "DN")
        rest += ROUNDINGS * FLOAT64 * abs(expected)
        worst = max(worst, abs(mean - expected) / (SIGMAS * error + rest or math.inf))
    return worst


def counts_off(mean_e: float, engine: Engine) -> float:
    """Compare mean, variance and third central moment of Poisson counts with λ."""
    camera = quiet(**{"pixel.full_well_e": 1e13, "adc.full_scale_v": None})
    light = np.full(COUNTED, mean_e / electrons_per_photon(camera))
    frames = engine.expose(light, camera, ms.Exposure(0.0), keep=("photoelectrons",))
    held = float(np.dtype(engine.precision).type(mean_e))
    off = np.asarray(frames.photoelectrons) - held
    # variances of off, off², off³: μ₂ = λ, μ₄ − λ² = λ + 2λ², μ₆ − λ² = λ + 24λ² + 15λ³
    variances = np.array([held, held + 2 * held**2, held + 24 * held**2 + 15 * held**3])
    found = np.array([off.mean(), np.square(off).mean() - held, (off**3).mean() - held])
    spacing = np.spacing(np.float32(held)) if engine.precision == "float32" else 0.0
    scale = np.array([1.0, 2 * math.sqrt(held), 3 * held])
    allowed = SIGMAS * np.sqrt(variances / off.size) + RARE_COUNTS / off.size + spacing * scale
    return float(np.max(np.abs(found) / allowed))


def moments_off(mean_e: float, changes: Options, engine: Engine) -> float:
    """Compare mean and temporal variance of several frames, averaged over the pixels, with their expectation."""
    camera = quiet(**changes)
    if engine.precision == "float32" and camera.adc.bits > 23:
        raise ms.InputError("float32 cannot represent codes of 24 bits.")
    light = np.full(SHAPE, mean_e / electrons_per_photon(camera))
    frames = engine.expose(light, camera, ms.Exposure(0.0), frames=FRAMES)
    digital = frames.digital.astype(np.float64)
    off = [digital.mean(axis=0) - frames.clean]
    off.append(digital.var(axis=0, ddof=1) - frames.temporal_variance)
    errors = np.array([one.std(ddof=1) for one in off]) / math.sqrt(light.size)
    return float(np.max(np.abs([one.mean() for one in off]) / (SIGMAS * errors + QUANTILES_DN)))


def float64_off(changes: Options, engine: Engine) -> float:
    """Return the largest difference from the float64 frame; 1 DN is allowed."""
    light, camera = np.full((3, 4), 1000.0), table1(**changes)
    exact = ms.expose(light, camera, TENTH, engine="numpy", precision="float64").digital
    return float(
        np.abs(np.subtract(engine.expose(light, camera).digital, exact, dtype=float)).max()
    )


def radiance_off(radiance: float, engine: Engine) -> float:
    """Compare the irradiance of a sky with E = πL/(4N²)."""
    light, exact = engine.render(16, radiance=radiance, size=2), irradiance(radiance)
    if not np.isfinite(light.standard_error).all():
        return math.nan
    return float(np.abs(light.data / exact - 1).max()) / float32_sum(16)


def samples_off(spp: int, engine: Engine) -> float:
    """Compare the irradiance of many samples, whose passes are summed in float64."""
    light = engine.render(spp, radiance=LEVEL, size=1)
    each = light.statistics.samples_per_pixel // light.statistics.passes
    off = abs(float(light.data.ravel()[0]) / irradiance(LEVEL) - 1)
    return off / float32_sum(min(each, PASS_SPP))


def irradiance(radiance: float) -> float:
    """Return E = πL/(4N²) [W m⁻² nm⁻¹]."""
    return math.pi * radiance / (4 * table1().lens.f_number ** 2)


def float32_sum(count: int) -> float:
    """Return the relative error of a float32 sum of this many equal values and four more roundings."""
    return (count / 2 + 4) * FLOAT32


def quiet(**changes: Any) -> ms.Camera:
    """Return the paper's camera with only shot noise, full well, read noise and ADC, and these changes."""
    return table1(**{"source_follower.white_nv_per_rthz": None, **CASES["quiet"], **changes})


def electrons_per_photon(camera: ms.Camera) -> float:
    """Return the mean photoelectrons of one photon under the most sensitive filter."""
    frames = ms.expose(np.ones(np.shape(camera.tile)), camera, ms.Exposure(0.0), engine="numpy")
    return float(np.max(frames.detected.mean_e))


class Answer(NamedTuple):
    """Result of an engine.  off : deviation over the allowed one.  text : for the page."""

    case: Case
    engine: str
    off: float
    text: str

    @property
    def holds(self) -> bool:
        """True if the deviation is allowed; NaN is not."""
        return self.off <= 1


def answer(case: Case, engine: Engine) -> Answer:
    """Run one case on one engine."""
    off, text = math.nan, ""
    try:
        with warnings.catch_warnings(), np.errstate(divide="warn", over="warn", invalid="warn"):
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            off = case.off(engine)
        text = f"{'✓' if off <= 1 else '✗'} {off:.2g}"
    except ms.InputError as error:
        if "float32" in str(error):  # this precision cannot represent the case
            off, text = 0.0, "✓ refused"
        else:
            text = f"✗ {error}"
    except Exception as error:  # a failed case must not end the study
        text = f"✗ {type(error).__name__}: {error}"
    return Answer(case, engine.name, off, text)


def stress(progress: Progress) -> Study:
    """Run every case on every engine that works here."""
    every, both = list(cases()), (*SENSORS, *RENDERERS)
    here = [engine for engine in both if not problem_of(engine)]

    def ask(case: Case) -> list[Answer]:
        return [answer(case, engine) for engine in here if engine in case.engines]

    steps = {f"{case.theme}: {case.given}": partial(ask, case) for case in every}
    answers = [one for told in measured(steps, progress).values() for one in told]
    failed = [one for one in answers if not one.holds]
    names = [engine.name for engine in here]
    findings = [
        f"{len(answers) - len(failed)} of {len(answers)} results of {len(every)} cases are as expected on "
        f"{', '.join(names)}."
    ]
    for one in failed[:FAILED_SHOWN]:
        findings.append(f"{one.case.theme}, {one.case.given}, {one.engine}: {one.text}")
    if absent := [engine.name for engine in both if engine not in here]:
        findings.append(f"Not tested on this machine: {', '.join(absent)}.")
    parts = picture(answers, names), cases_table(answers, names)
    section = Section(tuple(findings), not failed, parts)
    return study_of("stress", "Stiff and extreme cases", [section])


def picture(answers: Sequence[Answer], engines: Sequence[str]) -> Dots:
    """Draw the largest deviation of each theme on each engine."""
    worst: dict[tuple[str, str], float] = {}
    for one in answers:
        key = one.engine, one.case.theme
        worst[key] = max(worst.get(key, 0.0), one.off)
    themes = tuple(dict.fromkeys(one.case.theme for one in answers))
    series = {}
    for engine in engines:
        found = [worst.get((engine, theme), 0.0) for theme in themes]
        series[engine] = [(off, off, off) if off > 0 else None for off in found]
    exact = {theme for theme in themes if not any(worst.get((x, theme)) for x in engines)}
    return Dots(
        "Largest deviation of each theme",
        "deviation / allowed deviation [1]",
        tuple(f"{theme} (all 0)" if theme in exact else theme for theme in themes),
        series,
        (1.0, "limit"),
        log_x=True,
        note="Averages may deviate by 5 standard errors plus rounding, renders by the rounding of a float32 sum, and "
        "frames with the smallest divisors by 1 DN. Deviations of 0 are not shown.",
    )


def cases_table(answers: Sequence[Answer], engines: Sequence[str]) -> Table:
    """Return a table of every case on every engine."""
    texts: dict[Case, dict[str, Answer]] = {}
    for one in answers:
        texts.setdefault(one.case, {})[one.engine] = one
    rows = list[MarkedRow]()
    for case, told in texts.items():
        mark: Mark = "good" if all(one.holds for one in told.values()) else "bad"
        cells = (told[name].text if name in told else None for name in engines)
        rows.append((mark, (case.theme, case.given, *cells)))
    headings = f"theme | case | {' | '.join(engines)}"
    return table("All cases", headings, rows, "Deviation over the allowed deviation.")
