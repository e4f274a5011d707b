"""Pictures written to disk: EXR and NPY as they were computed, PNG for the eye; complete or not there at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from whitted_validation.refusal import Refusal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FORMATS = (".exr", ".png", ".npy")
MAX_EXPOSURE = 126  # stops: float32 spans no more, from its least normal number to 1


def check_writable(path: Path, exposure: float | None = None) -> None:
    """See, before any work is done, that a picture can be written here.

    Raises
    ------
    Refusal
        If the ending is unknown, the folder is missing or closed, or an exposure is given that is out of
        range or not for this kind of picture.
    """
    if path.suffix.lower() not in FORMATS:
        raise Refusal(f"{path}: a picture ends in {', '.join(FORMATS)}")
    if exposure is not None and path.suffix.lower() != ".png":
        raise Refusal(f"--exposure is for .png; {path} holds the picture as it was computed")
    if exposure is not None and not abs(exposure) <= MAX_EXPOSURE:
        raise Refusal(f"--exposure {exposure:g}: allowed are -{MAX_EXPOSURE}..{MAX_EXPOSURE} stops")
    if path.is_dir():
        raise Refusal(f"{path}: is a folder")
    with _beside(path) as draft:
        draft.touch()


def write(path: Path, picture: NDArray[np.float32], exposure: float = 0.0) -> None:
    """Write a picture; a file of that name is replaced, in one step.

    Parameters
    ----------
    path
        The ending chooses: ``.exr`` float32, ``.npy`` float32, ``.png`` 8-bit sRGB.
    picture
        (height, width, 1 or 3) linear values, of any size.
    exposure
        In stops: a PNG shows 2**exposure times the picture.
    """
    import mitsuba as mi
    import numpy as np

    with _beside(path) as draft:
        match path.suffix.lower():
            case ".npy":
                np.save(draft, picture)
            case ".exr":
                mi.Bitmap(picture).write(str(draft))
            case ".png":
                mi.Bitmap(_srgb(picture * 2.0**exposure)).write(str(draft))
        draft.replace(path)


def write_bands(path: Path, height: int, bands: Iterable[NDArray[np.float32]]) -> None:
    """Write a ``.npy`` of `height` rows from bands of them, (rows, width, channels) float32, as they come."""
    import numpy as np

    with _beside(path) as draft:
        with draft.open("wb") as file:
            for i, band in enumerate(bands):
                if i == 0:
                    shape = (height, *band.shape[1:])
                    header = {"descr": "<f4", "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(file, header)
                file.write(band.astype("<f4", copy=False).tobytes())
        draft.replace(path)


def _srgb(picture: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Encode linear values as 8-bit sRGB (IEC 61966-2-1), to the nearest step; Mitsuba's own cuts off."""
    import numpy as np

    linear = np.clip(picture.astype(np.float64), 0.0, 1.0)
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255.0 * coded + 0.5).astype(np.uint8)


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    """Offer a name for a draft in the same folder, and leave nothing there."""
    draft = path.with_name(f".{path.stem[:32]}.{os.getpid()}{path.suffix.lower()}")
    try:
        yield draft
    except OSError as error:
        raise Refusal(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):  # where the folder is none, there is nothing to clear away
            draft.unlink(missing_ok=True)
