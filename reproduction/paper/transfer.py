"""Fig. 3 and 4: photon transfer curve and SNR of a gradient from darkness to saturation, linear and with curves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mitsuba_sensor.lab.measure.photon_transfer import PhotonTransfer, photon_transfer_of_scene
from mitsuba_sensor.pages.page import Drawing, Line, Part, Plot, Section, table
from mitsuba_sensor.study.kit import Array

from .camera import (
    CURVES,
    DARK_E_PER_S,
    FRAME_S,
    FULL_PHOTONS,
    FULL_WELL_E,
    GAIN,
    LINEAR,
    ONLY_VV,
    PAIR,
    READ_E,
    RESPONSES,
    Response,
    Size,
    stack_of,
    table1,
)
from .check import Check, all_hold, check_table, within_interval
from .published import RELEASED_SNR

BEYOND = 1.1  # brightest pixel of the gradient, in full wells
DARK_E = DARK_E_PER_S * FRAME_S
COMPARED = (0.05, 0.9)  # share of saturation where variances are compared with closed forms
SHOWN = 45  # points of a curve in a plot
LEVELS_DN = (100.0, 500.0, 1000.0, 2000.0, 3000.0, 3800.0)
NARROW = Response(1.05, 1.04, 1.0)
"""The pair with a converter whose range stays that of the linear swing, 0.165 V."""


class Curve(NamedTuple):
    """A photon transfer curve, and the temporal variance of darkness that was subtracted from it [DN²]."""

    transfer: PhotonTransfer
    floor: float

    @property
    def signal(self) -> Array:
        """[DN], of the points with noise."""
        return np.asarray(self.transfer.signal[self._shown])

    @property
    def noise(self) -> Array:
        """Temporal σ [DN]."""
        return np.asarray(np.sqrt((self.transfer.variance + self.floor)[self._shown]))

    @property
    def error(self) -> Array:
        """Standard error of σ² [DN²]."""
        return np.asarray(self.transfer.errors[self._shown])

    @property
    def rising(self) -> Array:
        """Which points lie between 5 and 90 % of saturation."""
        top = self.transfer.peak.mean[0]
        return np.asarray((self.signal > COMPARED[0] * top) & (self.signal < COMPARED[1] * top))

    @property
    def snr(self) -> Array:
        """Signal over σ, the paper's definition [1]."""
        return np.asarray(self.signal / self.noise)

    @property
    def _shown(self) -> Array:
        return np.asarray(
            (self.transfer.signal > 0) & (self.transfer.variance + self.floor > 0)
        )


def measure(name: str, size: Size) -> Curve:
    """One camera before the gradient, columns from dark to 1.1 full wells; the same number of dark frames."""
    rows = size.gradient[0] if name in (LINEAR, PAIR) else size.other_rows
    camera = table1(**CURVES[name])
    scene = np.tile(np.linspace(0, BEYOND * FULL_PHOTONS, size.gradient[1]), (rows, 1))
    dark = stack_of(camera, FRAME_S, np.zeros_like(scene), size, frames=size.frames, seed=301)
    light = stack_of(camera, FRAME_S, scene, size, frames=size.frames, seed=302)
    return Curve(photon_transfer_of_scene(light, dark), float(dark.variance.mean()))


def section(curves: dict[str, Curve]) -> Section:
    """Curves, tables and what must hold."""
    checks = checks_of(curves)
    linear = curves[LINEAR].transfer
    last = LEVELS_DN[-1]
    pair = change_percent(curves[PAIR], curves[LINEAR], last)
    released = 100 * (RELEASED_SNR[PAIR] / RELEASED_SNR[LINEAR] - 1)
    findings = (
        f"Photon transfer: K = {linear.gain.value:.5f} DN/e- ({linear.gain.low:.5f} to {linear.gain.high:.5f}); "
        f"Table 1 gives {GAIN:.7f}.",
        f"V/V 1.05: a full well's local gain is {checks[2].measured:.4f} K_0 (closed form 1.10), and its SNR differs "
        f"by {checks[3].measured:+.2f} % from a linear camera's at equal DN (closed form {checks[3].expected:+.2f} %).",
        f"SNR of V/V 1.05 + ADC 1.04 at {last:g} DN: {pair:+.1f} % against the linear camera at equal DN, which the "
        f"text has above it; the authors' released code gives {released:+.0f} % at 1984 DN.",
    )
    variance = Drawing(
        "Fig. 3: temporal variance with the slope K, linear camera",
        linear.plot,
        "Of darkness subtracted.",
    )
    return Section(
        findings,
        all_hold(checks),
        (*_plots(curves), variance, _snr_table(curves), _checked(checks)),
    )


def _checked(checks: list[Check]) -> Part:
    note = (
        "K_0 is the gain of small signals, "
        "K/1.05 where the converter's range is the non-linear swing of a full well."
    )
    return check_table("Fig. 3 and 4: what closed forms say", checks, note)


def checks_of(curves: dict[str, Curve]) -> list[Check]:
    """K; the gain at zero, at a full well and the SNR there of V/V 1.05; the variances of every camera."""
    initial, curved = curves[ONLY_VV].transfer.initial_gain, RESPONSES[ONLY_VV]
    at_well, error = local_gain_at_full_well(curves[ONLY_VV])
    loss = 100 * (math.sqrt(1.05) / at_well - 1)
    return [
        within_interval("K, linear", GAIN, curves[LINEAR].transfer.gain),
        within_interval("K_0, V/V 1.05", float(curved.slope(np.array(DARK_E))), initial, 2e-4),
        Check("dDN/de- at full well over K_0, V/V 1.05", "1", 1.10, at_well, 5 * error),
        Check(
            "SNR at full well at equal DN, V/V 1.05",
            "%",
            100 * (math.sqrt(1.05) / 1.1 - 1),
            loss,
            500 * error,
        ),
        *(variance_check(name, curve) for name, curve in curves.items()),
    ]


def variance_check(name: str, curve: Curve) -> Check:
    """Mean of measured over expected variance."""
    used = curve.rising
    exact = RESPONSES[name].variance(RESPONSES[name].electrons(curve.signal[used], DARK_E))
    ratio, error = curve.noise[used] ** 2 / exact, curve.error[used] / exact
    weight = error**-2 / (error**-2).sum()
    mean_error = float((error**-2).sum()) ** -0.5
    return Check(
        f"variance over its closed form, {name}",
        "1",
        1.0,
        float(weight @ ratio),
        5 * mean_error,
    )


def local_gain_at_full_well(curve: Curve) -> tuple[float, float]:
    """dDN/de- over K_0 of V/V 1.05 at a full well, and its error: a line through √(variance per electron)."""
    used, curved = curve.rising, RESPONSES[ONLY_VV]
    electrons = curved.electrons(curve.signal[used], DARK_E)
    gain = np.sqrt((curve.noise[used] ** 2 - 1 / 12) / (electrons + READ_E**2)) * 1.05 / GAIN
    error = gain * curve.error[used] / curve.noise[used] ** 2 / 2
    place = np.stack([np.ones(len(electrons)), electrons / FULL_WELL_E - 1])
    covariance = np.linalg.inv(place / error**2 @ place.T)
    return float((covariance @ (place / error**2 @ gain))[0]), float(covariance[0, 0] ** 0.5)


def change_percent(one: Curve, other: Curve, signal_dn: float) -> float:
    """Of the SNR at equal DN."""
    values = [float(np.interp(signal_dn, curve.signal, curve.snr)) for curve in (one, other)]
    return 100 * (values[0] / values[1] - 1)


def _plots(curves: dict[str, Curve]) -> tuple[Plot, ...]:
    shown = {name: curves[name] for name in (LINEAR, PAIR)}
    noise = [_points(name, curve, curve.noise) for name, curve in shown.items()]
    snr = [_points(name, curve, curve.snr, beyond=False) for name, curve in shown.items()]
    for name, curve in shown.items():
        signal = np.geomspace(1, curve.transfer.peak.mean[0], 60)
        variance = RESPONSES[name].variance(RESPONSES[name].electrons(signal, DARK_E))
        noise.append(_exact(name, signal, np.sqrt(variance)))
        snr.append(_exact(name, signal, signal / np.sqrt(variance)))
    note = "Bins of the means of single pixels, some of which are shown; σ is the root of the mean variance of a bin."
    label = "signal above darkness [DN]"
    noise_axis, snr_axis = "temporal noise σ [DN]", "signal-to-noise ratio [1]"
    return (
        Plot("Fig. 3a: photon transfer curve", label, noise_axis, tuple(noise), False, False, note=note),
        Plot("Fig. 3b: photon transfer curve, logarithmic", label, noise_axis, tuple(noise), note=note),
        Plot("Fig. 4a: signal-to-noise ratio up to saturation", label, snr_axis, tuple(snr), False, False),
        Plot("Fig. 4b: signal-to-noise ratio, logarithmic", label, snr_axis, tuple(snr)),
    )  # fmt: skip


def _points(name: str, curve: Curve, y: Array, beyond: bool = True) -> Line:
    """Some of the points, about as far apart on both scales, and all beyond saturation or none."""
    count = len(curve.signal)
    some = np.isin(np.arange(count), np.geomspace(1, count, SHOWN).astype(int) - 1)
    saturated = curve.signal > curve.transfer.peak.mean[0]
    some = some | saturated if beyond else some & ~saturated
    return Line(name, tuple(curve.signal[some].tolist()), tuple(y[some].tolist()), joined=False)


def _exact(name: str, x: Array, y: Array) -> Line:
    return Line(f"{name}, closed form", tuple(x.tolist()), tuple(y.tolist()), marked=False)


def _snr_table(curves: dict[str, Curve]) -> Part:
    rows = []
    for level in LEVELS_DN:
        exact = {
            name: float(response.snr(np.array(level), DARK_E))
            for name, response in RESPONSES.items()
        }
        narrow = float(NARROW.snr(np.array(level), DARK_E))
        found = {
            name: float(np.interp(level, curve.signal, curve.snr))
            for name, curve in curves.items()
        }
        changes = [
            100 * (values[name] / values[LINEAR] - 1)
            for name in RESPONSES
            if name != LINEAR
            for values in (found, exact)
        ]
        rows.append(
            (
                "",
                (
                    level,
                    found[LINEAR],
                    found[PAIR],
                    *changes,
                    100 * (narrow / exact[LINEAR] - 1),
                ),
            )
        )
    return table(
        "Fig. 4: change of the SNR by the curves at equal DN",
        "signal [DN] | linear [1] | V/V + ADC [1] | V/V + ADC changes it by [%] | closed form [%] | V/V alone [%] | "
        "closed form [%] | ADC alone [%] | closed form [%] | V/V + ADC, range kept at 0.165 V, closed form [%]",
        rows,  # type: ignore[arg-type]
        "The text has the non-linear model below the linear one. With V/V 1.05 the converter's range is a full "
        "well's non-linear swing, 1.05 × 0.165 V, so small signals have K/1.05 and a higher SNR at equal DN.",
    )
