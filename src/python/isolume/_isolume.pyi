"""The part of the package that is compiled; what users call is in `isolume`."""

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Progress = Callable[[int, int, float | None], Any] | None

def main(line: Sequence[str]) -> int: ...
def version() -> str: ...
def page() -> str: ...
def built_in_environments() -> list[str]: ...
def colormaps() -> list[str]: ...

class Environment:
    @staticmethod
    def open(
        name: str, rotate: float = 0.0, keep_negative: bool = False, layout: str | None = None
    ) -> Environment: ...
    @staticmethod
    def from_array(name: str, image: NDArray[np.float32], rotate: float = 0.0) -> Environment: ...
    @staticmethod
    def from_bytes(name: str, bytes: bytes) -> Environment: ...
    @property
    def name(self) -> str: ...
    @property
    def rotate(self) -> float: ...
    def image(self) -> NDArray[np.float32]: ...

class Volume:
    @staticmethod
    def open(
        name: str,
        *,
        solid: str | None = None,
        up: str | None = None,
        spacing: Sequence[float] | None = None,
        unit: str | None = None,
        channel: str | None = None,
        timepoint: int | None = None,
        array: str | None = None,
        keep_largest: bool = False,
        allow_outside: bool = False,
    ) -> Volume: ...
    @staticmethod
    def from_array(
        array: NDArray[Any],
        frozen: NDArray[Any],
        affine: Sequence[Sequence[float]],
        *,
        name: str,
        unit: str | None = None,
        slope: float = 1.0,
        inter: float = 0.0,
        solid: str | None = None,
        up: str | None = None,
        keep_largest: bool = False,
    ) -> Volume: ...
    def bake(
        self,
        isovalues: Sequence[str] | None,
        *,
        error: float | None = None,
        time: float | None = None,
        rays: int | None = None,
        layers: int = 4,
        bands: int | None = None,
        texture: str | None = None,
        positive: bool = False,
        estimator_name: str = "path",
        lights: Sequence[Environment] = (),
        albedo: float = 0.7,
        store: str | os.PathLike[str] | None = None,
        cache: str | os.PathLike[str] | None = None,
        progress: _Progress = None,
        threads: int | None = None,
        seed: int = 0,
        memory_limit: int | None = None,
    ) -> Store: ...
    @property
    def dims(self) -> list[int]: ...
    @property
    def dtype(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def range(self) -> tuple[float, float]: ...
    @property
    def affine(self) -> list[list[float]]: ...
    @property
    def bounds(self) -> tuple[list[float], list[float]]: ...
    @property
    def metres(self) -> float | None: ...
    @property
    def up(self) -> str: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def address(self) -> int: ...
    def isovalue(self, text: str) -> tuple[float, str, str | None]: ...

class Store:
    @staticmethod
    def open(path: str | os.PathLike[str]) -> Store: ...
    @property
    def path(self) -> os.PathLike[str]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def reports(self) -> list[tuple[int, float]]: ...
    @property
    def volumes(self) -> list[str]: ...
    @property
    def bands(self) -> list[int]: ...
    @property
    def up(self) -> str: ...
    def holdings(self) -> tuple[list[float], bool]: ...
    def surface(
        self,
        isovalue: str,
        volume: str | None,
        env: Environment,
        rotate: float,
        albedo: Sequence[float],
        colormap: str | None,
        emission: Sequence[float],
        exposure: float | None,
        sun_split: str,
        window: str,
        luminaires: Sequence[tuple[str, Sequence[float]]],
        progress: _Progress,
    ) -> Surface: ...
    def page(
        self, isovalue: str, envs: Sequence[Environment], texture_side: int, volume_side: int, half: bool
    ) -> tuple[str, bytes]: ...
    def html(self, isovalue: str, envs: Sequence[Environment], texture_side: int, volume_side: int) -> str: ...
    def textures(
        self,
        env: Environment,
        rotate: float,
        albedo: Sequence[float],
        emission: Sequence[float],
        window: str,
        luminaires: Sequence[tuple[str, Sequence[float]]],
    ) -> dict[str, Any]: ...

class Surface:
    @property
    def points(self) -> NDArray[np.float32]: ...
    @property
    def normals(self) -> NDArray[np.float32]: ...
    @property
    def faces(self) -> NDArray[np.uint32]: ...
    @property
    def radiance(self) -> NDArray[np.float32]: ...
    @property
    def stderr(self) -> NDArray[np.float32]: ...
    @property
    def rgb(self) -> NDArray[np.uint8]: ...
    @property
    def linear_rgb(self) -> NDArray[np.float32]: ...
    @property
    def isovalues(self) -> list[float]: ...
    @property
    def environment(self) -> str: ...
    @property
    def exposure(self) -> float: ...
    @property
    def metres(self) -> float | None: ...
    @property
    def axes(self) -> tuple[list[float], list[float]]: ...
    @property
    def noise(self) -> tuple[float, float]: ...
    def total_error(self) -> str | None: ...
    def record(self) -> str: ...
    def notes(self) -> list[str]: ...
    def transfer(self) -> NDArray[np.float32]: ...
    def write(
        self,
        path: str | os.PathLike[str],
        *,
        radiance: bool = False,
        transfer: bool = False,
        float_colour: bool = False,
        scale: float | None = None,
        lod: str | None = None,
        for_web: bool = False,
        lightmap: int | None = None,
    ) -> None: ...
    def picture(
        self,
        width: int,
        height: int,
        view: tuple[str | None, float, float],
        perspective: float | None,
        supersampling: int,
        background: Sequence[float] | None,
        tone: str,
        scale_bar: bool,
        cap: bool,
    ) -> tuple[NDArray[np.uint8], bytes]: ...
