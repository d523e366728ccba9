"""Volumes, and the bake."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np

from ._environment import environment_of
from ._error import argument
from ._progress import Progress, progress_of
from ._store import Store, isovalue_text


class Volume:
    """A scalar field on a grid, or the volumes of a scene. `isolume.open` makes it."""

    def __init__(self) -> None:
        raise TypeError("volumes are made by isolume.open(…)")

    @classmethod
    def _of(cls, inner: Any, warn: bool = False) -> Volume:
        made = object.__new__(cls)
        made._inner = inner
        made._stores = {}
        if warn:
            for note in inner.notes:
                warnings.warn(f"{inner.name}: {note}", stacklevel=3)
        return made

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples along z, y, x."""
        x, y, z = self._inner.dims
        return (z, y, x)

    @property
    def dtype(self) -> np.dtype:
        """Type of the samples as they are held."""
        return np.dtype(self._inner.dtype)

    @property
    def name(self) -> str:
        """Its name."""
        return self._inner.name

    @property
    def names(self) -> list[str]:
        """Names of the volumes of a scene, the first of which isovalues are of."""
        return self._inner.names

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self._inner.range

    @property
    def affine(self) -> np.ndarray:
        """4 × 4, from (x, y, z) in samples to world."""
        return np.array(self._inner.affine)

    @property
    def bounds(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Smallest and largest corner of the box in world: (x, y, z) each."""
        low, high = self._inner.bounds
        return tuple(low), tuple(high)

    @property
    def metres(self) -> float | None:
        """Metres to a unit of world, if known."""
        return self._inner.metres

    @property
    def up(self) -> str:
        """The axis of world that points up."""
        return self._inner.up

    @property
    def notes(self) -> list[str]:
        """What was noticed when it was read, such as NaN that were replaced."""
        return self._inner.notes

    @property
    def address(self) -> int:
        """Where its samples lie in memory: that of the array, if it was not copied."""
        return self._inner.address

    def isovalue(self, isovalue: float | str = "auto") -> float:
        """The value that an isovalue means: a number, ``"40%"`` of the range, ``"otsu"``, ``"1.5sigma"``, ``"300HU"``, ``"auto"``, …

        >>> isolume.open("bumpbox:16").isovalue("auto")
        30.0
        """
        return self._inner.isovalue(isovalue_text(isovalue))[0]

    def bake(
        self,
        isovalues: Any = None,
        *,
        error: float | None = None,
        time: float | None = None,
        rays: int | None = None,
        layers: int = 4,
        bands: int | None = None,
        texture: float | str | None = None,
        positive: bool = False,
        estimator: str = "path",
        env: Any = None,
        albedo: float = 0.7,
        store: str | os.PathLike | None = None,
        cache: str | os.PathLike | None = None,
        progress: bool | Progress | None = None,
        threads: int | None = None,
        seed: int = 0,
        memory_limit: int | None = None,
    ) -> Store:
        """Computes how light gets about on isosurfaces, without knowing the light.

        The same bake into the same store goes on where it was stopped, by Ctrl-C too, and ends with the same bytes for any number
        of threads. Other Python threads run meanwhile.

        Parameters
        ----------
        isovalues
            One or several: numbers, or texts as `isovalue` takes them. They are baked at the vertices of their isosurfaces. ``None``:
            all isovalues, as a texture.
        error
            Standard error of the radiance over its mean to stop at, such as 0.01; 0.02 by default, by at most 2²⁸ paths in all.
        time
            Seconds that it may take, in place of an error.
        rays
            Rays a vertex or texel, a power of two; with an error or a time the most.
        layers, bands
            Stored layers of light (1: direct light alone), and spherical-harmonic bands in each.
        texture
            Texels for each sample along an axis, such as 0.5 or 1: a texture for named isovalues, too. Of all isovalues also
            ``"adaptive:2%"``: up to two, but those are left out that can be interpolated with this error.
        positive
            Transfer that stays non-negative, at more noise.
        estimator
            ``"path"``, ``"gather"`` or ``"photon"``.
        env, albedo
            Environments that errors are measured by, and the albedo of the surface under them; white light by default.
        store
            Path of the store, mostly ``….isolume``. By default it lies in the user's cache, or in the folder ``cache``, where the
            next run finds it.
        progress
            ``True`` for a bar, or a function of done, total and the seconds left. An exception of it stops the bake and passes
            through; what was done is kept.
        threads
            One per core by default.
        memory_limit
            Bytes that it may use; by default 80 % of what the machine allows.

        Examples
        --------
        >>> store = isolume.open("bumpbox:16").bake(47, rays=16, bands=3, layers=2, store=folder / "bumps.isolume")
        >>> store.isovalues
        [47.0]
        """
        if isovalues is None:
            texts = None
        elif isinstance(isovalues, (str, int, float, np.number)):
            texts = [isovalue_text(isovalues)]
        elif isinstance(isovalues, Iterable):
            texts = [isovalue_text(c) for c in isovalues]
        else:
            raise TypeError(f"isovalues: given {type(isovalues).__name__}, expected a number, a text, or several")
        envs = [] if env is None else list(env) if isinstance(env, (list, tuple)) else [env]
        lights = [environment_of(one)._inner for one in envs]
        if error is not None and isinstance(error, str):
            raise argument("error", error, "a number such as 0.01", "1 % is 0.01")
        with progress_of(progress) as tell:
            inner = self._inner.bake(
                texts,
                error=error,
                time=time,
                rays=rays,
                layers=layers,
                bands=bands,
                texture=None if texture is None else str(texture),
                positive=positive,
                estimator_name=estimator,
                lights=lights,
                albedo=albedo,
                store=None if store is None else os.fspath(store),
                cache=None if cache is None else os.fspath(cache),
                progress=tell,
                threads=threads,
                seed=seed,
                memory_limit=memory_limit,
            )
        return Store._of(inner)

    def __repr__(self) -> str:
        z, y, x = self.shape
        low, high = self.range
        return f"<isolume.Volume {self.name}: {z} × {y} × {x} {self.dtype}, {low:g} to {high:g}>"
