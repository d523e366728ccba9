"""Lit surfaces, and what other packages make of them."""

from __future__ import annotations

import base64
import contextlib
import html
import json
import os
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._error import argument


@dataclass(frozen=True)
class StatedError:
    """How far the colours of a surface are from exact light transport, over the mean radiance: 0.02 is 2 %."""

    noise: float
    """Root mean square of the standard errors of the vertices."""
    median: float
    """Median over the vertices of their standard error over their own radiance."""
    rms: float | None
    """Root mean square of all errors, estimated from the check points of the bake; ``None`` where there are none."""
    p95: float | None
    """95 % of the errors are smaller than this."""
    truncation: float | None
    """What the light above the bands would bring."""
    check_points: int
    """From how many points it is estimated."""


class Surface:
    """An isosurface under an environment. `Store.surface` makes it.

    Arrays of one row a vertex; ``points``, ``normals`` and ``faces`` are shared by all surfaces of an isovalue and read-only.
    """

    def __init__(self) -> None:
        raise TypeError("surfaces are made by Store.surface(…)")

    @classmethod
    def _of(cls, inner: Any, store: Any) -> Surface:
        made = object.__new__(cls)
        made._inner, made._store, made._error = inner, store, None
        return made

    @property
    def points(self) -> np.ndarray:
        """World positions (x, y, z) in the frame and unit of the volume, float32 [n, 3]."""
        return self._inner.points

    @property
    def faces(self) -> np.ndarray:
        """Vertices of each triangle, counter-clockwise from the lit side, uint32 [m, 3]."""
        return self._inner.faces

    @property
    def normals(self) -> np.ndarray:
        """Unit normals that point to the lit side, float32 [n, 3]."""
        return self._inner.normals

    @property
    def radiance(self) -> np.ndarray:
        """Exitant radiance, linear Rec.709 in the unit of the environment, not exposed, float32 [n, 3]."""
        return self._inner.radiance

    @property
    def stderr(self) -> np.ndarray:
        """Standard error of the mean of the three channels, float32 [n]."""
        return self._inner.stderr

    @property
    def rgb(self) -> np.ndarray:
        """Exposed colours in sRGB, uint8 [n, 3]: what most tools want."""
        return self._inner.rgb

    @property
    def linear_rgb(self) -> np.ndarray:
        """Exposed linear colours in [0, 1], float32 [n, 3]: what glTF and renderers want."""
        return self._inner.linear_rgb

    @property
    def transfer(self) -> np.ndarray:
        """The transfer of each vertex, float32 [n, layers, bands²]; [n, layers, 3, bands²] of a scene. Coefficients of a layer with fewer
        bands than the first are followed by 0. Layer k is light that was reflected k times; coefficient l(l+1)+m."""
        return self._inner.transfer()

    @property
    def isovalue(self) -> float:
        """The isovalue, of the first volume."""
        return self._inner.isovalues[0]

    @property
    def isovalues(self) -> list[float]:
        """The isovalue of each volume."""
        return self._inner.isovalues

    @property
    def environment(self) -> str:
        """Name of the environment."""
        return self._inner.environment

    @property
    def exposure(self) -> float:
        """Stops from radiance to colour."""
        return self._inner.exposure

    @property
    def metres(self) -> float | None:
        """Metres to a unit of the points, if known."""
        return self._inner.metres

    @property
    def notes(self) -> list[str]:
        """What was done to the light."""
        return self._inner.notes()

    @property
    def record(self) -> dict[str, Any]:
        """How it was made: what files say of themselves."""
        return json.loads(self._inner.record())

    @property
    def error(self) -> StatedError:
        """How far the colours are from exact light transport."""
        if self._error is None:
            noise, median = self._inner.noise
            text = self._inner.total_error()
            total = {} if text is None else json.loads(text)
            cut = total.get("truncation")
            self._error = StatedError(
                noise,
                median,
                total.get("rms"),
                total.get("percentile_95"),
                None if cut is None else cut["rms"],
                total.get("check_points", 0),
            )
        return self._error

    def write(
        self,
        path: str | os.PathLike,
        *,
        radiance: bool = False,
        transfer: bool = False,
        float_colour: bool = False,
        scale: float | None = None,
        lod: int | str | None = None,
        for_web: bool = False,
        lightmap: int | None = None,
        **picture: Any,
    ) -> None:
        """Writes a file, whole or not at all: .glb, .ply, .stl or .usdz, or a picture as .png, which takes what `picture` takes.

        Parameters
        ----------
        radiance
            The true radiance and its standard error as attributes.
        transfer
            The transfer of each vertex, for relighting elsewhere; .glb alone.
        float_colour
            Colours as 32-bit floats; .glb alone.
        scale
            Metres to a unit of world; .glb and .usdz.
        lod
            How many triangles are left, 20000 or ``"25%"``, where shape and colours change least.
        for_web
            A small file for three.js and Babylon.js, which others refuse; .glb alone.
        lightmap
            Colours as a picture of so many texels a side; .glb, and .usdz, which has 2048 without it.
        """
        path = os.fspath(path)
        if path.lower().endswith(".png"):
            write_whole(path, self._picture(**picture)[1])
            return
        if picture:
            raise argument(next(iter(picture)), f"with {path}", "a name ending in .png", "leave it out of meshes")
        self._inner.write(
            path, radiance=radiance, transfer=transfer, float_colour=float_colour, scale=scale,
            lod=None if lod is None else str(lod), for_web=for_web, lightmap=lightmap,
        )

    def picture(self, **options: Any) -> np.ndarray:
        """A picture in sRGB, uint8 [height, width, 3], or 4 where the background lets through.

        Parameters
        ----------
        width, height
            Pixels; 960 × 720 by default.
        view
            ``"iso"`` (default), ``"front"``, ``"back"``, ``"left"``, ``"right"``, ``"top"`` or ``"bottom"``, or degrees
            (azimuth, elevation).
        perspective
            Vertical field of view in degrees; parallel rays by default.
        background
            sRGB numbers in [0, 1], three or four with alpha; ``"env"`` for the environment, ``"transparent"``.
        tone
            ``"none"``, ``"reinhard"`` or ``"filmic"``.
        supersampling
            Rays along each side of a pixel; 2 by default.
        scale_bar, cap
            A bar of a round length; whether the cut of the box through the solid is a face.

        >>> store.surface(47).picture(width=64, height=48).shape
        (48, 64, 3)
        """
        return self._picture(**options)[0]

    def _picture(
        self,
        *,
        width: int = 960,
        height: int = 720,
        view: Any = "iso",
        perspective: float | None = None,
        background: Any = (0x2C / 255, 0x30 / 255, 0x36 / 255),
        tone: str = "none",
        supersampling: int = 2,
        scale_bar: bool = False,
        cap: bool = True,
    ) -> tuple[np.ndarray, bytes]:
        if isinstance(view, str):
            place = (view, 0.0, 0.0)
        else:
            azimuth, elevation = view
            place = (None, float(azimuth), float(elevation))
        if isinstance(background, str):
            known = {"env": None, "transparent": [0.0, 0.0, 0.0, 0.0]}
            if background not in known:
                expected = "'env', 'transparent', or sRGB numbers in [0, 1]"
                raise argument("background", background, expected, "leave it out for dark grey")
            behind = known[background]
        else:
            behind = [float(v) for v in background]
            behind = behind + [1.0] * (4 - len(behind))
            if len(behind) != 4 or not all(0 <= v <= 1 for v in behind):
                raise argument("background", background, "three or four numbers in [0, 1]", "they are sRGB, and alpha")
        return self._inner.picture(width, height, place, perspective, supersampling, behind, tone, scale_bar, cap)

    def to_pyvista(self) -> Any:
        """A ``pyvista.PolyData`` with the point data ``RGB`` (sRGB, to be shown as it is), ``radiance`` and ``stderr``.

        Light is in the colours: show it by ``.plot(scalars="RGB", rgb=True, lighting=False)``.
        """
        import pyvista

        mesh = pyvista.PolyData(self.points.copy(), _polygons(self.faces))
        mesh.point_data["radiance"] = self.radiance
        mesh.point_data["stderr"] = self.stderr
        mesh.point_data["Normals"] = self.normals.copy()
        mesh.GetPointData().SetActiveNormals("Normals")
        mesh.point_data["RGB"] = self.rgb
        mesh.set_active_scalars("RGB")
        return mesh

    def to_vtk(self) -> Any:
        """A ``vtkPolyData`` with the colours as scalars ``RGB``. In its mapper, ``SetColorModeToDirectScalars`` is the default
        for these; switch lighting of the actor's property off."""
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

        points, cells, mesh = vtkPoints(), vtkCellArray(), vtkPolyData()
        points.SetData(numpy_to_vtk(self.points, deep=True))
        cells.SetCells(len(self.faces), numpy_to_vtkIdTypeArray(_polygons(self.faces), deep=True))
        mesh.SetPoints(points)
        mesh.SetPolys(cells)
        for name, array, put in (
            ("RGB", self.rgb, mesh.GetPointData().SetScalars),
            ("Normals", self.normals, mesh.GetPointData().SetNormals),
            ("radiance", self.radiance, mesh.GetPointData().AddArray),
            ("stderr", self.stderr, mesh.GetPointData().AddArray),
        ):
            column = numpy_to_vtk(np.ascontiguousarray(array), deep=True)
            column.SetName(name)
            put(column)
        return mesh

    def to_trimesh(self) -> Any:
        """A ``trimesh.Trimesh`` with the colours of its vertices in sRGB, none of which is merged."""
        import trimesh

        return trimesh.Trimesh(
            vertices=self.points,
            faces=self.faces.astype(np.int64),
            vertex_normals=self.normals,
            vertex_colors=self.rgb,
            process=False,
        )

    def to_napari(self) -> tuple[Any, dict[str, Any], str]:
        """A layer as napari takes it: ``napari.Viewer().add_layer(napari.layers.Layer.create(*surface.to_napari()))``. Axes are z, y, x;
        shading is off, since light is in the colours."""
        points = np.ascontiguousarray(self.points[:, ::-1])
        # Axes in reverse are a mirror: so are triangles.
        faces = np.ascontiguousarray(self.faces[:, ::-1]).astype(np.int64)
        colours = self.rgb.astype(np.float32) / 255
        meta = {
            "name": f"isovalue {self.isovalue:g}, {self.environment}",
            "vertex_colors": colours,
            "shading": "none",
            "metadata": {"isolume": self.record},
        }
        return (points, faces, np.ones(len(points), np.float32)), meta, "surface"

    def _repr_png_(self) -> bytes:
        return self._picture(width=640, height=480)[1]

    def _repr_html_(self) -> str:
        data = base64.b64encode(self._repr_png_()).decode("ascii")
        text = html.escape(repr(self)[1:-1])
        return f'<figure><img alt="{text}" src="data:image/png;base64,{data}"/><figcaption>{text}</figcaption></figure>'

    def __repr__(self) -> str:
        count = len(self.points)
        return f"<isolume.Surface isovalue {self.isovalue:g}, {self.environment}: {count:,} vertices>"


def write_whole(path: str, data: bytes) -> None:
    """Writes a file whole or not at all."""
    temporary = f"{path}.{os.getpid()}.part"
    try:
        with open(temporary, "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.remove(temporary)
        raise


def _polygons(faces: np.ndarray) -> np.ndarray:
    """Triangles as VTK has them: 3, and their vertices."""
    return np.column_stack([np.full(len(faces), 3, np.int64), faces.astype(np.int64)]).ravel()
