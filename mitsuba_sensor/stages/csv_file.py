"""CSV files beside a camera file."""

from collections.abc import Collection
from pathlib import Path

from ..core.csv_rows import rows_of
from ..core.small_files import require_small


def read_rows(
    name: str, folder: str, what: str, first_names: Collection[str] = ()
) -> list[list[str]]:
    """Return the cells of a file in ``folder``, the folder of the camera file. Raises ValueError.

    what : description of the file, for errors.  first_names : see :func:`rows_of`.
    """
    path = Path(folder) / name
    try:
        require_small(path, what)
        return rows_of(path.read_text("utf-8-sig"), first_names)
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(
            f"file {name!r} cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
