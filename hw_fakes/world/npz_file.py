"""Arrays out of an npz file that a user names."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quavelet.core.errors import SettingsError


def arrays_in(path: str | Path, *, named_after: str) -> dict[str, NDArray[Any]]:
    """All arrays of the file, by name; `named_after` is what stands before the path where the user wrote it.

    Raises SettingsError, naming the file, where it cannot be read.
    """
    try:
        # Opened here, since numpy leaves a file open that turns out to be damaged.
        with Path(path).open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {name: np.asarray(file[name]) for name in file.files}
    except FileNotFoundError:
        raise SettingsError(f"there is no recording {path}: check the name after {named_after}") from None
    except (OSError, EOFError, ValueError, AttributeError, TypeError, zipfile.BadZipFile) as error:
        raise SettingsError(f"{path} is not an npz file that can be read ({error}): give another") from error
