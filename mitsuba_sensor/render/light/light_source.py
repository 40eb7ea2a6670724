"""What photons remember of the light that they were collected from, for the notes of frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ...camera.camera import SET_BY_SCENE, Camera
from ...camera.fingerprint import pixel_fingerprint, unused_note
from ...core import Doubt
from ...sensor.frames import RawFrames
from .band_error import BandError, band_error, notes_of_bands
from .irradiance import Irradiance
from .render_noise import noise_note, render_noise


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
            *self._scene_note(camera),
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

    def _scene_note(self, camera: Camera) -> list[str]:
        """Where the scene had set fields of its camera, and another one was named. Its lens is used: the light came
        through it."""
        known = self.light.rendered_for
        own = None if known is None else known.camera
        if own is None:
            return []
        of_scene = [name for name, source in own.sources.items() if source == SET_BY_SCENE]
        names = [name for name in of_scene if not name.startswith("lens.")]
        return unused_note(names, own, camera)

    def render_noise(self, frames: RawFrames) -> tuple[dict[str, float], tuple[str, ...]]:
        """What the render's noise means in these frames, see :func:`render_noise`, and the notes on it."""
        noise = render_noise(self.light, frames)
        return noise, () if self.per_frame else tuple(noise_note(self.light, noise, frames))
