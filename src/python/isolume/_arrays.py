"""Arrays of others as volumes: what NumPy, xarray, dask, SimpleITK and nibabel hold, with the place that they give it.

Everything ends as a C-contiguous array [z, y, x] in native byte order and a matrix from (x, y, z) in samples to world. An
array that is so already is not copied.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ._error import argument

#: Names of the axes of labelled arrays, in lower case.
_SPACE = {"x": 0, "y": 1, "z": 2}
_OTHERS = {"c": "channel", "channel": "channel", "band": "channel", "t": "timepoint", "time": "timepoint"}


@dataclass
class Placed:
    """An array with its place."""

    array: np.ndarray
    """[z, y, x]."""
    affine: np.ndarray = field(default_factory=lambda: np.eye(4))
    """4 × 4, from (x, y, z) in samples to world."""
    name: str = "array"
    unit: str | None = None
    up: str | None = None
    slope: float = 1.0
    inter: float = 0.0


def _is(source: Any, module: str, name: str) -> bool:
    """Whether an object is of a class of a package that may not be installed."""
    return any(c.__name__ == name and c.__module__.split(".")[0] == module for c in type(source).__mro__)


def is_array(source: Any) -> bool:
    """Whether something is an array, or an image that holds one."""
    return (
        isinstance(source, np.ndarray)
        or hasattr(source, "__array__")
        or hasattr(source, "__array_interface__")
        or (hasattr(source, "dataobj") and hasattr(source, "affine"))
        or _is(source, "SimpleITK", "Image")
    )


def placed(
    source: Any,
    *,
    spacing: Any = None,
    origin: Any = None,
    affine: Any = None,
    unit: str | None = None,
    name: str | None = None,
    up: str | None = None,
    axes: str | None = None,
    channel: int | str | None = None,
    timepoint: int | None = None,
) -> tuple[Placed, np.ndarray | None]:
    """The array of a source with its place, and the array of the user's that it shares memory with, if it does."""
    if hasattr(source, "dataobj") and hasattr(source, "affine"):
        found = _of_nibabel(source, channel, timepoint)
    elif _is(source, "SimpleITK", "Image"):
        found = _of_simpleitk(source, channel)
    elif _is(source, "xarray", "DataArray"):
        found = _of_xarray(source, channel, timepoint)
    else:
        found = _of_array(source, axes, affine, channel, timepoint)
    if affine is not None and (spacing is not None or origin is not None):
        raise argument("affine", "with spacing or origin", "one of the two", "an affine says where samples are by itself")
    if affine is not None:
        found.affine = _matrix(affine)
    if spacing is not None:
        steps = np.linalg.norm(found.affine[:3, :3], axis=0)
        found.affine[:3, :3] *= _triple(spacing, "spacing") / np.where(steps > 0, steps, 1)
    if origin is not None:
        found.affine[:3, 3] = _triple(origin, "origin")
    found.unit = unit if unit is not None else found.unit
    found.name = name if name is not None else found.name
    found.up = up if up is not None else found.up
    given, found.array = found.array, _native(found.array)
    if not np.may_share_memory(found.array, given):
        return found, None
    # What the user holds is what must not be written to, and not a view that was made here.
    held = getattr(source, "data", source) if _is(source, "xarray", "DataArray") else source
    return found, (held if isinstance(held, np.ndarray) else given)


def _native(array: np.ndarray) -> np.ndarray:
    """The same numbers in a type that volumes hold, C-contiguous and in native byte order; copied only where they must be."""
    if array.ndim != 3:
        expected = "3 axes: [z, y, x]"
        raise argument("array", f"{array.ndim} axes, {array.shape}", expected, "pick one volume of it by its index")
    if 0 in array.shape:
        raise argument("array", f"the shape {array.shape}", "at least one sample along each axis", "check the slice")
    kind, size = array.dtype.kind, array.dtype.itemsize
    if kind not in "biuf":
        raise TypeError(f"array: given numbers of type {array.dtype}, expected integers or real floating-point numbers")
    if kind == "b":
        array = array.view(np.uint8)
    elif kind == "f" and size == 2:
        array = array.astype(np.float32)
    elif kind == "f" and size > 8:
        warnings.warn(f"array: {array.dtype} numbers were rounded to float64", stacklevel=4)
        array = array.astype(np.float64)
    # asarray, and not ascontiguousarray of subclasses: masked arrays and matrices are dealt with before.
    return np.require(array, dtype=array.dtype.newbyteorder("="), requirements=["C", "A"])


def _triple(value: Any, name: str) -> np.ndarray:
    found = np.asarray(value, dtype=np.float64)
    if found.ndim == 0:
        found = np.full(3, float(found))
    if found.shape != (3,) or not np.all(np.isfinite(found)) or (name == "spacing" and not np.all(found > 0)):
        expected = "one positive number, or three: x, y, z" if name == "spacing" else "three numbers: x, y, z"
        raise argument(name, value, expected, "they are in the order x, y, z, unlike the axes of the array")
    return found


def _matrix(value: Any) -> np.ndarray:
    found = np.asarray(value, dtype=np.float64)
    if found.shape == (3, 4):
        found = np.vstack([found, [0, 0, 0, 1]])
    if found.shape != (4, 4) or not np.all(np.isfinite(found)) or not np.allclose(found[3], [0, 0, 0, 1]):
        expected = "a finite matrix of 4 × 4 (or 3 × 4) from (x, y, z) in samples to world"
        raise argument("affine", f"the shape {found.shape}", expected, "its last row is 0, 0, 0, 1")
    return found.copy()


def _index(array: np.ndarray, axis: int, value: Any, name: str) -> np.ndarray:
    count = array.shape[axis]
    if value is None:
        if count != 1:
            remedy = f"choose one with {name}=0 to {count - 1}"
            raise argument(name, f"{count} of them", "one volume", remedy)
        value = 0
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 <= value < count:
        raise argument(name, value, f"0 to {count - 1}", "they are counted from 0")
    return array[(slice(None),) * axis + (int(value),)]


def _of_array(source: Any, axes: str | None, affine: Any, channel: Any, timepoint: Any) -> Placed:
    array = source if isinstance(source, np.ndarray) else _dense(source)
    if isinstance(array, np.ma.MaskedArray):
        if np.ma.is_masked(array):
            remedy = "fill it: array.filled(value of the empty side)"
            raise argument("array", "masked samples", "an array without a mask", remedy)
        array = array.data
    array = np.asarray(array)
    if axes not in (None, "zyx", "xyz"):
        raise argument("axes", axes, "'zyx' or 'xyz'", "the order of the axes of the array")
    if axes is None and affine is not None and array.ndim == 3 and array.flags.f_contiguous and not array.flags.c_contiguous:
        expected = "axes='zyx' or axes='xyz' beside it"
        remedy = "arrays in Fortran order with an affine mostly come from NIfTI, and are xyz"
        raise argument("affine", "with an array in Fortran order", expected, remedy)
    # The fastest of more than three axes stand in front: [t, c, z, y, x].
    extra = array.ndim - 3
    if extra == 1:
        if channel is not None and timepoint is not None:
            raise argument("channel", "with timepoint, of four axes", "one of the two", "the first axis is the one given")
        name = "timepoint" if timepoint is not None else "channel"
        array = _index(array, 0, timepoint if timepoint is not None else channel, name)
    elif extra == 2:
        array = _index(_index(array, 0, timepoint, "timepoint"), 0, channel, "channel")
    elif channel is not None or timepoint is not None:
        name = "channel" if channel is not None else "timepoint"
        raise argument(name, f"with {array.ndim} axes", "four axes [c or t, z, y, x], or five", "leave it out")
    return Placed(array.T if axes == "xyz" else array)


def _dense(source: Any) -> np.ndarray:
    """The numbers of something that makes arrays; of dask plane by plane of chunks, straight into one."""
    chunks = getattr(source, "chunks", None)
    if _is(source, "dask", "Array") and chunks is not None:
        out = np.empty(source.shape, source.dtype)
        first = 0
        for size in chunks[0]:
            out[first : first + size] = np.asarray(source[first : first + size])
            first += size
        return out
    return np.asarray(source)


def _of_nibabel(image: Any, channel: Any, timepoint: Any) -> Placed:
    """Samples as they are stored, and the scaling apart, as the reader of files does."""
    proxy, header = image.dataobj, getattr(image, "header", None)
    slope, inter = 1.0, 0.0
    if hasattr(proxy, "get_unscaled"):
        array = np.asanyarray(proxy.get_unscaled())
        slope, inter = float(np.ravel(proxy.slope)[0]), float(np.ravel(proxy.inter)[0])
    else:
        array = np.asanyarray(proxy)
    while array.ndim > 3 and array.shape[-1] == 1:
        array = array[..., 0]
    if array.ndim == 4:
        array = _index(array, 3, timepoint if timepoint is not None else channel, "timepoint")
    affine = np.eye(4) if image.affine is None else _matrix(image.affine)
    unit = up = None
    if header is not None and hasattr(header, "get_xyzt_units"):
        unit = {"mm": "mm", "meter": "m", "micron": "um"}.get(header.get_xyzt_units()[0])
        codes = (int(header["qform_code"]), int(header["sform_code"])) if "sform_code" in header else (1, 1)
        up = "anatomical" if any(codes) else None
    return Placed(array.T, affine, unit=unit, up=up, slope=slope, inter=inter)


def _of_simpleitk(image: Any, channel: Any) -> Placed:
    """ITK's physical space is LPS+: x and y change sign to RAS+, as the readers of MetaImage and NRRD do it."""
    import SimpleITK as sitk

    if image.GetDimension() != 3:
        raise argument("image", f"{image.GetDimension()} dimensions", "3", "extract one volume: sitk.Extract")
    if image.GetNumberOfComponentsPerPixel() > 1:
        array = _index(sitk.GetArrayFromImage(image), 3, channel, "channel")
    else:
        array = sitk.GetArrayFromImage(image)
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * np.asarray(image.GetSpacing())
    affine[:3, 3] = image.GetOrigin()
    return Placed(array, np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine, unit="mm", up="anatomical")


def _of_xarray(source: Any, channel: Any, timepoint: Any) -> Placed:
    """Names of the dimensions decide, and coordinates give spacing and origin."""
    for dim in list(source.dims):
        kind = _OTHERS.get(str(dim).lower())
        if kind is None:
            continue
        value = channel if kind == "channel" else timepoint
        if value is None and source.sizes[dim] != 1:
            count = source.sizes[dim]
            raise argument(kind, f"{count} along {dim}", "one volume", f"choose one with {kind}=0 to {count - 1}")
        by_name = isinstance(value, str) and dim in source.coords
        source = source.sel({dim: value}) if by_name else source.isel({dim: 0 if value is None else value})
    names = {str(dim).lower(): dim for dim in source.dims}
    if len(source.dims) == 3 and set(names) != set(_SPACE):
        ordered = list(source.dims)
        if set(names) & set(_SPACE):
            remedy = "rename them: array.rename({…: 'z'}), or give array.values with spacing="
            raise argument("dims", ", ".join(map(str, ordered)), "x, y and z in any order", remedy)
    elif len(source.dims) == 3:
        ordered = [names[axis] for axis in "zyx"]
        source = source.transpose(*ordered)
    else:
        found = ", ".join(map(str, source.dims))
        raise argument("dims", found, "x, y and z, with perhaps c and t", "pick one volume of it: array.isel(…)")
    affine = np.eye(4)
    units = set()
    for axis, dim in zip((2, 1, 0), ordered):
        if dim not in source.coords:
            continue
        place = np.asarray(source.coords[dim].values, dtype=np.float64)
        affine[axis, 3] = place[0]
        if len(place) > 1:
            step = (place[-1] - place[0]) / (len(place) - 1)
            if step == 0 or np.abs(np.diff(place) - step).max() > 1e-3 * abs(step):
                remedy = f"resample it: array.interp({dim}=numpy.linspace(…))"
                raise argument(f"coordinates of {dim}", "unequal steps", "equal steps", remedy)
            affine[axis, axis] = step
        units.add(source.coords[dim].attrs.get("units"))
    unit = units.pop() if len(units) == 1 else None
    unit = _unit(unit) or _unit(source.attrs.get("spatial_units"))
    data = source.data
    array = data if isinstance(data, np.ndarray) else _dense(data)
    return Placed(np.asarray(array), affine, name=str(source.name or "array"), unit=unit)


def _unit(unit: Any) -> str | None:
    """The name that the library knows for a unit of length, if it is one."""
    names = {"millimeter": "mm", "micrometer": "um", "nanometer": "nm", "meter": "m", "angstrom": "A", "centimeter": "cm"}
    known = {"m", "cm", "mm", "um", "µm", "nm", "pm", "A", "Å", "bohr", "in", "km"}
    text = str(unit).strip() if unit is not None else ""
    text = names.get(text.rstrip("s").lower(), text)
    return text if text in known else None
