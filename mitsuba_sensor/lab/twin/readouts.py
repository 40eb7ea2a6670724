"""The twin of a camera that reads every pixel several times, fitted to frames of each readout."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from ...core import InputError, nearest
from ..frames.bench import Bench
from .evidence import Fitted
from .fields import Value, fields_of
from .fit import Twin, fit

READOUT_FIELDS = ("pixel.full_well_e", "source_follower.", "readout.", "adc.")
"""Fields, or beginnings of fields, that may differ between readouts."""
PHOTODIODE_FIELDS = ("pixel.prnu", "dark_current.")
"""Fields that may also differ for a separate photodiode."""
Tables: TypeAlias = Mapping[str, Any]
"""Tables of a camera file."""
SHARED_FIELDS = ("adc.bits", "dark_current.at_temperature_k")
"""Fields that only the tables of the first readout have."""


@dataclass(eq=False)
class ReadoutTwins:
    """Twins of all readouts of one camera.

    ::

        twins = ms.lab.fit_readouts({"high": "bench/high/", "low": "bench/low/"})
        camera = ms.load_camera(twins.tables())

    twins : twin of each readout by its name, the most sensitive first.
    """

    twins: Mapping[str, Twin]

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the figures of each readout."""
        return tuple(
            f"readout {name}: {note}"
            for name, twin in self.twins.items()
            for note in twin.notes
        )

    def figures(self) -> dict[str, dict[str, Fitted]]:
        """Return all figures with intervals, by readout and symbol."""
        return {name: twin.figures() for name, twin in self.twins.items()}

    def tables(self, like: Tables | None = None) -> dict[str, object]:
        """Return the tables of a camera file, for ``ms.load_camera(twins.tables())``.

        like : tables of a camera (``camera.model_dump()``) that give what frames do not show; its readouts of the same
            names also give origin, exposure and sensitivity, combination and companding. Otherwise all readouts read
            the same charge.
        Raises InputError for a camera with readouts of other names.
        """
        (name, first), *others = self.twins.items()
        known = self._readouts_of(like)
        data = first.tables(like)
        data["readout"]["gain_dn_per_e"] = first.base.gain.quantity.value
        data["sources"]["readout.gain_dn_per_e"] = first.base.gain.source
        data["adc"].pop("full_scale_v", None)
        data["sources"].pop("adc.full_scale_v", None)
        readouts: list[dict[str, object]] = [
            {**known.get(name, {}), "name": name, "fields": {}}
        ]
        for name, twin in others:
            table = {**known.get(name, {}), "name": name}
            table["fields"] = dict(_own_fields(twin, table.get("of") == "photodiode"))
            readouts.append(table)
        data["readouts"] = readouts
        data["sources"]["readouts"] = f"fit: frames of {', '.join(self.twins)}"
        return data

    def _readouts_of(self, like: Tables | None) -> dict[str, dict[str, object]]:
        """Return the readouts of a camera by their names. Raises InputError if a fitted readout is missing."""
        known = {table["name"]: dict(table) for table in (like or {}).get("readouts") or ()}
        for name in self.twins:
            if known and name not in known:
                raise InputError(
                    f"the frames have a readout {name!r}, and {(like or {})['name']} has {', '.join(known)}; use equal "
                    f"names.{nearest(name, known)}"
                )
        return known


def fit_readouts(frames: Mapping[str, str | os.PathLike[str] | Bench]) -> ReadoutTwins:
    """Fit the twin of a camera with several readouts to bias, dark and flat frames of each readout.

    ::

        twins = ms.lab.fit_readouts({"high": "bench/high/", "low": "bench/low/"})

    frames : the frames for :func:`fit` by the name of the readout, the most sensitive first.
    Raises InputError for fewer than two readouts, for several gain settings, and as :func:`fit` does.
    """
    if len(frames) < 2:
        raise InputError(
            f"frames has {len(frames)} readout(s); pass two or more by their names, or use fit()."
        )
    twins = dict[str, Twin]()
    for name, bench in frames.items():
        twins[name] = fit(bench)
        if len(twins[name].settings) > 1:
            raise InputError(
                f"the frames of readout {name!r} have {len(twins[name].settings)} gain settings; pass each setting as "
                "a separate readout."
            )
    return ReadoutTwins(twins)


def _own_fields(twin: Twin, separate_photodiode: bool) -> Iterator[tuple[str, object]]:
    """Yield the fields of a readout after the first.  separate_photodiode : True if it has a photodiode of its own."""
    allowed = READOUT_FIELDS + (PHOTODIODE_FIELDS if separate_photodiode else ())
    gain = twin.base.gain
    values = [*fields_of(twin.base), Value("readout.gain_dn_per_e", gain.quantity.value)]
    for name, value, _ in values:
        if name.startswith(allowed) and name not in SHARED_FIELDS and value is not None:
            yield name, value
