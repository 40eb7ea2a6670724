"""The light of a view that several tasks need: rendered by one of them, and kept in the folder of the dataset."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from ...core import InputError
from ...files import durable
from ...files.claims import claimed, wait_for_claim
from ...output.exr import read_irradiance_exr, write_irradiance_exr
from ...render.light.irradiance import Irradiance
from ..store.record import MOST_BYTES, Entry
from ..store.store import Store

NAMES = "names.json"
"""The exposures that follow the first of a frame, whose light is in 1.exr, 2.exr, …"""


def shared_light(
    store: Store,
    entry: Entry,
    told: Callable[[str], object],
    render: Callable[[], Irradiance],
) -> Irradiance:
    """The light of a view: that which is stored, else rendered and stored. While another process renders it, wait.

    Raises InputError and DiskFull.
    """
    claim = store.folder_of(entry.kind, entry.name).with_name(f"{durable.SCRATCH}{entry.key}")
    while True:
        if (light := stored_light(store, entry)) is not None:
            return light
        with claimed(claim) as is_ours:
            if is_ours:
                light = stored_light(store, entry)  # it may have come between
                if light is None:
                    told("rendering")
                    light = render()
                    store.commit(entry, partial(_write, light))
                return light
        wait_for_claim(
            claim, lambda: store.exists(entry), lambda: told("waiting for another's render")
        )


def stored_light(store: Store, entry: Entry) -> Irradiance | None:
    """The light that is stored, with the bits that were rendered; None where there is none. One that is not as it was
    written, or cannot be read, is removed."""
    record = store.find(entry)
    if record is None:
        return None
    if not store.verify(entry.kind, record.name):
        with suppress(InputError, OSError):
            return _read(store.folder_of(entry.kind, record.name))
    store.discard(entry.kind, record.name)
    return None


def _write(light: Irradiance, folder: Path) -> None:
    durable.write_new(folder / NAMES, json.dumps([*light.later]).encode())
    for number, of_exposure in enumerate((light, *light.later.values())):
        write_irradiance_exr(folder / f"{number}.exr", of_exposure)


def _read(folder: Path) -> Irradiance:
    names = json.loads(durable.read_small(str(folder / NAMES), MOST_BYTES))
    first, *later = (
        read_irradiance_exr(folder / f"{number}.exr") for number in range(len(names) + 1)
    )
    return replace(first, later=dict(zip(names, later, strict=True)))
