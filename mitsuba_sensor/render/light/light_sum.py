"""The sum of light groups at any levels: light is linear in the emitters, and errors of different renders are
independent.

E = Σ w·E_g, and the variance of E is Σ w²·v_g. With flickering lamps each row has a separate w.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core import Float64Array, InputError, nearest
from ...core.signals import Illuminant
from ...optics.shutter import Shutter
from ...optics.waveform import EXAMPLE, Waveform, waveform_of
from .bands import in_band_factor, of_own_filter

if TYPE_CHECKING:
    from .irradiance import Irradiance

Values = TypeVar("Values", NDArray[np.float32], Float64Array)
Level: TypeAlias = float | Float64Array
"""Factor on a light group, or on each of its rows, shape (H,)."""

OF_PHOTODIODES = {"left": "pupil_left", "right": "pupil_right"}
"""Photodiode of dual pixels → name of the light that it sees."""

ROWS_AT_ONCE = 64
"""Rows whose photoelectrons are computed at once."""


class Part(NamedTuple):
    """One light group at a level, which may differ in every row.

    electrons : mean photoelectrons of each pixel, shape (H, W), in a unit that all groups share.
    flat : mean photoelectrons for a spectrum that is flat within each band, shape (H, W).
    """

    level: Level
    light: Irradiance
    electrons: Float64Array
    flat: Float64Array


def checked_lights(name: str, given: object) -> dict[str, float | Waveform]:
    """Return levels and waveforms by light group.  given : a dict, or texts NAME=LEVEL. Raises InputError."""
    texts = [given] if isinstance(given, str) else given
    if isinstance(texts, list | tuple):
        pairs = [str(text).partition("=") for text in texts]
        given = {group.strip(): level.strip() for group, _, level in pairs}
    if not isinstance(given, Mapping) or not given:
        raise InputError(
            f"{name} is {given!r}; give levels by the name of a light group, e.g. `--light lamps=0.2` "
            f"({{'lamps': 0.2}}), or waveforms: {EXAMPLE}."
        )
    lights = dict[str, float | Waveform]()
    for group, level in given.items():
        waveform = waveform_of(str(group), level)
        lights[str(group)] = waveform if waveform.flickers else waveform.level
    return lights


def waveforms_of(lights: Mapping[str, float | str | Waveform]) -> dict[str, Waveform]:
    """Return the waveforms of the groups that flicker."""
    shapes = {name: waveform_of(name, given) for name, given in lights.items()}
    return {name: shape for name, shape in shapes.items() if shape.flickers}


def check_group_names(lights: Iterable[str], groups: Collection[str]) -> None:
    """Raise InputError for names that are not light groups of the light."""
    if not groups:
        raise InputError(
            "the light was rendered as a whole, without light groups; render it with light_groups='auto'."
        )
    if OF_PHOTODIODES["left"] in groups:
        raise InputError(
            "the light was rendered for dual pixels, by halves of the pupil instead of light groups; omit lights, or "
            "render it with sensor.dual_pixel = false and light groups."
        )
    for name in lights:
        if name not in groups:
            known = ", ".join(groups)
            raise InputError(
                f"the light has no light group {name!r}; it has {known}.{nearest(name, groups)}"
            )


def with_levels(light: Irradiance, lights: Mapping[str, float | str | Waveform]) -> Irradiance:
    """Return the light with other levels, see :meth:`irradiance.Irradiance.with_lights`."""
    check_group_names(lights, light.groups)
    shapes = {name: waveform_of(name, given) for name, given in lights.items()}
    total = sum_of_groups(light.groups, {name: shape.level for name, shape in shapes.items()})
    flickering = waveforms_of(lights)
    raw = None if total.raw is None else replace(total.raw, waveforms=flickering)
    later = {name: with_levels(x, lights) for name, x in light.later.items()}
    statistics, rendered_for = light.statistics, light.rendered_for
    if statistics.brightness is not None:  # of all lamps as they were rendered
        unknown = dict.fromkeys(statistics.brightness, None)
        scale = {"light_scale": statistics.brightness["light_scale"]}
        statistics = replace(statistics, brightness=unknown | scale)
    if rendered_for is not None and total.rendered_for is not None:
        rendered_for = replace(rendered_for, illuminant=total.rendered_for.illuminant)
    return replace(
        total,
        statistics=statistics,
        waveforms=flickering,
        raw=raw,
        later=later,
        rendered_for=rendered_for,
    )


def light_of_frame(light: Irradiance, shutter: Shutter) -> Irradiance:
    """Return the light of the rows of one frame under flickering lamps; unchanged without flicker.

    Statistics still describe the render, without notes on groups that are off.
    """
    if not light.waveforms:
        return light
    first, weights = light.origin[0], dict[str, Level](light.levels)
    for name, waveform in light.waveforms.items():
        weights[name] = waveform.weights(shutter, (first, first + len(light.data)))
    total, statistics = sum_of_groups(light.groups, weights), light.statistics
    statistics = replace(statistics, notes=light.notes)
    return replace(total, statistics=statistics, groups={}, levels={})


def sum_of_groups(
    groups: Mapping[str, Irradiance], levels: Mapping[str, Level] | None = None
) -> Irradiance:
    """Return the sum of light groups, each times its level, with the statistics of the first group.

    levels : by name, one for all rows or one for each row; default 1.
    """
    weights: dict[str, Level] = {**dict.fromkeys(groups, 1.0), **(levels or {})}
    first = next(iter(groups.values()))
    parts = [_part(light, weights[name]) for name, light in groups.items()]
    relative_error = _relative(parts, lambda light: light.relative_error)
    assert relative_error is not None
    rendered_for = first.rendered_for
    if rendered_for is not None:
        rendered_for = replace(rendered_for, illuminant=_illuminant(parts))
    return replace(
        first,
        data=_data(parts),
        standard_error=_standard_error(parts),
        relative_error=relative_error,
        pass_error=_relative(parts, lambda light: light.pass_error),
        in_band=_in_band(parts),
        rendered_for=rendered_for,
        raw=_raw(groups, weights),
        groups=dict(groups),
        levels={name: float(np.mean(weight)) for name, weight in weights.items()},
    )


def _lit(parts: list[Part]) -> list[Part]:
    """Return the groups that are on: a level of 0 also removes infinite light."""
    return [part for part in parts if np.any(part.level)]


def _times(level: Level, values: Values) -> Values:
    """Return values, shape (H, W, …), times a level; 0 in rows at level 0, even for infinite light."""
    if np.ndim(level) == 0:
        return np.asarray(values.dtype.type(level) * values)
    factor = np.asarray(level, values.dtype).reshape(-1, *(1,) * (values.ndim - 1))
    lit = np.broadcast_to(factor > 0, values.shape)
    return np.asarray(np.multiply(values, factor, where=lit, out=np.zeros_like(values)))


def _data(parts: list[Part]) -> NDArray[np.float32]:
    """Return the irradiance of all groups at their levels, shape (H, W, B)."""
    total = np.zeros(parts[0].light.data.shape, np.float32)
    for part in _lit(parts):
        total += _times(part.level, part.light.data)
    return total


def _standard_error(parts: list[Part]) -> NDArray[np.float32]:
    """Return the standard errors of all groups in quadrature, shape (H, W, B)."""
    total = np.zeros(parts[0].light.standard_error.shape, np.float32)
    for part in _lit(parts):
        np.hypot(total, _times(part.level, part.light.standard_error), out=total)
    return total


def _relative(
    parts: list[Part], of: Callable[[Irradiance], NDArray[np.float32] | None]
) -> NDArray[np.float32] | None:
    """Return the relative error of the photoelectrons of the sum, shape (H, W); None if unknown for a group."""
    lit = _lit(parts)
    squares = np.zeros(parts[0].light.data.shape[:2])
    for part in lit:
        relative = of(part.light)
        if relative is None:
            return None
        squares += (relative * part.electrons) ** 2
    electrons = np.asarray(sum((part.electrons for part in lit), np.zeros_like(squares)))
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.sqrt(squares) / electrons
    error[np.isinf(electrons)] = np.inf
    return np.asarray(np.where(electrons > 0, error, 0.0), dtype=np.float32)


def _in_band(parts: list[Part]) -> NDArray[np.float32] | None:
    """Return the photoelectrons of the sum over those of spectra that are flat within each band, shape (H, W)."""
    first = parts[0].light.in_band
    if first is None:
        return None
    exact, flat = np.zeros(first.shape), np.zeros(first.shape)
    for part in _lit(parts):
        assert part.light.in_band is not None
        exact += part.electrons
        flat += part.flat
    return in_band_factor(exact, flat)


def _raw(groups: Mapping[str, Irradiance], weights: Mapping[str, Level]) -> Irradiance | None:
    """Return the sum before denoising; None if no group kept it."""
    if all(light.raw is None for light in groups.values()):
        return None
    return sum_of_groups({name: light.raw or light for name, light in groups.items()}, weights)


def _illuminant(parts: list[Part]) -> Illuminant | None:
    """Return the spectrum of the light on the scene: the sum over the groups at their levels; None if unknown."""
    spectra = [
        (float(np.mean(part.level)), part.light.rendered_for.illuminant)
        for part in _lit(parts)
        if part.light.rendered_for is not None
        and part.light.rendered_for.illuminant is not None
    ]
    if not spectra:
        return None
    power = np.sum([level * illuminant.power for level, illuminant in spectra], axis=0)
    return Illuminant(spectra[0][1].wavelengths_nm, power)


def _part(light: Irradiance, level: Level) -> Part:
    """Return a light group at a level, with the photoelectrons of the camera of the render; if that is unknown, with
    its light at all wavelengths."""
    camera = None if light.rendered_for is None else light.rendered_for.camera
    tile, weights = np.zeros((1, 1), int), light.bandwidths_nm[None, :]
    if light.filters is not None:
        weights = np.eye(len(light.filters))
    elif camera is not None:
        per_nm = camera.qe(light.wavelengths_nm, light.bandwidths_nm) * light.wavelengths_nm
        weights = np.atleast_2d(per_nm) * light.bandwidths_nm
    if camera is not None:
        tile = np.array(camera.tile)
    flat = np.empty(light.data.shape[:2])
    for first in range(0, len(flat), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        row, column = light.origin
        flat[rows] = of_own_filter(light.data[rows] @ weights.T, tile, (row + first, column))
    flat = _times(level, flat)
    exact = flat if light.in_band is None else flat * light.in_band
    return Part(level, light, exact, flat)


def notes_of_groups(notes: Mapping[str, Iterable[str]]) -> list[str]:
    """Return the notes of all groups, each with the names of its groups unless all groups have it.

    notes : by name of the group.
    """
    groups = _groups_by_note(notes)
    return [_with_names(note, names, len(notes)) for note, names in groups.items()]


def without_unlit(
    of_sum: Iterable[str], notes: Mapping[str, Iterable[str]], lit: Collection[str]
) -> tuple[str, ...]:
    """Return the notes of the sum of the groups, without notes that apply only to groups that are off.

    of_sum : including those of :func:`notes_of_groups`.  notes : by name of the group.  lit : groups that are on.
    """
    replacements = dict[str, str]()
    for note, names in _groups_by_note(notes).items():
        if len(names) == len(notes):
            continue
        on = [name for name in names if name in lit]
        whole = _with_names(note, names, len(notes))
        replacements[note] = replacements[whole] = ""
        if on:
            replacements[note], replacements[whole] = note, _with_names(note, on, len(notes))
    return tuple(line for note in of_sum if (line := replacements.get(note, note)))


def _groups_by_note(notes: Mapping[str, Iterable[str]]) -> dict[str, list[str]]:
    """Return the names of the groups of each note."""
    groups = dict[str, list[str]]()
    for name, of_group in notes.items():
        for note in dict.fromkeys(of_group):
            groups.setdefault(note, []).append(name)
    return groups


def _with_names(note: str, names: Collection[str], count: int) -> str:
    """Return a note after the names of its groups, unless all groups have it.  count : number of all groups."""
    return note if len(names) == count else f"{', '.join(names)}: {note}"
