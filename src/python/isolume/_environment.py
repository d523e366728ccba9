"""Distant light."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from . import _isolume
from ._error import argument


def environments() -> list[str]:
    """Names of the environments that come with the package. There are skies by formula, too: ``constant``, ``gradient``,
    ``overcast``, ``sky`` and ``sun:AZIMUTH,ELEVATION``.

    >>> isolume.environments()
    ['courtyard', 'studio', 'sunset']
    """
    return sorted(_isolume.built_in_environments())


def colormaps() -> list[str]:
    """Names of the colour scales.

    >>> "viridis" in isolume.colormaps()
    True
    """
    return list(_isolume.colormaps())


class Environment:
    """An image of distant light around a volume.

    Parameters
    ----------
    source
        A name of `environments` or of a sky; a path of an OpenEXR, Radiance, PNG or JPEG image; an array
        [height, width, 3] of linear radiance, the top row first, width twice the height.
    rotate
        Degrees by which the light is turned counter-clockwise, seen from above.
    keep_negative
        Keeps negative pixels of images.
    layout
        Layout of an image, where its shape does not say.

    Examples
    --------
    >>> sky = isolume.Environment("sky:30,40")
    >>> sky.name
    'sky:30,40'
    >>> isolume.Environment(numpy.ones((8, 16, 3)), rotate=90).image().shape
    (8, 16, 3)
    """

    def __init__(
        self,
        source: str | os.PathLike | np.ndarray,
        rotate: float = 0.0,
        *,
        keep_negative: bool = False,
        layout: str | None = None,
        name: str | None = None,
    ) -> None:
        if isinstance(source, (str, os.PathLike)):
            self._inner = _isolume.Environment.open(os.fspath(source), float(rotate), keep_negative, layout)
            return
        image = np.asarray(source)
        if image.dtype.kind not in "fiu":
            raise TypeError(f"environment: given {image.dtype}, expected an array of linear radiance")
        if image.ndim != 3:
            expected = "height × width × 3: red, green and blue"
            remedy = "give linear radiance, the top row first"
            raise argument("environment", f"an array of the shape {image.shape}", expected, remedy)
        if image.dtype.kind != "f":
            expected = "linear radiance in floating-point numbers"
            raise argument("environment", f"{image.dtype}", expected, "sRGB bytes have to be made linear first")
        pixels = np.ascontiguousarray(image, dtype=np.float32)
        self._inner = _isolume.Environment.from_array(name or "array", pixels, float(rotate))

    @property
    def name(self) -> str:
        """Its name: of a file without folder and ending."""
        return self._inner.name

    @property
    def rotate(self) -> float:
        """Degrees by which it is turned."""
        return self._inner.rotate

    def image(self) -> np.ndarray:
        """Linear radiance, float32 [height, width, 3]."""
        return self._inner.image()

    def __repr__(self) -> str:
        turned = f", rotate={self.rotate:g}" if self.rotate else ""
        return f"isolume.Environment({self.name!r}{turned})"


def environment_of(env: Any) -> Environment:
    """An environment of what may stand for one."""
    return env if isinstance(env, Environment) else Environment(env)
