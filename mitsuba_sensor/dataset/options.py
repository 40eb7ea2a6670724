"""The options of a run: which part of a dataset is made, by how many processes, within which limits."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from typing import Annotated, TypedDict

from ..core import InputError
from ..core.options import Option

ENGINE = "Engine"


def checked_shard(name: str, value: object) -> tuple[int, int]:
    """(i, n) of "i/n" or of a pair. Raises InputError."""
    pair = value if isinstance(value, tuple) else str(value).split("/")
    parts = [str(one) for one in pair]
    if (
        len(parts) != 2
        or not all(one.isdecimal() for one in parts)
        or not 1 <= int(parts[0]) <= int(parts[1]) <= 10**6
    ):
        raise InputError(f"{name} is {value!r}; give i/n with i from 1 to n, e.g. 1/4.")
    return int(parts[0]), int(parts[1])


class RootOptions(TypedDict, total=False):
    """Which files a dataset may read."""

    roots: Annotated[
        list[str] | None,
        Option(
            "Folder in which scenes, cameras and motions are looked for, beside that of the dataset file. Repeatable. "
            "Default: the current folder.",
            flag="--root",
            metavar="DIR",
            panel="Scene",
            text=list[str],
        ),
    ]
    untrusted: Annotated[
        bool,
        Option(
            "Read files below these folders and that of the dataset file only, whatever the file and its scenes name: "
            "for those that somebody else has written.",
            False,
            panel="Scene",
        ),
    ]


class RunOptions(TypedDict, total=False):
    """All options of :func:`dataset.run`."""

    workers: Annotated[
        int | None,
        Option(
            "Processes of this machine; 0 is this process alone, which dies with a scene that ends its renderer. "
            "Default: 2 where there are two cores.",
            low=0,
            high=1024,
            example="2",
            panel=ENGINE,
        ),
    ]
    scheduler: Annotated[
        str | None,
        Option(
            "Use the workers of this Dask scheduler instead; all must see DIR and the scenes.",
            metavar="tcp://HOST:PORT",
            panel=ENGINE,
        ),
    ]
    tls_ca: Annotated[
        str | None,
        Option(
            "Certificate authority of a scheduler at tls://HOST:PORT.",
            metavar="FILE",
            panel=ENGINE,
        ),
    ]
    tls_cert: Annotated[
        str | None, Option("Certificate that is shown to it.", metavar="FILE", panel=ENGINE)
    ]
    tls_key: Annotated[
        str | None, Option("Private key of that certificate.", metavar="FILE", panel=ENGINE)
    ]
    shard: Annotated[
        tuple[int, int] | None,
        Option(
            "Make the i-th of n equal parts only: n machines then need no scheduler.",
            check=checked_shard,
            metavar="i/n",
            panel=ENGINE,
            text=str,
        ),
    ]
    timeout_s: Annotated[
        float | None,
        Option(
            "End a process that takes longer for a light and its samples, in seconds. Default: never.",
            low=0.001,
            high=1e9,
            example="600",
            panel=ENGINE,
        ),
    ]
    memory_gb: Annotated[
        float | None,
        Option(
            "End a process that takes more memory, in GB; 0.3 are taken before the first render. Default: no limit.",
            low=0.5,
            high=1e6,
            example="4",
            panel=ENGINE,
        ),
    ]
    retry: Annotated[
        bool, Option("Also try again what could not be made.", False, panel=ENGINE)
    ]
