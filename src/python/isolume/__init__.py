"""Light on every isosurface of a volume: bake once, then relight by any environment.

An array to a lit mesh of PyVista in three lines:

    import isolume
    store = isolume.open(array).bake(90)
    store.surface(90, "sunset").to_pyvista().plot(scalars="RGB", rgb=True, lighting=False)

``open`` takes what holds a volume (a path, an array of NumPy, dask or xarray, an image of SimpleITK or nibabel, a store) and
gives a `Volume`, or of a store a `Store`. `Volume.bake` computes how light gets about on the isosurfaces, which is stored and
knows no light yet; `Store.surface` lights one of them in milliseconds, and gives a `Surface`: arrays, pictures, files, and the
objects of other packages.

Axes of arrays are [z, y, x]; spacings and origins are x, y, z. Errors are `isolume.Error`.
"""

from __future__ import annotations

import os
from typing import Any

from . import _isolume
from ._arrays import is_array, placed
from ._environment import Environment, colormaps, environments
from ._error import Error, argument
from ._store import StatedError, Store, Textures
from ._surface import Surface
from ._volume import Volume

__version__ = _isolume.version()

__all__ = [
    "Environment",
    "Error",
    "StatedError",
    "Store",
    "Surface",
    "Textures",
    "Volume",
    "colormaps",
    "environments",
    "open",
    "sync",
]


def open(
    source: Any,
    *,
    spacing: Any = None,
    origin: Any = None,
    affine: Any = None,
    unit: str | None = None,
    name: str | None = None,
    solid: str | None = None,
    up: str | None = None,
    axes: str | None = None,
    channel: int | str | None = None,
    timepoint: int | None = None,
    array: str | None = None,
    keep_largest: bool = False,
    allow_outside: bool = False,
    copy: bool = False,
) -> Any:
    """Opens what holds a volume.

    Parameters
    ----------
    source
        A path of a volume file, a scene (``.toml``) or a store (``.isolume``); the name of an analytic field, such as
        ``"bumpbox:64"``; an array [z, y, x] of NumPy or dask, or what NumPy makes an array of; a ``DataArray`` of xarray; an
        image of SimpleITK or nibabel.
    spacing
        Distance of samples along x, y, z, in ``unit``; in place of the one that the source has.
    origin
        World position of the first sample; of arrays and images alone.
    affine
        Matrix of 4 × 4 from (x, y, z) in samples to world, in place of both; of arrays and images alone.
    unit
        Unit of world coordinates: ``"mm"``, ``"um"``, ``"nm"``, ``"A"``, …
    solid
        Which side of the isovalue is matter, ``"above"`` or ``"below"``; if not given, the choice of the isovalue decides.
    up
        The axis of world that points up: ``"z"`` (default), ``"x"``, ``"-y"``, …, or ``"anatomical"``.
    axes
        Order of the axes of a plain array: ``"zyx"`` (default), or ``"xyz"`` as nibabel has it.
    channel, timepoint
        Which of several, from 0, or the name of a channel. Arrays of four axes are [c or t, z, y, x], of five [t, c, z, y, x].
    array
        Which array of a file that names several.
    keep_largest
        Drops all parts of the solid but the largest.
    allow_outside
        Reads files that lie outside the folder of the file that names them.
    copy
        Copies an array that could be read where it is. Otherwise a C-contiguous array of 8- or 16-bit integers or float32 is
        not copied, and is read-only as long as the volume or a store that was baked of it lives.

    Returns
    -------
    Volume or Store

    Raises
    ------
    Error
        When there is no such file, it cannot be read, or what was given makes no sense.
    TypeError
        For arrays of complex numbers or objects.

    Examples
    --------
    >>> volume = isolume.open("bumpbox:24")
    >>> volume.shape, str(volume.dtype)
    ((24, 24, 24), 'float32')
    >>> isolume.open(numpy.zeros((4, 5, 6), "u1"), spacing=(1, 1, 2), unit="mm").bounds
    ((0.0, 0.0, 0.0), (5.0, 4.0, 6.0))
    """
    reading = dict(solid=solid, up=up, keep_largest=keep_largest)
    if isinstance(source, (str, os.PathLike)):
        path = os.fspath(source)
        if isinstance(path, bytes):
            path = os.fsdecode(path)
        for given, option in ((origin, "origin"), (affine, "affine"), (axes, "axes")):
            if given is not None:
                raise argument(option, "with a path", "an array or an image", "files say where their samples are")
        if _is_store(path):
            if spacing is not None or solid is not None or up is not None or keep_largest or channel is not None:
                raise argument("source", path, "no options beside a store", "they were decided when it was baked")
            return Store._open(path)
        if spacing is not None:
            from ._arrays import _triple

            spacing = list(_triple(spacing, "spacing"))
        chosen = None if channel is None else str(channel)
        inner = _isolume.Volume.open(
            path,
            spacing=spacing,
            unit=unit,
            channel=chosen,
            timepoint=timepoint,
            array=array,
            allow_outside=allow_outside,
            **reading,
        )
        return Volume._of(inner)
    if isinstance(source, (Volume, Store)):
        return source
    if not is_array(source):
        expected = "a path, an array of numbers, or an image of SimpleITK or nibabel"
        raise TypeError(f"source: given {type(source).__name__}, expected {expected}")
    found, held = placed(
        source,
        spacing=spacing,
        origin=origin,
        affine=affine,
        unit=unit,
        name=name,
        up=up,
        axes=axes,
        channel=channel,
        timepoint=timepoint,
    )
    if copy and held is not None:
        found.array, held = found.array.copy(), None
    reading["up"] = found.up
    inner = _isolume.Volume.from_array(
        found.array,
        found.array if held is None else held,
        found.affine[:3].tolist(),
        name=found.name,
        unit=found.unit,
        slope=found.slope,
        inter=found.inter,
        **reading,
    )
    return Volume._of(inner, warn=True)


def sync(first: Any, second: Any) -> Any:
    """Links the cameras of two widgets of `Store.view`, in the browser: what turns one turns the other. Returns the link, which
    ``unlink`` ends."""
    from ipywidgets import jslink

    return jslink((first, "camera"), (second, "camera"))


def _is_store(path: str) -> bool:
    return path.rstrip("/").endswith((".isolume", ".isolume.zip")) or (
        os.path.isdir(path) and os.path.isfile(os.path.join(path, "zarr.json"))
    )
