"""Measurements that outlive the process that made them: a file each, kept apart by all that decides their values."""

from __future__ import annotations

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..core import InputError
from ..files.appearing import appearing
from ..files.disk_errors import disk_sentences
from ..files.texts import plain_values
from .records import classes_of, read_value, write_value


class Measurements(dict[str, Any]):
    """A dict of measurements by name whose values are also files; a study that was stopped finds there what it had.

    folder : of the files; made with the first measurement.  force : forget what there is for this question.
    question : all that decides what is measured, as plain values. The files of each question lie in a folder of their
        own, so that measurements of another camera, scene, version or machine are never read.
    records : dataclasses and named tuples that measurements consist of; no other class is made from a file.
    """

    def __init__(self, folder: Path, question: object, force: bool = False, records: tuple[type, ...] = ()) -> None:
        super().__init__()
        text = json.dumps(plain_values(question, finite=False), sort_keys=True)
        self.folder = folder / hashlib.sha256(text.encode()).hexdigest()[:16]
        if force:
            shutil.rmtree(self.folder, ignore_errors=True)
        classes = classes_of(*records)
        for path in sorted(self.folder.glob("*.npz")):
            with suppress(InputError, OSError, ValueError, TypeError):  # one that was cut short is measured again
                pair = read_value(path, classes)
                if isinstance(pair, tuple) and len(pair) == 2:
                    self.update([pair])

    def __setitem__(self, name: str, value: Any) -> None:
        super().__setitem__(name, value)
        with disk_sentences(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        with appearing(self.folder / f"{hashlib.sha256(name.encode()).hexdigest()[:24]}.npz") as path:
            write_value(path, (name, value))
