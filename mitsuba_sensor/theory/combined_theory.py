"""Theory of frames: by the law of a pixel, by samples of the chain, or of combined read-outs.

Of combined read-outs mean and variance of a pixel's linear code follow from the law of each read-out in closed form
(combined_codes.py). Where a read-out has a stage without a law, what it and the fixed patterns add is measured.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Frame
from ..core.types import Float64Array
from ..sensor.detection import Detected
from ..sensor.readouts import light_of_readout
from ..stages.combined_readouts import CombinedReadouts, combined_of
from ..stages.stage import Chain, Stage, without, without_law
from .combined_codes import CodeMoments, combined_codes
from .frame_theory import Averages, FrameTheory, behind_stages
from .light_levels import WIDTH
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
        if any(without_law(readout.stages) for readout in combined.readouts):
            return MeasuredCombinedTheory(stages, light, frame)
        return CombinedTheory(stages, light, frame)
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


class CombinedTheory(FrameTheory):
    """Theory of one light on combined read-outs, by the law of each of them in every pixel."""

    @property
    def _combined(self) -> CombinedReadouts:
        return _required(self.stages)

    @cached_property
    def sample(self) -> SampledPixels:
        """The pixels that are averaged over."""
        return sample_pixels(self.light.signal, self.frame, SAMPLE)

    @cached_property
    def _responses(self) -> list[ResponseOfReadout]:
        return responses_of(self)

    def _plain(self, number: int, light_e: Float64Array) -> Codes:
        return plain_codes(self._combined, self._responses, self.frame, number, light_e)

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

    @cached_property
    def _digital(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and variance of every pixel at its level of light."""
        last, light_e = len(self.stages) - 1, np.minimum(self.light.mean_e, HIGHEST_E)
        plain = self._plain(last, self._sampled_light)
        found = list[NDArray[np.float32]]()
        for sampled, without_maps, at_light in zip(
            self._sampled(last), plain, self._plain(last, light_e), strict=True
        ):
            shift = self._light_groups.smooth(sampled - without_maps)
            found.append(np.maximum(at_light + shift.at(light_e), 0.0).astype(np.float32))
        return found[0], found[1]


class MeasuredCombinedTheory(MeasuredTheory):
    """Theory of combined read-outs one of which has no law: by samples."""

    @cached_property
    def _responses(self) -> list[ResponseOfReadout]:
        return responses_of(self)

    def averages(self, stage: Stage) -> Averages:
        """Averages over the pixels behind a stage; a variance that is measured is not negative."""
        found = super().averages(stage)
        return found._replace(temporal=max(found.temporal, 0.0))

    def _plain(self, number: int, light_e: Float64Array) -> Codes:
        return plain_codes(_required(self.stages), self._responses, self.frame, number, light_e)


class ResponseOfReadout(NamedTuple):
    """A read-out without its fixed-pattern noise and without its stages that have no law.

    light_ratio : of its light.
    """

    response: Response
    light_ratio: float

    def codes(self, light_e: Float64Array) -> CodeMoments:
        """Mean and variance of its code by the mean photoelectrons of the reference exposure."""
        last, level_e = len(self.response.stages) - 1, self.light_ratio * light_e
        return CodeMoments(
            self.response.mean(last, level_e), self.response.temporal(last, level_e)
        )


def responses_of(theory: FrameTheory) -> list[ResponseOfReadout]:
    """Of each read-out, at all levels of light of the frame."""
    darkest, brightest = theory.levels.light_e[[0, -1]]
    found = list[ResponseOfReadout]()
    for readout in _required(theory.stages).readouts:
        ratio, stages = (
            readout.light_ratio,
            without(readout.stages, without_law(readout.stages)),
        )
        ends = float(darkest * ratio * (1 - WIDTH)), float(brightest * ratio * (1 + WIDTH))
        response = Response.of(stages, readout.frame_of(theory.frame), *ends)
        found.append(ResponseOfReadout(response, ratio))
    return found


def plain_codes(
    combined: CombinedReadouts,
    responses: Sequence[ResponseOfReadout],
    frame: Frame,
    number: int,
    light_e: Float64Array,
) -> Codes:
    """Mean and variance behind stage ``number`` of pixels without fixed-pattern noise in so much light."""
    if number == 0:
        return light_e, np.zeros(light_e.shape)
    shape = np.shape(light_e)
    codes = [one.codes(np.ravel(light_e)) for one in responses]
    mean, variance = combined_codes(combined, codes, frame)
    return mean.reshape(shape), variance.reshape(shape)


def _required(stages: Chain) -> CombinedReadouts:
    combined = combined_of(stages)
    assert combined is not None
    return combined
