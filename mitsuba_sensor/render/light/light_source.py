"""What photons remember of the light that they were collected from, for the notes of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ...camera.camera import SET_BY_SCENE, SET_BY_USER, Camera
from ...camera.fingerprint import differing_fields, pixel_fingerprint
from ...core import Doubt
from ...sensor.frames import RawFrames
from .band_error import BandError, band_error, notes_of_bands
from .irradiance import Irradiance
from .render_noise import noise_note, render_noise

BY_HAND = (SET_BY_SCENE, SET_BY_USER)
"""Sources of fields that are not those of the camera file."""


@dataclass(frozen=True, eq=False)
class CollectedLight:
    """Light that photons were collected from.

    light : without standard errors of its bands, which are as large as the light itself and which no note needs.
    per_frame : whether each frame has a render of its own, whose noise is a part of the frame's.
    """

    light: Irradiance
    per_frame: bool = False
    _band_errors: dict[str, BandError] = field(default_factory=dict)

    @classmethod
    def of(cls, light: Irradiance, per_frame: bool = False) -> CollectedLight:
        """Remember this light."""
        return cls(
            replace(light, standard_error=np.empty((0, 0, 0), np.float32), raw=None), per_frame
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the light itself."""
        return self.light.notes

    def band_error(self, camera: Camera) -> BandError:
        """The error of the photoelectrons of this camera."""
        key = pixel_fingerprint(camera)
        if key not in self._band_errors:
            self._band_errors[key] = band_error(self.light, camera)
        return self._band_errors[key]

    def notes_for(self, camera: Camera) -> tuple[str, ...]:
        """What light that was rendered for another camera lacks for this one, and whose lens it came through."""
        return (
            *notes_of_bands(self.light, camera, self.band_error(camera)),
            *self._lens_note(camera),
            *self._changed_note(camera),
        )

    def _lens_note(self, camera: Camera) -> Iterator[str]:
        """Where the camera has another lens than the one that the light is behind already."""
        known = self.light.rendered_for
        own = None if known is None else known.camera
        if own is not None and own.lens != camera.lens:
            yield Doubt(
                f"the light is behind the lens of {own.name} (f/{own.lens.f_number:g}) already, and the lens of "
                f"{camera.name} (f/{camera.lens.f_number:g}) is not used; render it for this camera"
            )

    def _changed_note(self, camera: Camera) -> Iterator[str]:
        """Where scene or user had changed the camera of the render, and a camera of its name has not these fields."""
        known = self.light.rendered_for
        own = None if known is None else known.camera
        if own is None or own.name != camera.name or own.gain != camera.gain:
            return
        changed = [
            name
            for name in differing_fields(own, camera)
            if own.sources.get(name) in BY_HAND and camera.sources.get(name) not in BY_HAND
        ]
        if changed:
            yield Doubt(
                f"the light was rendered for {own.name} with {', '.join(changed)} changed by its scene or by --set, "
                f"and is exposed by {camera.name} without that; leave the camera out for the one of the render"
            )

    def render_noise(
        self, frames: RawFrames
    ) -> tuple[dict[str, float | None], tuple[str, ...]]:
        """What the render's noise means in these frames, see :func:`render_noise`, and the notes on it."""
        noise = render_noise(self.light, frames)
        return noise, () if self.per_frame else tuple(noise_note(self.light, noise, frames))
