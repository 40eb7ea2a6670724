"""Frames against theory near edges of codes and clips, their derivatives, cooled defects; values that are refused."""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import replace
from functools import partial

import numpy as np

from ... import Camera, Exposure, differentiable, expose, load_camera
from ...core import Frame, SensorWindow
from ...core.units import BOLTZMANN_EV_PER_K
from ...lab.statistics.estimators import standard_error
from ...render.passes.requirements import electrons_moved, grouped_electrons
from ...sensor.chain import black_level_dn
from ...sensor.gains import gain_dn_per_e
from ...sensor.light_kind import Expected
from ...sensor.theory import Theory
from . import light as lights
from .case import CASES as TABLES
from .case import NAME, SIGMAS, TENTH, Engine, Rows, agree, holds, refusal, relative, shown, stage_of, table1, together

SHAPE, FRAMES, ZERO = (96, 128), 8, Exposure(0.0)
LEFT_DN = 2e-3  # of mean and σ, what quantiles and tables leave of a theory
QUIET = {"pixel.prnu": 0.0, "dark_current.fom_na_per_cm2": 0.0, "readout.dsnu_col": 0.0, "adc.black_level_dn": 300.0}
QUIET |= {"source_follower.corner_hz": 0.0, "source_follower.read_noise_e": 6.0}


def quiet(**changes: object) -> Camera:
    """Shot noise, full well, read noise and converter; nothing fixed."""
    return load_camera(NAME).replace(**{"source_follower.white_nv_per_rthz": None, **QUIET, **changes})


def theory(camera: Camera, electrons: object, exposure: Exposure = ZERO) -> Expected:
    """Moments of the digital numbers at some mean electrons."""
    made = Theory.of(camera.stages, Frame(exposure, SensorWindow(0, (1, 1))))
    return made.digital(np.atleast_1d(np.asarray(electrons, np.float64)))


def shots(engine: Engine) -> Rows:
    """Flat light on cameras whose noise is hard to foresee; and a ramp under a plan, where a count met an edge."""
    for one, light_e in ((row, light_e) for row in TABLES["shots"] for light_e in row["light_e"]):
        maps = {"read_noise": np.resize(one["map_e"], SHAPE)} if "map_e" in one else None
        light = np.full(SHAPE, light_e / 0.6)
        shot = engine.expose(light, quiet(**one["camera"]), ZERO, frames=FRAMES, maps=maps)
        exact = np.ravel(shot.theory.theories[0].digital(np.array([light_e])))
        mean, temporal = shot.digital.mean(axis=0), shot.digital.var(axis=0, ddof=1)
        spatial = (mean - exact[0]) ** 2 - temporal / FRAMES  # from theory, less what the noise adds
        found, errors = np.array([(x.mean(), standard_error(x.ravel())) for x in (mean, temporal, spatial)]).T
        left = LEFT_DN * np.array([1.0, *(2 * np.sqrt(exact[1:]) + LEFT_DN)])
        text = ", ".join(f"{x:.5g} ({y:.5g})" for x, y in zip(found, exact, strict=True))
        expected = "mean, temporal and spatial variance of 8 frames as in (theory) [DN], within 5 standard errors"
        got = holds(text, *(np.abs(found - exact) <= SIGMAS * errors + left))
        yield one["stage"], f"{one['given']}, light of {shown(light_e)} e-", expected, got
    ramp = np.tile(np.linspace(0.0, 3000.0, 512), (256, 1))
    shot = engine.expose(ramp, load_camera("rgbir_2mp"), ZERO, tolerance_dn=1.0, frames=FRAMES)
    average = shot.theory.averages(shot.stages[-1])
    allowed = SIGMAS * math.sqrt((average.temporal / FRAMES + average.spatial) / ramp.size)
    got = agree(shot.digital.mean(), average.mean, allowed, " DN")
    yield "adc", "rgbir_2mp, plan of 1 DN, ramp to 3000 photons", "mean of theory, within 5 standard errors", got


def defects(engine: Engine) -> Rows:
    """Telegraph signals of any frame number; and defects in the cold, each with an activation energy of its own."""
    camera = quiet(**TABLES["traps"])
    exact = theory(camera, 0.0, TENTH)
    sigma, took = math.sqrt(exact.temporal[0] + exact.spatial[0]), list[float]()
    for index in (0, 50_000, 2**31, 2**32 - 1):
        for _ in range(2):  # the first one may compile
            started = time.perf_counter()
            digital = engine.expose(np.zeros((128, 128)), camera, first_frame=index).digital
        took.append(time.perf_counter() - started)
        mean = agree(digital.mean(), exact.mean[0], SIGMAS * sigma / 128, " DN", took[-1] < 10 * took[0] + 0.5)
        got = together(mean, relative(digital.std(), sigma, 0.05, f" DN in {took[-1]:.2f} s"))
        expected = (
            "mean of theory within 5 standard errors, σ to 5 %; 10 times the time of frame 0 at most, or 0.5 s more"
        )
        yield "RTS pixels", f"frame {index}; switching once in 10 000 frames", expected, got
    hot = {"weight": 1.0, "family": "normal", "mean": 1e3, "sigma": 0.0, "unit": "e_per_s", "at_temperature_k": 300.0}
    always = {"fraction": 1.0, "amplitude_e_per_s": 1e3, "duty": 1.0}
    for ev, kelvin in itertools.product((0.3, 0.56, 0.9), (300.0, 200.0, 120.0)):
        rts = {f"dark_current__rts_{name}": x for name, x in {**always, "activation_ev": ev}.items()}
        dark = stage_of("dark current", dark_current__components=[{**hot, "activation_ev": ev}])
        at, rate = Exposure(1.0, kelvin), 1e3 * math.exp(ev / BOLTZMANN_EV_PER_K * (1 / 300 - 1 / kelvin))
        electrons = (
            engine.through(np.zeros((2, 2)), stage, electrons=True, exposure=at)
            for stage in (dark, stage_of("rts pixels", **rts))
        )
        got = relative(np.array([*electrons]), rate, 1e-6, " e-")
        yield (
            "dark current, RTS pixels",
            f"1000 e-/s at 300 K, {ev} eV, {shown(kelvin)} K",
            "Arrhenius' law to 1e-6",
            got,
        )


def slopes(engine: Engine) -> Rows:
    """Mean of dDN/d ln(photons) over 4 million pixels, where the noise hides neither steps nor clips."""
    for (given, (electrons, fields)), sigma_dn in itertools.product(TABLES["slopes"].items(), (0.05, 0.1, 0.5)):
        camera = quiet(**fields, **{"source_follower.read_noise_e": 8 * sigma_dn})
        light, (low, high) = electrons / 0.6, theory(camera, electrons * np.array([0.999, 1.001])).mean
        frame = differentiable(np.full((2048, 2048), light), camera, ZERO, "photons", engine=engine.option).frame()
        got = agree(frame.forward("photons").mean(dtype=np.float64) * light * 0.002 / (high - low), 1.0, 0.01)
        yield "derivatives", f"{given}, noise of {sigma_dn} DN", "over the difference of two theories 1, to 1 %", got


def ends(engine: Engine) -> Rows:
    """Odd codes beyond 2^23; a full well behind curves; α of next to nothing; samples that nothing correlates."""
    codes = np.concatenate([start + np.arange(500.0) for start in (2**23 - 250, 3 * 2**22, 2**24 - 500)])
    adc = stage_of("adc", adc__bits=24, adc__full_scale_v=2.0**24, adc__black_level_dn=0.0)
    digital = engine.expose(np.full((50, 200), 0.75 * 33_000 / 0.6), table1(adc__bits=24), ZERO).digital
    got = together(agree(engine.through([codes], adc), codes[None]), agree(np.mean(digital % 2), 0.5, 0.025, " odd"))
    yield "adc", "24 bit: whole numbers about 2^23 and up to 2^24; a frame", "each itself; half of the codes odd", got
    share, ramp = np.linspace(0.0, 1.0, 200), np.linspace(0.0, 60_000.0, 500)[None]
    for alpha in (1e-30, 1.0):
        camera = table1(source_follower__vv_nonlinearity=1.05, readout__ve_nonlinearity=alpha, adc__black_level_dn=0.0)
        chain = [one for one in camera.stages if one.label.endswith(("sense node", "source follower", "ADC"))]
        curve = np.expm1(-alpha * 0.165 / 3.1 * share) / np.expm1(-alpha * 0.165 / 3.1)
        exact = np.minimum(4096 * curve * (1 + 0.05 * curve) / 1.05, 4095.0)
        got = agree(engine.through([33_000 * share], *chain, electrons=True), exact[None], 0.501, " DN")
        given = f"V/V 1.05, V/e {shown(alpha)}, no V_FS; 0 … 33 000 e-"
        yield "curves, adc", given, "the curves rounded: only the full well itself ends at 4095", got
    for alpha in (1e-13, 1e-15, 1e-30, 1e-100):
        one, other = (engine.expose(ramp, table1(readout__ve_nonlinearity=x)).digital for x in (alpha, 0.0))
        yield (
            "sense node",
            f"α = {shown(alpha)}, a frame",
            "the linear chain's, byte by byte",
            agree(one, other, 0, " DN"),
        )
    noise_v = engine.through(np.zeros((256, 256)), stage_of("reset noise", readout__ktc_residual=math.sqrt(2))).std()
    got = relative(noise_v / 5e-6, math.sqrt(2) * 71.6835, SIGMAS / math.sqrt(2 * 256**2), " e-")
    yield "reset noise", "residual √2", "twice the variance of 71.68 e-, within 5 standard errors", got


def well_theory(_: Engine) -> Rows:
    """Theory of very full wells, in seconds."""
    for well, scale in ((5e7, None), (1e12, 0.1)):
        camera, started = table1(pixel__full_well_e=well, adc__full_scale_v=scale, readout__dsnu_col=0.0), time.time()
        found, black = theory(camera, [0.0, 1000 / gain_dn_per_e(camera), 1e30]).mean, black_level_dn(camera)
        seconds = time.time() - started
        got = agree(found, [black, black + 1000, 4095], 0.03, f" DN in {seconds:.1f} s", seconds < 30)
        yield "theory", f"full well {shown(well)} e-: dark, 1000 DN, 1e30 e-", "black level, 1000 more, 4095 DN", got


def noted(_: Engine) -> Rows:
    """Bands of noise that cut more than 1 % of it."""
    for one in TABLES["band_hz"]:
        notes = table1(source_follower__band_hz=one["band"]).notes
        got = holds("; ".join(notes) or "no note", len(notes) == one["notes"], all("of 6.11 e- of" in x for x in notes))
        expected = "a note" if one["notes"] else "no note: less than 1 % is cut"
        yield "source follower noise", f"band_hz {' … '.join(map(shown, one['band']))}", expected, got


def merged_bands(engine: Engine) -> Rows:
    """Flat light in 31 bands merged into one: changes cancel, as Σ(λ − 555) = 0; their sizes do not, 2400/17 205."""
    cube = lights.sky(engine, size=2, spp=1, bandwidth_nm=10.0)
    for irradiance in (1e-6, 1.0):
        flat = replace(cube, data=np.full(cube.data.shape, irradiance, np.float32))
        whole, merged = (grouped_electrons(flat, lights.CAMERA, TENTH, size) for size in (1, 31))
        moved = electrons_moved(flat, lights.CAMERA, TENTH, 31) / whole
        got = together(agree(merged / whole, 1.0, 1e-6, " kept"), relative(moved, 2400 / 17_205, 1e-6, " moved"))
        given = f"one band instead of 31, light of {whole.max() / 33_000:.2g} full wells"
        yield "bands needed", given, "Σ|E|·|Δ(QE·λ)| of all photoelectrons, saturated or not", got


def refused(theme: str, _: Engine) -> Rows:
    """Values that there are not."""
    for stage, given, expected, says, changes in TABLES["refused"][theme]:
        yield stage, given, expected, refusal(says, partial(load_camera(NAME).replace, **changes))


def strangers(_: Engine) -> Rows:
    """What is possible by itself, and not together: a CCD with what only CMOS sensors have; frames of two cameras."""
    for field, value in TABLES["ccd"].items():
        change = partial(load_camera("eev_44_82").replace, **{field: value})
        got = refusal(f"{field} is {value!r}, and sensor.technology is 'ccd'", change)
        yield "datasheet", f"{field} = {shown(value)} of a CCD", "refused: it has one amplifier and true CDS", got
    dark = partial(expose, np.zeros((4, 4)), exposure=ZERO)
    for other, camera, serial in (("serial number", table1(), 2), ("camera", table1(pixel__dsnu_e=31.0), 1)):
        got = refusal("the same camera", partial(dark(camera=table1()).minus, dark(camera=camera, serial=serial)))
        yield "minus", f"frames of another {other}", "refused: their fixed patterns do not cancel", got
