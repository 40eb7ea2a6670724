"""Names of the noise sources of a camera, by which each of them can be switched off."""

from __future__ import annotations

from collections.abc import Iterable

from ..core import InputError, nearest
from ..stages.chain import ORDER
from ..stages.datasheet import SensorSection


def noise_sources() -> tuple[str, ...]:
    """Keys of the stages that are noise sources, in the order of the chain."""
    return tuple(effect.key() for effect in ORDER if not effect.no_noise)


def checked_source(name: object, more: Iterable[str] = ()) -> str:
    """The key of a noise source: ``dsnu_column``, or as a table of stages prints it, ``DSNU column``.

    more : keys of stages that the user added.  Raises InputError for any other name.
    """
    known = (*noise_sources(), *more)
    if not isinstance(name, str):
        raise InputError(f"without names {name!r}; give names of noise sources: {', '.join(known)}.")
    key = name.strip().lower().replace(" ", "_").replace("-", "_")
    if key in known:
        return key
    remedy = next((effect.no_noise for effect in ORDER if effect.key() == key), "")
    if remedy:
        raise InputError(f"without names {name!r}, which is no noise source; {remedy}.")
    raise InputError(f"without names {name!r}; the noise sources are {', '.join(known)}.{nearest(key, known)}")


def with_checked_sources(section: SensorSection) -> SensorSection:
    """The table with the keys of its ``without`` in the order of the chain, each once. Raises InputError."""
    off = {checked_source(name) for name in section.without}
    return section.model_copy(update={"without": tuple(name for name in noise_sources() if name in off)})
