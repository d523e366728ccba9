"""The live page in a notebook."""

from __future__ import annotations

import base64
import json
import pathlib
from typing import Any

import numpy as np

try:
    import anywidget
    import traitlets
except ImportError as error:
    raise ImportError("the widget needs anywidget: pip install anywidget") from error

from . import _isolume
from ._environment import Environment, environment_of
from ._error import Error

#: Bytes of a piece of the data: a message of a notebook should not be larger.
PIECE = 8 << 20


class Widget(anywidget.AnyWidget):
    """The live page of a store, every isosurface relit interactively. `Store.view` makes it."""

    _esm = pathlib.Path(__file__).with_name("widget.mjs")

    isovalue = traitlets.Float(help="The isovalue that is shown.").tag(sync=True)
    env = traitlets.Union(
        [traitlets.Unicode(), traitlets.Any()], help="Name of the environment; may be set to what makes one."
    ).tag(sync=True)
    rotate = traitlets.Float(0.0, help="Degrees by which the light is turned.").tag(sync=True)
    albedo = traitlets.Float(0.7, help="Albedo, or with a colormap the factor on its colours.").tag(sync=True)
    colormap = traitlets.Unicode("", help="A colour scale over the isovalue; grey if empty.").tag(sync=True)
    exposure = traitlets.Float(None, allow_none=True, help="Stops; automatic if None.").tag(sync=True)
    camera = traitlets.Dict(help="azimuth, elevation, zoom, panX, panY, perspective.").tag(sync=True)

    _page = traitlets.Unicode().tag(sync=True)
    _header = traitlets.Unicode().tag(sync=True)
    _payload = traitlets.List(traitlets.Bytes()).tag(sync=True)
    _still = traitlets.Bytes().tag(sync=True)
    _height = traitlets.Int(560).tag(sync=True)

    @classmethod
    def _of(
        cls, store: Any, isovalue: Any, env: Any, texture_side: int, volume_side: int, height: int, state: dict
    ) -> Widget:
        from ._store import isovalue_text

        first = environment_of(env)
        header, payload = store._inner.page(isovalue_text(isovalue), [first._inner], texture_side, volume_side, False)
        shown = json.loads(header)["isovalue"]
        known = {"rotate", "albedo", "colormap", "exposure", "camera"}
        if unknown := state.keys() - known:
            raise TypeError(f"view: given {', '.join(sorted(unknown))}, expected {', '.join(sorted(known))}")
        state.setdefault("rotate", first.rotate)
        light = {name: state[name] for name in ("rotate", "albedo", "exposure") if name in state}
        still = store.surface(shown, env if first.rotate == 0 else Environment(first.image()), **light)
        made = cls(
            isovalue=shown,
            env=first.name,
            _page=_isolume.page(),
            _header=header,
            _payload=[payload[i : i + PIECE] for i in range(0, len(payload), PIECE)],
            _still=still._picture(width=640, height=480)[1],
            _height=height,
            **state,
        )
        made._names = {probe["name"] for probe in json.loads(header)["probes"]}
        made._last = None
        made.on_msg(made._heard)
        return made

    @traitlets.validate("env")
    def _validate_env(self, proposal: dict) -> str:
        """An environment that the page does not have yet is sent to it."""
        value = proposal["value"]
        names = getattr(self, "_names", None)
        if names is None or (isinstance(value, str) and value in names):
            return value
        found = environment_of(value)
        if found.name not in names:
            self._send_image("probe", found)
            names.add(found.name)
        return found.name

    def _send_image(self, kind: str, environment: Environment, **more: Any) -> None:
        image = np.ascontiguousarray(environment.image(), dtype="<f4")
        height, width, _ = image.shape
        self.send(dict(kind=kind, name=environment.name, width=width, height=height, **more), [image.tobytes()])

    def _heard(self, _: Any, content: dict, buffers: list) -> None:
        """Reads an image that was dropped onto the page and that it cannot read itself."""
        if content.get("kind") == "read":
            name, number = str(content.get("name", "image")), content.get("id")
            try:
                inner = _isolume.Environment.from_bytes(name, bytes(buffers[0]))
            except Error as error:
                self.send(dict(kind="answer", id=number, error=str(error)))
                return
            found = object.__new__(Environment)
            found._inner = inner
            self._send_image("answer", found, id=number)
        elif content.get("kind") == "added":
            self._names.add(content["name"])
        elif content.get("kind") == "failed":
            self._last = content.get("reason")

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Where widgets do not live, such as in an exported notebook, there is the still."""
        bundle = super()._repr_mimebundle_(**options)
        data = bundle[0] if isinstance(bundle, tuple) else bundle
        if data is not None:
            data["image/png"] = base64.b64encode(self._still).decode("ascii")
        return bundle
