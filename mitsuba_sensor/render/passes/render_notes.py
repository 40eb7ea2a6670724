"""Notes of a render: what its scene, camera, denoiser and number of samples are not, of what was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...optics.veiling_glare import glare_sentence
from ...stages.usual_range import temperature_note
from ..denoise.network import is_installed
from .stop_criterion import End, StopCriterion

if TYPE_CHECKING:
    from ...output.frames import Frames
    from ..light.irradiance import Irradiance
    from .prepared import PreparedRender


def render_notes(prepared: PreparedRender, stop: StopCriterion, end: End) -> list[str]:
    """Notes of a render that is done.  end : why it ended."""
    renderer, notes = prepared.renderer, [*prepared.scene.notes]
    if prepared.parsed.settings.is_default_camera:
        notes.append(
            f"rendered for {prepared.camera.name}, because no camera was given and the scene names none (--camera)"
        )
    notes += prepared.parsed.settings.unused_note(prepared.camera)
    if prepared.camera.lens.veiling_glare > 0:
        notes.append(glare_sentence(prepared.camera))
    if prepared.denoise is None and not is_installed():
        notes.append("not denoised: Open Image Denoise is not installed; pip install pyoidn")
    if renderer.choice is not None:
        notes += renderer.choice.notes()
    return notes + stop.notes(end, renderer.samples_per_pixel)


def notes_after_render(light: Irradiance, frames: Frames) -> list[str]:
    """Notes on light that was rendered and its frames, but for the one that was made before the first ray."""
    told = temperature_note(frames.first.exposure.temperature_k)
    late = [note for note in frames.exposure_notes if note not in told]
    return [*light.notes, *late]
