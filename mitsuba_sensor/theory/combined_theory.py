"""Theory of frames: by the law of a pixel, by samples of the chain, or of combined read-outs.

Of combined read-outs mean and variance of a pixel's linear code follow from the law of each read-out in closed form
(combined_codes.py). Where a read-out has a stage without a law, what it and the fixed patterns add is measured.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core import Electrons, Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.readouts import light_of_readout
from ..stages.combined_readouts import CombinedReadouts, combined_of
from ..stages.stage import Chain, Stage, without, without_law
from .combined_codes import CodeMoments, combined_codes
from .coupled_theory import CoupledTheory
from .frame_theory import Averages, FrameTheory, behind_stages
from .light_levels import WIDTH, LightLevels
from .measured_theory import MeasuredTheory
from .pixel_moments import HIGHEST_E, PixelMoments, check_clean_is_known, pixel_moments
from .pixel_swing import Codes
from .response import Response, behind_stages_at
from .sampled_pixels import SampledPixels, sample_pixels

SAMPLE = 2**14
"""Pixels whose law is averaged."""


def theory_of(stages: Chain, light: Detected, frame: Frame) -> FrameTheory:
    """The theory of a chain, measured where a stage has no law.

    light, frame : of the window, and its exposure, place and measured maps.
    """
    combined = combined_of(stages)
    if combined is not None:
        if combined.reach_px:
            return CoupledCombinedTheory(stages, light, frame)
        if any(without_law(readout.stages) for readout in combined.readouts):
            return MeasuredCombinedTheory(stages, light, frame)
        return CombinedTheory(stages, light, frame)
    if any(stage.reach_px for stage in stages):
        return CoupledTheory(stages, light, frame)
    if without_law(stages):
        return MeasuredTheory(stages, light, frame)
    return FrameTheory(stages, light, frame)


def moments_of_pixels(stages: Chain, light: Detected, frame: Frame) -> PixelMoments:
    """Mean and temporal variance of the codes of a window, for the maps of its serial. Raises InputError where they are
    not known: see :func:`theory.pixel_moments.pixel_moments`."""
    combined = combined_of(stages)
    if combined is None:
        return pixel_moments(stages, light, frame)
    codes = list[CodeMoments]()
    for readout in combined.readouts:
        own = light_of_readout(readout, light, frame)
        mean, temporal = pixel_moments(readout.stages, own, readout.frame_of(frame))
        codes.append(
            CodeMoments(np.ravel(mean).astype(float), np.ravel(temporal).astype(float))
        )
    shape = frame.window.shape
    found = (
        x.reshape(shape).astype(np.float32) for x in combined_codes(combined, codes, frame)
    )
    return PixelMoments(*found)


def check_moments_are_known(stages: Chain) -> None:
    """Raise InputError for a chain, or a read-out of it, whose clean frame is not known."""
    combined = combined_of(stages)
    if combined is None:
        check_clean_is_known(stages)
        return
    for readout in combined.readouts:
        check_clean_is_known(readout.stages)


def codes_by_light(
    combined: CombinedReadouts, frame: Frame, light_e: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Mean and variance of the linear code of a pixel without fixed-pattern noise, by its mean photoelectrons in the
    reference exposure, (L,) each [DN, DN²]."""
    codes = list[CodeMoments]()
    for readout in combined.readouts:
        stages, own = readout.stages, readout.frame_of(frame)
        last = len(stages) - 1
        found = behind_stages_at(stages, own, readout.light_ratio * light_e, [last])
        codes.append(CodeMoments(*found[last]))
    return combined_codes(combined, codes, frame)


class TheoryOfReadouts(FrameTheory):
    """What there is of several read-outs without fixed-pattern noise: the codes of each in its own light, combined."""

    @property
    def _combined(self) -> CombinedReadouts:
        return _required(self.stages)

    @cached_property
    def _responses(self) -> list[Response]:
        return responses_of(self)

    @property
    def _sampled_electrons(self) -> Electrons:
        """Mean photoelectrons of the sampled pixels, those of later exposures among them."""
        return self.sample.light

    @cached_property
    def levels(self) -> LightLevels:
        """Levels of light of all pixels; a level for every pixel where the exposures differ in their light."""
        if self.light.signal.by_readout is None:
            return super().levels
        light_e = np.minimum(self.light.mean_e, HIGHEST_E).ravel()
        return LightLevels(light_e, np.ones(light_e.size, np.int64))

    def _plain(self, number: int, light_e: Float64Array) -> Codes:
        return self._plain_codes(number, Electrons(light_e))

    def _plain_of_sample(self, number: int) -> Codes:
        mean, variance = self._plain_codes(number, self._sampled_electrons)
        return mean.ravel(), variance.ravel()

    def _plain_of_levels(self, number: int) -> Codes:
        if self.light.signal.by_readout is None:
            return super()._plain_of_levels(number)
        mean, variance = self._plain_codes(number, self.light.signal)
        return mean.ravel(), variance.ravel()

    def _plain_of_rows(self, number: int, rows: slice) -> Codes:
        return self._plain_codes(number, self.light.crop_rows(rows).signal)

    def _plain_codes(self, number: int, light: Electrons) -> Codes:
        """Mean and variance behind stage ``number`` of pixels without fixed-pattern noise in this light."""
        light_e = _levels(light)
        if number == 0:
            return light_e, np.zeros(light_e.shape)
        codes = list[CodeMoments]()
        for readout, response in zip(self._combined.readouts, self._responses, strict=True):
            last = len(response.stages) - 1
            level_e = _levels(readout.light_of(light, self.frame)).ravel()
            codes.append(
                CodeMoments(response.mean(last, level_e), response.temporal(last, level_e))
            )
        mean, variance = combined_codes(self._combined, codes, self.frame)
        return mean.reshape(light_e.shape), variance.reshape(light_e.shape)

    @cached_property
    def _digital(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and variance of every pixel at its level of light."""
        return self._by_light()


class CombinedTheory(TheoryOfReadouts):
    """Theory of one light on combined read-outs, by the law of each of them in every pixel."""

    @cached_property
    def sample(self) -> SampledPixels:
        """The pixels that are averaged over."""
        return sample_pixels(self.light.signal, self.frame, SAMPLE)

    def _prepare(self, numbers: Collection[int]) -> None:
        """The sampled pixels behind both stages: their light, and their linear code."""
        if len(self._behind) == len(self.stages):
            return
        codes = list[CodeMoments]()
        for readout in self._combined.readouts:
            frame, last = readout.frame_of(self.sample.frame), len(readout.stages) - 1
            light = readout.light_of(self.sample.light, frame)
            codes.append(
                CodeMoments(*behind_stages(readout.stages, light, frame, [last])[last])
            )
        light_e = self._sampled_light
        self._behind[0] = light_e, np.zeros(light_e.shape)
        self._behind[len(self.stages) - 1] = combined_codes(self._combined, codes, self.frame)


class MeasuredCombinedTheory(TheoryOfReadouts, MeasuredTheory):
    """Theory of combined read-outs one of which has no law: by samples."""

    @property
    def _sampled_electrons(self) -> Electrons:
        """Mean photoelectrons of the pixels of all tiles."""
        light: Electrons = self.light.signal
        tiles = self._tiles
        return light.mapped(
            lambda values: np.concatenate(
                [values[one.rows, one.columns].ravel() for one in tiles]
            )
        )

    def averages(self, stage: Stage) -> Averages:
        """Averages over the pixels behind a stage; a variance that is measured is not negative."""
        found = super().averages(stage)
        return found._replace(temporal=max(found.temporal, 0.0))


class CoupledCombinedTheory(MeasuredCombinedTheory, CoupledTheory):
    """Theory of combined read-outs one of which couples neighbouring pixels: by samples."""


def responses_of(theory: TheoryOfReadouts) -> list[Response]:
    """Each read-out without its fixed-pattern noise and its stages that have no law, in all the light of the frame."""
    found = list[Response]()
    for readout in _required(theory.stages).readouts:
        stages = without(readout.stages, without_law(readout.stages))
        light_e = _levels(readout.light_of(theory.light.signal, theory.frame))
        ends = float(light_e.min() * (1 - WIDTH)), float(light_e.max() * (1 + WIDTH))
        found.append(Response.of(stages, readout.frame_of(theory.frame), *ends))
    return found


def _levels(light: Electrons) -> Float64Array:
    """Mean photoelectrons, none of them infinite."""
    return np.minimum(np.asarray(light.light, np.float64), HIGHEST_E)


def _required(stages: Chain) -> CombinedReadouts:
    combined = combined_of(stages)
    assert combined is not None
    return combined
