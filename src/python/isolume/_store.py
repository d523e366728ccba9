"""Stores of light transfer."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _isolume
from ._environment import environment_of
from ._error import argument
from ._progress import Progress, progress_of
from ._surface import StatedError, Surface, write_whole


def isovalue_text(isovalue: Any) -> str:
    """An isovalue as the library reads it."""
    if isinstance(isovalue, str):
        return isovalue
    if isinstance(isovalue, (bool, np.bool_)) or not isinstance(isovalue, (int, float, np.integer, np.floating)):
        raise TypeError(f"isovalue: given {type(isovalue).__name__}, expected a number or a text such as 'auto' or '40%'")
    return repr(float(isovalue))


def triple(value: Any, name: str) -> list[float]:
    """One number for three channels, or three."""
    found = np.asarray(value, dtype=np.float64)
    if found.ndim == 0:
        found = np.full(3, float(found))
    if found.shape != (3,):
        raise argument(name, value, "one number, or three: red, green, blue", "they are linear, not sRGB")
    return found.tolist()


def _several(envs: Any) -> list[Any]:
    return [environment_of(env)._inner for env in (envs if isinstance(envs, (list, tuple)) else [envs])]


@dataclass(frozen=True)
class Textures:
    """The relit texture of a volume: any contour made elsewhere is lit by looking it up there."""

    radiance: np.ndarray
    """Linear radiance of the level set through each texel, float32 [z, y, x, 3]."""
    valid: np.ndarray
    """uint8 [z, y, x]: 1 where there is a level set, 2 where the radiance was filled from neighbours, 0 where there is none."""
    value: np.ndarray
    """The scalar field, float32 [z, y, x]."""
    affine: np.ndarray
    """4 × 4, from (x, y, z) in texels to world."""


class Store:
    """The light transfer of a volume, on disk. `Volume.bake` or `isolume.open` make it."""

    def __init__(self) -> None:
        raise TypeError("stores are made by Volume.bake(…), or by isolume.open('….isolume')")

    @classmethod
    def _of(cls, inner: Any) -> Store:
        made = object.__new__(cls)
        made._inner = inner
        return made

    @classmethod
    def _open(cls, path: str) -> Store:
        return cls._of(_isolume.Store.open(path))

    @property
    def path(self) -> str:
        """Where it is."""
        return os.fspath(self._inner.path)

    @property
    def isovalues(self) -> list[float] | None:
        """Isovalues that it holds; ``None`` where it holds all."""
        listed, holds_all = self._inner.holdings()
        return None if holds_all else listed

    @property
    def volumes(self) -> list[str]:
        """Names of the volumes, which light each other where there are several."""
        return self._inner.volumes

    @property
    def bands(self) -> list[int]:
        """Spherical-harmonic bands of each layer."""
        return self._inner.bands

    @property
    def notes(self) -> list[str]:
        """What was noted while it was baked."""
        return self._inner.notes

    @property
    def zarr(self) -> Any:
        """The store as a group of zarr (version 3), read-only."""
        import zarr

        return zarr.open_group(self.path, mode="r")

    def surface(
        self,
        isovalue: float | str = "auto",
        env: Any = "sunset",
        *,
        volume: str | None = None,
        rotate: float = 0.0,
        albedo: Any = 0.7,
        colormap: str | None = None,
        emission: Any = 0.0,
        exposure: float | None = None,
        sun_split: bool | int | str = False,
        window: str = "none",
        luminaires: dict[str, Any] | None = None,
        progress: bool | Progress | None = None,
    ) -> Surface:
        """An isosurface under an environment: arrays of points, triangles and colours.

        An isovalue that the store does not hold is baked first, and stays in it. Once an isosurface was asked for, another
        environment or material takes milliseconds.

        Parameters
        ----------
        isovalue
            A number or a text as `Volume.isovalue` takes it; of the first volume, or of the one that is named. Volumes that light
            each other are shown together.
        env
            An `Environment`, or what makes one.
        rotate
            Degrees by which the light is turned counter-clockwise, seen from above.
        albedo
            Linear reflectance, one number or three; with a colormap a factor on its colours.
        colormap
            A colour scale over the isovalue, such as ``"magma"`` or ``"magma:0..255"``.
        emission
            Linear emitted radiance, one number or three.
        exposure
            Stops; by default the 99th percentile becomes white.
        sun_split
            Whether lamps are lit apart, with sharp shadows, by visibility rays: that takes seconds. ``True`` takes those that need
            it, a number so many. ``False``: light and transfer are multiplied alone.
        window
            ``"lanczos"``, ``"hanning"`` or ``"certified"`` against ringing.
        luminaires
            Factors on the power of the luminaires of a scene.

        Examples
        --------
        >>> surface = store.surface(47, "courtyard")
        >>> surface.points.shape == surface.normals.shape == surface.radiance.shape
        True
        >>> surface.rgb.dtype, int(surface.faces.max()) + 1 == len(surface.points)
        (dtype('uint8'), True)
        """
        factors = [(name, triple(factor, "luminaires")) for name, factor in (luminaires or {}).items()]
        split = {True: "auto", False: "off"}[sun_split] if isinstance(sun_split, bool) else str(sun_split)
        with progress_of(progress) as tell:
            inner = self._inner.surface(
                isovalue_text(isovalue),
                volume,
                environment_of(env)._inner,
                float(rotate),
                triple(albedo, "albedo"),
                colormap,
                triple(emission, "emission"),
                None if exposure is None else float(exposure),
                split,
                window,
                factors,
                tell,
            )
        return Surface._of(inner, self)

    def error(self, env: Any, isovalue: float | str = "auto", **light: Any) -> StatedError:
        """How far the colours of a surface are from exact light transport; ``light`` as `surface` takes it.

        >>> bool(0 < store.error("courtyard", 47).noise < 0.2)
        True
        """
        return self.surface(isovalue, env, **light).error

    def textures(
        self,
        env: Any = "sunset",
        *,
        rotate: float = 0.0,
        albedo: Any = 0.7,
        emission: Any = 0.0,
        window: str = "none",
        luminaires: dict[str, Any] | None = None,
    ) -> Textures:
        """The relit texture, of a store that has one: ``bake()`` or ``bake(…, texture=1)``.

        >>> volume = isolume.open("bumpbox:12")
        >>> textures = volume.bake(rays=16, layers=1, bands=2, store=folder / "all.isolume").textures("sky")
        >>> textures.radiance.shape, textures.valid.dtype
        ((12, 12, 12, 3), dtype('uint8'))
        """
        factors = [(name, triple(factor, "luminaires")) for name, factor in (luminaires or {}).items()]
        light = environment_of(env)._inner
        found = self._inner.textures(
            light, float(rotate), triple(albedo, "albedo"), triple(emission, "emission"), window, factors
        )
        return Textures(found["radiance"], found["valid"], found["value"], np.array(found["affine"]))

    def html(
        self,
        path: str | os.PathLike,
        *,
        isovalue: float | str = "auto",
        env: Any = (),
        texture_side: int = 96,
        volume_side: int = 160,
    ) -> None:
        """Writes the live page with its data into one file, which opens in a browser without a network: every isosurface,
        relit interactively. For a store that has a texture, as `textures`.

        ``env``: an environment, or several, before those that every page has. ``texture_side``, ``volume_side``: most texels and
        samples along an axis; more are reduced to their means.
        """
        page = self._inner.html(isovalue_text(isovalue), _several(env), texture_side, volume_side)
        write_whole(os.fspath(path), page.encode("utf-8"))

    def view(
        self,
        isovalue: float | str = "auto",
        env: Any = "sunset",
        *,
        texture_side: int = 96,
        volume_side: int = 160,
        height: int = 560,
        **state: Any,
    ) -> Any:
        """The live page as a widget of a notebook (JupyterLab, Notebook 7, VS Code, Colab); needs the package anywidget, and a store
        that has a texture, as `textures`.

        Its traits ``isovalue``, ``env``, ``rotate``, ``albedo``, ``colormap``, ``exposure`` and ``camera`` go both ways; ``state`` sets
        them at the beginning. `isolume.sync` links the cameras of two.
        """
        from ._widget import Widget

        return Widget._of(self, isovalue, env, texture_side, volume_side, height, state)

    def __repr__(self) -> str:
        held = self.isovalues
        what = "all isovalues" if held is None else "isovalues " + ", ".join(f"{c:g}" for c in held)
        return f"<isolume.Store {self.path}: {what}>"
