"""Writes what the widget of a store holds, for tests/browser/widget.mjs.

python widget_data.py FOLDER
"""

import json
import pathlib
import sys

import isolume

folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
store = isolume.open("bumpbox:24").bake(rays=16, layers=2, bands=3, store=folder / "bumps.isolume")
widget = store.view(47, "courtyard", rotate=20)
traits = {name: getattr(widget, name) for name in ("isovalue", "env", "rotate", "albedo", "colormap", "exposure", "camera")}
traits |= {"_page": widget._page, "_header": widget._header, "_height": 260}
(folder / "traits.json").write_text(json.dumps(traits))
(folder / "payload.bin").write_bytes(b"".join(widget._payload))
(folder / "still.png").write_bytes(widget._still)
