"""The render with one feature off at a time: equal seeds, so that most of the noise is in both pictures."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import mitsuba_sensor as ms

from ...lab.statistics.estimators import standard_error
from ...pages.page import Mark, MarkedRow, Section, Table, table
from ..kit import Array, Kit, Step, Subject, Values

PAIRS = 4
"""Renders with and without each feature."""

SIGNIFICANT, LEAST_SHARE = 3.0, 0.05
"""Standard errors beyond which a change is one; share of the seconds by which renders of one kind differ."""

LEAST_DN = 1e-3
"""A change of the picture that is worth a sentence."""

AS_IT_IS = "as it is"
LENS_FEATURES: dict[
    str, tuple[tuple[str, ...], Values]
] = {  # fields that the lens must have, and changes of a camera
    "no lens fall-off": (
        (),
        {
            "lens.relative_illumination": (1.0, 1.0),
            "lens.relative_illumination_heights_mm": (0.0, 1e6),
        },
    ),
    "no lens distortion": (
        ("distortion", "distortion_percent"),
        dict.fromkeys(
            ("lens.distortion", "lens.distortion_percent", "lens.distortion_heights_mm")
        ),
    ),
    "no lens transmission curve": (
        ("transmission_curve",),
        dict.fromkeys(("lens.transmission_curve", "lens.transmission_wavelengths_nm")),
    ),
    "no lens prescription": (("prescription",), {"lens.prescription": None}),
}


class Rendered(NamedTuple):
    """Mean signal of every pixel, cut at the full well, (H, W) [DN]; seconds of all samples behind the first pass."""

    signal_dn: Array
    seconds: float


class Change(NamedTuple):
    """What leaving a feature out changes [DN], with standard errors, and the seconds that it saves."""

    mean_dn: float
    mean_error_dn: float
    rms_dn: float
    rms_error_dn: float
    saved_s: float
    saved_share: float

    @property
    def is_change(self) -> bool:
        """Whether it is more than noise."""
        return (
            self.rms_dn > SIGNIFICANT * self.rms_error_dn
            or abs(self.mean_dn) > SIGNIFICANT * self.mean_error_dn
        )


class RenderAblation:
    """A scene, and what a kit measures of its renders without each feature."""

    def __init__(self, kit: Kit, subject: Subject, spp: int, seed: int) -> None:
        self.kit, self._subject, self._spp, self._seed = (
            kit,
            subject,
            max(spp // PAIRS, 2),
            seed,
        )

    def light(self) -> ms.Photons:
        """Photons of the whole render, from which the frames are made."""
        light = self._subject.render(self._seed, spp=self._spp * PAIRS, denoise=False)
        return ms.collect(light, self._subject.camera, self._subject.exposure)

    def scene(self) -> Values:
        """Size and bands of the picture, and the features that it has."""
        light = self._subject.render(self._seed, spp=2, denoise=False)
        rows, columns, bands = light.data.shape
        is_cube = light.filters is None and bands > 1
        width_nm = float(light.bandwidths_nm[0])
        return {
            "rows": rows,
            "columns": columns,
            "bands": bands if is_cube else 1,
            "width_nm": width_nm,
        }

    def features(self) -> dict[str, Values]:
        """Options of a render without each feature; "camera" are changes of its datasheet."""
        scene, lens = self.kit["loading the scene"], self._subject.camera.lens
        bands, features = scene["bands"], dict[str, Values]()
        for size in (2, bands):
            if bands > size or (bands == size and bands > 1):
                if size == bands:
                    name = "one band"
                else:
                    name = f"bands of {size * scene['width_nm']:g} nm"
                features[name] = {"bandwidth_nm": size * scene["width_nm"]}
        if bands > 1 and self._subject.camera.quantum_efficiency.quantum_yield is None:
            features["channels instead of bands"] = {"spectral": "channels"}
        features["no indirect light"] = {"integrator": "direct"}
        for name, (needed, changes) in LENS_FEATURES.items():
            if not needed or any(getattr(lens, field) is not None for field in needed):
                features[name] = {"camera": changes}
        return features

    def steps(self) -> Iterator[Step]:
        """All renders."""
        for pair in range(PAIRS):
            yield Step(
                f"render {pair + 1}: {AS_IT_IS}",
                1.0,
                partial(self.rendered, pair, {}),
            )
        for name, without in self.features().items():
            for pair in range(PAIRS):
                yield Step(
                    f"render {pair + 1} without: {name}",
                    1.0,
                    partial(self.rendered, pair, without),
                )

    def rendered(self, pair: int, without: Mapping[str, Any]) -> Rendered | None:
        """One render; None where the scene refuses to be without the feature."""
        options = {**without}
        camera = self._subject.camera.replace(**options.pop("camera", {}))
        try:
            light = self._subject.render(
                self._seed + pair, camera, spp=self._spp, denoise=False, **options
            )
        except ms.InputError:
            return None
        photons = ms.collect(light, camera, self._subject.exposure)
        detected = ms.expose(photons, camera, self._subject.exposure).detected.mean_e
        signal_e = np.minimum(np.float64(detected), camera.pixel.full_well_e)
        told = light.statistics
        return Rendered(
            camera.system_gain_dn_per_e * signal_e,
            told.seconds_per_sample * told.samples_per_pixel,
        )

    def changes(self) -> dict[str, Change]:
        """What each feature changes, of those that the scene can be without."""
        base = [self.kit[f"render {pair + 1}: {AS_IT_IS}"] for pair in range(PAIRS)]
        changes = {}
        for name in self.features():
            without = [self.kit[f"render {pair + 1} without: {name}"] for pair in range(PAIRS)]
            if None not in without:
                changes[name] = change_of(base, without)
        return changes


def change_of(base: list[Rendered], without: list[Rendered]) -> Change:
    """The change from pairs of renders with equal seeds."""
    off = np.array(
        [other.signal_dn - one.signal_dn for one, other in zip(base, without, strict=True)]
    )
    rms, rms_error = shared_rms(off)
    before, after = (
        statistics.median(one.seconds for one in renders) for renders in (base, without)
    )
    means = off.mean(axis=(1, 2))
    mean, error = float(means.mean()), standard_error(means)
    return Change(mean, error, rms, rms_error, before - after, 1 - after / before)


def shared_rms(off: Array) -> tuple[float, float]:
    """Root mean square over the pixels of the change that all pairs share, and its standard error.

    The mean of products of two different pairs has no noise in its mean.
    """

    def mean_square(pairs: Array) -> float:
        count, total, squares = len(pairs), pairs.sum(axis=0), (pairs**2).sum(axis=0)
        return float(((total**2 - squares) / (count * (count - 1))).mean())

    count, square = len(off), mean_square(off)
    left = np.array([mean_square(np.delete(off, pair, axis=0)) for pair in range(count)])
    error = math.sqrt((count - 1) / count * float(((left - left.mean()) ** 2).sum()))
    rms = math.sqrt(max(square, 0.0))
    return rms, error / (2 * rms) if square > error else math.sqrt(error)


def render_section(changes: Mapping[str, Change]) -> Section:
    """What the render loses without each feature."""
    return Section(tuple(render_findings(changes)), True, (render_table(changes),))


def render_findings(changes: Mapping[str, Change]) -> Iterator[str]:
    """What the picture depends on most, and the seconds of that."""
    changing = {
        name: one for name, one in changes.items() if one.is_change and one.rms_dn > LEAST_DN
    }
    if changing:
        name, most = max(changing.items(), key=lambda entry: entry[1].rms_dn)
        shows = most.saved_share > LEAST_SHARE
        cost = "it saves no time that could be measured"
        if shows:
            cost = f"it saves {most.saved_share:.0%} of the time"
        rms = f"{most.rms_dn:.3g} ± {most.rms_error_dn:.2g} DN rms"
        yield f"Of the render, '{name}' changes the picture most: by {rms}; {cost}."


def render_table(changes: Mapping[str, Change]) -> Table:
    """Changes and seconds of every feature."""
    rows: list[MarkedRow] = []
    for name, one in changes.items():
        mark: Mark = "" if one.is_change else "dim"
        rows.append((mark, (name, *one[:-1], 100 * one.saved_share)))
    return table(
        "What changes when the render is simpler",
        "rendered with | mean [DN] | ± [DN] | rms [DN] | ± [DN] | saved [s] | saved [%]",
        rows,
        f"Change of the mean signal in DN, cut at the full well, in {PAIRS} pairs of renders with equal seeds; their "
        "noise is subtracted from the rms. Grey: no more than noise. Seconds are those of all samples, without "
        "compiling.",
    )
