"""The widget without a browser: its traits, what is sent, and what is there where widgets are not."""

import base64
import json
import re

import numpy as np
import pytest
from conftest import ISOVALUE, QUICK, phantom_of

import isolume

pytest.importorskip("anywidget")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return isolume.open(phantom_of()).bake(store=tmp_path_factory.mktemp("whole") / "all.isolume", **QUICK)


@pytest.fixture
def widget(whole):
    return whole.view(ISOVALUE, "courtyard", rotate=20)


def sent(widget, act):
    """What a widget sends to the browser while something is done."""
    messages = []
    widget.send = lambda content, buffers=None: messages.append((content, buffers))
    act()
    return messages


def test_it_has_the_page_and_its_data(widget):
    header = json.loads(widget._header)
    assert widget.isovalue == pytest.approx(ISOVALUE) and widget.env == "courtyard" and widget.rotate == 20
    assert header["probes"][0]["name"] == "courtyard"
    assert sum(map(len, widget._payload)) >= max(offset + length for offset, length in header["sections"].values())
    assert "isolume-widget" in widget._page and "<!--DATA-->" not in widget._page.split("<script", 1)[0]
    assert "export default" in str(widget._esm)


def test_an_environment_of_ones_own_is_sent_once(widget):
    image = np.zeros((8, 16, 3), "f4")
    image[2, 3] = 7
    own = isolume.Environment(image, name="mine")
    messages = sent(widget, lambda: setattr(widget, "env", own))
    (content, buffers), = messages
    assert widget.env == "mine" and (content["kind"], content["width"], content["height"]) == ("probe", 16, 8)
    np.testing.assert_array_equal(np.frombuffer(buffers[0], "f4").reshape(8, 16, 3), image)
    assert sent(widget, lambda: setattr(widget, "env", "sunset")) == []
    assert sent(widget, lambda: setattr(widget, "env", "mine")) == []
    with pytest.raises(isolume.Error, match="environment"):
        widget.env = "no-such-light"
    assert widget.env == "mine"


def test_images_that_a_page_cannot_read_are_read_here(widget):
    # Flat Radiance: each pixel 2, 1, 0.5.
    data = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([128, 64, 32, 130]) * 32
    ask = lambda name, bytes: widget._heard(widget, dict(kind="read", id=5, name=name), [memoryview(bytes)])
    (content, buffers), = sent(widget, lambda: ask("a.hdr", data))
    assert content["kind"] == "answer" and content["id"] == 5 and content["width"] == 8
    assert np.frombuffer(buffers[0], "f4").reshape(-1, 3).mean(axis=0) == pytest.approx([2, 1, 0.5], rel=0.02)
    (content, buffers), = sent(widget, lambda: ask("b.exr", b"\x76\x2f\x31\x01 and no more"))
    assert "b.exr" in content["error"] and buffers is None


def test_where_widgets_do_not_live_there_is_a_still(widget):
    bundle = widget._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert base64.b64decode(data["image/png"])[:4] == b"\x89PNG"


def test_the_mailed_page(whole, tmp_path):
    whole.html(tmp_path / "a.html", env="sky")
    text = (tmp_path / "a.html").read_text()
    header = json.loads(re.search(r'id="header">(.*?)</script>', text)[1])
    assert header["probes"][0]["name"] == "sky" and len(text) > 10_000
    with pytest.raises(isolume.Error, match="texture_side"):
        whole.html(tmp_path / "b.html", texture_side=1)
    assert not (tmp_path / "b.html").exists()


def test_what_no_widget_can_show(tmp_path, whole):
    store = isolume.open(phantom_of()).bake(ISOVALUE, store=tmp_path / "one.isolume", **QUICK)
    with pytest.raises(isolume.Error, match="texture"):
        store.view()
    with pytest.raises(TypeError, match="colour"):
        whole.view(ISOVALUE, colour="red")


def test_cameras_are_linked(whole):
    pytest.importorskip("ipywidgets")
    first, second = whole.view(ISOVALUE), whole.view(ISOVALUE)
    link = isolume.sync(first, second)
    assert link.source == (first, "camera") and link.target == (second, "camera")
