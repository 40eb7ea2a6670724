"""The twin of a camera that reads every pixel several times: fitted read-out by read-out, from frames of each."""

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

OWN = ("pixel.full_well_e", "source_follower.", "readout.", "adc.")
"""Fields, or beginnings of fields, that a read-out may have differently."""
OF_PHOTODIODE = ("pixel.prnu", "dark_current.")
"""Those that a photodiode of its own may have differently, too."""
Tables: TypeAlias = Mapping[str, Any]
"""Of a camera file."""
ALIKE = ("adc.bits", "dark_current.at_temperature_k")
"""Fields that stand in the tables of the first read-out, and only there."""


@dataclass(eq=False)
class ReadoutTwins:
    """Fitted from frames of each read-out of one camera.

    ::

        twins = ms.lab.fit_readouts({"high": "bench/high/", "low": "bench/low/"})
        camera = ms.load_camera(twins.tables())

    twins : of each read-out by its name, the most sensitive first.
    """

    twins: Mapping[str, Twin]

    @property
    def notes(self) -> tuple[str, ...]:
        """What restricts the figures of each read-out."""
        found = list[str]()
        for name, twin in self.twins.items():
            found += [f"read-out {name}: {note}" for note in twin.notes]
        return tuple(found)

    def figures(self) -> dict[str, dict[str, Fitted]]:
        """All figures with intervals, by read-out and symbol."""
        return {name: twin.figures() for name, twin in self.twins.items()}

    def tables(self, like: Tables | None = None) -> dict[str, object]:
        """The tables of a camera file, for ``ms.load_camera(twins.tables())``.

        like : tables of a camera (``camera.model_dump()``) that give what frames do not show: with read-outs of these
            names also what each is of, its exposure and its sensitivity, and how they are combined and companded.
            Without one all read the same charge.
        Raises InputError for a camera with read-outs of other names.
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
        """The read-outs of a camera by their names. Raises InputError where they are others than those fitted."""
        given = (like or {}).get("readouts") or ()
        known = {one["name"]: dict(one) for one in given}
        for name in self.twins:
            if known and name not in known:
                raise InputError(
                    f"the frames are of a read-out {name!r}, and {(like or {})['name']} has "
                    f"{', '.join(known)}; name them alike.{nearest(name, known)}"
                )
        return known


def fit_readouts(frames: Mapping[str, str | os.PathLike[str] | Bench]) -> ReadoutTwins:
    """The twin of a camera with several read-outs, from bias, dark and flat frames of each of them.

    ::

        twins = ms.lab.fit_readouts({"high": "bench/high/", "low": "bench/low/"})

    frames : by the name of the read-out, the most sensitive first, what :func:`fit` takes.
    Raises InputError for fewer than two, for frames of several gain settings, and where :func:`fit` does.
    """
    if len(frames) < 2:
        raise InputError(
            f"frames are of {len(frames)} read-out(s); give those of two or more by their names, or use fit()."
        )
    twins = dict[str, Twin]()
    for name, bench in frames.items():
        twins[name] = fit(bench)
        if len(twins[name].settings) > 1:
            raise InputError(
                f"the frames of read-out {name!r} have {len(twins[name].settings)} gain settings; a read-out has one: "
                "give each setting as a read-out of its own."
            )
    return ReadoutTwins(twins)


def _own_fields(twin: Twin, own_photodiode: bool) -> Iterator[tuple[str, object]]:
    """The fields of a read-out behind the first.  own_photodiode : whether it has a photodiode of its own."""
    allowed: tuple[str, ...] = OWN
    if own_photodiode:
        allowed = OWN + OF_PHOTODIODE
    gain = twin.base.gain
    values = [*fields_of(twin.base), Value("readout.gain_dn_per_e", gain.quantity.value)]
    for name, value, _ in values:
        if name.startswith(allowed) and name not in ALIKE and value is not None:
            yield name, value
