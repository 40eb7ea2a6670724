"""Renders the light groups of a scene one after the other, and shares the samples among them by what the sensor sees.

A few samples of every group measure its variance v in units of the sensor's own noise. The variance of the sum is
Σ v/n, so that a group gets a share of the samples in proportion to √v, and may have that share of the variance, too.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...camera.dual_pixels import PHOTODIODES
from ...core import Float64Array
from ..light.brightness import with_brightness
from ..light.group_notes import notes_of_groups
from ..light.irradiance import Irradiance
from ..light.light_sum import sum_of_groups
from ..lint.electron_share import with_notes_of_shares
from ..lint.refusals import refuse_black
from ..scene.half_pupil import half_note
from .passes import FEWEST, hashed_seed
from .statistics import POOLED, NoiseRatios, RenderStatistics, coarsest, sum_error, summary_of
from .stop_criterion import Progress, RenderProgress, StopCriterion

if TYPE_CHECKING:
    from ..scene.light_groups import LightGroup
    from .prepared import PreparedRender
    from .renderer import Electrons

PILOT = StopCriterion(passes=4, samples=2, launch=4)
"""Samples that measure the variance of a group before its render."""

SEEN = 95.0
"""Percentile of the pixels whose variance counts: the brightest few are of rare paths."""

LEAST_SHARE = 1 / 4
"""Of an equal share of the samples, which every group gets: passes of one or two samples have too small error bars."""


class GroupRender(NamedTuple):
    """The light of one group.

    electrons : mean photoelectrons and the expected squared error of that mean, (H, W) each.
    """

    light: Irradiance
    electrons: Electrons

    @property
    def of_passes(self) -> Electrons:
        """The same with the variance of the passes, before denoising."""
        assert self.light.pass_error is not None
        mean_e = self.electrons[0]
        with np.errstate(invalid="ignore"):
            return mean_e, (self.light.pass_error * mean_e) ** 2


def render_light_groups(
    whole: PreparedRender,
    seed: int,
    stop: StopCriterion,
    progress: Progress | None,
    started: float | None,
) -> Irradiance:
    """All groups of a prepared scene, and their sum.  started : when it began, on the monotonic clock [s].

    The scene of a still group is loaded for its pilot and again for its render, so that there are never two of them:
    kernels have in them where Dr.Jit keeps the objects of a scene among those of all scenes that are loaded, and groups
    with emitters of the same number and kinds share them.
    """
    began = time.monotonic() if started is None else started
    pilots = {group.name: _pilot(whole, group, seed) for group in whole.light_groups}
    shares = _shares(whole, pilots)
    renders = dict[str, GroupRender]()
    for group in whole.light_groups:
        name = group.name
        others = [mean_e for other, (mean_e, _) in pilots.items() if other != name]
        beside_e = np.asarray(sum(others, np.zeros((1, 1))))
        told = _told(progress, name, began)
        within = stop.for_share(shares[name])
        renders[name] = _render_group(whole, group, seed, within, told, beside_e)
    lights = {name: render.light for name, render in renders.items()}
    total = sum_of_groups(lights)
    if not total.data.any():
        refuse_black(whole.bands.ends_nm, total.statistics.non_finite, whole.at_rest.findings)
    statistics = _statistics(whole, renders, time.monotonic() - began)
    more = _note_of_samples(stop, len(renders), statistics.samples_per_pixel)
    statistics = replace(statistics, notes=(*statistics.notes, *more))
    light = replace(total, statistics=statistics)
    light = with_notes_of_shares(light, whole.camera, whole.at_rest.findings)
    return with_brightness(light, whole)


def _seed_of(seed: int, group: str) -> int:
    """A seed that no other group has: the noise of two groups is independent."""
    return hashed_seed(seed, 0, int.from_bytes(group.encode(), "little"))


def _pilot(whole: PreparedRender, group: LightGroup, seed: int) -> Electrons:
    """Mean photoelectrons of a group, and the variance of that mean, by a few samples."""
    renderer = whole.of_light_group(group).renderer
    renderer.run(_seed_of(seed, f"{group.name} before"), PILOT, lambda step: None)
    return renderer.electrons()


def _render_group(
    whole: PreparedRender,
    group: LightGroup,
    seed: int,
    stop: StopCriterion,
    progress: Progress | None,
    beside_e: Float64Array,
) -> GroupRender:
    """The light of one group.  beside_e : mean photoelectrons of the others."""
    part = whole.of_light_group(group)
    part.renderer.beside_e = beside_e
    light = part.render(_seed_of(seed, group.name), stop, progress, started=time.monotonic())
    return GroupRender(light, part.renderer.electrons())


def _shares(whole: PreparedRender, pilots: Mapping[str, Electrons]) -> dict[str, float]:
    """The share of the samples of each group; they add up to 1."""
    total_e: Float64Array = np.sum([mean_e for mean_e, _ in pilots.values()], axis=0)
    lit = (total_e > 0) & np.isfinite(total_e)
    seen = dict[str, float]()
    for name, (_, variance_e2) in pilots.items():
        ratio = whole.renderer.noise.ratio(total_e, variance_e2)[lit]
        most = np.percentile(ratio, SEEN) if ratio.size else 0.0
        seen[name] = float(np.minimum(ratio, most).mean()) ** 0.5 if ratio.size else 0.0
    total = sum(seen.values())
    if not total > 0:
        return dict.fromkeys(pilots, 1 / len(pilots))
    least = LEAST_SHARE / len(pilots)
    raised = {name: max(root / total, least) for name, root in seen.items()}
    return {name: share / sum(raised.values()) for name, share in raised.items()}


def _told(progress: Progress | None, name: str, began: float) -> Progress | None:
    """What a group's render reports to: its name, and the time that all groups took so far."""
    if progress is None:
        return None

    def tell(step: RenderProgress) -> None:
        progress(replace(step, light_group=name, seconds=time.monotonic() - began))

    return tell


def _statistics(
    whole: PreparedRender, renders: Mapping[str, GroupRender], seconds: float
) -> RenderStatistics:
    """How the sum came about: samples and seconds of all groups, noise of their sum."""
    parts = [render.light.statistics for render in renders.values()]
    samples = sum(part.samples_per_pixel for part in parts)
    sample_s = sum(part.seconds_per_sample * part.samples_per_pixel for part in parts)
    passes = min(part.passes for part in parts)
    electrons = _sum_of(render.electrons for render in renders.values())
    of_passes = _sum_of(render.of_passes for render in renders.values())
    denoised = _denoised_record(parts, _ratios(whole, of_passes, passes))
    return replace(
        parts[0],
        passes=passes,
        samples_per_pixel=samples,
        seconds=seconds,
        seconds_per_sample=sample_s / samples,
        **_ratios(whole, electrons, passes if denoised is None else POOLED),
        reliable=all(part.reliable for part in parts),
        firefly_fraction=max(part.firefly_fraction for part in parts),
        negative=sum(part.negative for part in parts),
        non_finite=sum(part.non_finite for part in parts),
        notes=(*whole.scene.notes, *_own_notes(whole, renders)),
        scene_sha256=whole.scene.sha256,
        denoised=denoised,
        denoise_forecast=None,
        sum_error=sum_error(*of_passes),
        motion=coarsest(part.motion for part in parts),
    )


def _ratios(whole: PreparedRender, light: Electrons, passes: int) -> NoiseRatios:
    """Noise ratio of the sum.  passes : by which its variance is known."""
    mean_e, variance_e2 = light
    lit = (mean_e > 0) & np.isfinite(mean_e)
    return summary_of(whole.renderer.noise.ratio(mean_e, variance_e2), lit, passes)


def _denoised_record(
    parts: list[RenderStatistics], before: NoiseRatios
) -> dict[str, object] | None:
    """What the denoiser did to the groups; None where none was denoised.  before : noise ratio without it."""
    records = [part.denoised for part in parts if part.denoised is not None]
    if not records:
        return None
    return {
        **records[0],
        "raw_weight": float(np.mean([record["raw_weight"] for record in records])),
        "sum_corrected_by": max(record["sum_corrected_by"] for record in records),
        "raw_noise_ratio_median": before["noise_ratio_median"],
        "raw_noise_ratio_p95": before["noise_ratio_p95"],
    }


def _own_notes(whole: PreparedRender, renders: Mapping[str, GroupRender]) -> list[str]:
    """Notes of the renders of the groups that are not those of the whole scene, nor that they are halves of dual
    pixels."""
    known = [*whole.scene.notes, *map(half_note, PHOTODIODES)]
    notes = {
        name: [note for note in render.light.notes if note not in known]
        for name, render in renders.items()
    }
    return notes_of_groups(notes)


def _note_of_samples(stop: StopCriterion, groups: int, samples: int) -> list[str]:
    """Where all groups together took another number of samples than was asked for."""
    if stop.asked is None or stop.asked == samples:
        return []
    return [
        f"{stop.asked} samples per pixel asked for, {samples} taken by {groups} light groups together: each has "
        f"{FEWEST} or more, in passes of a full grid"
    ]


def _sum_of(parts: Iterable[Electrons]) -> Electrons:
    """Means and variances of independent parts added up."""
    means, variances = zip(*parts, strict=True)
    return np.sum(means, axis=0), np.sum(variances, axis=0)
