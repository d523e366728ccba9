"""Surfaces as arrays: shapes, frames, light, and files."""

import json
import re

import numpy as np
import pytest
from conftest import ENVIRONMENT, ISOVALUE, QUICK, phantom_of

import isolume


def srgb(linear):
    """IEC 61966-2-1."""
    linear = np.asarray(linear, np.float64)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def test_arrays_fit_together(surface):
    n, m = len(surface.points), len(surface.faces)
    assert n > 200 and m > 400
    shapes = {"points": (n, 3), "normals": (n, 3), "radiance": (n, 3), "rgb": (n, 3), "stderr": (n,), "faces": (m, 3)}
    types = {"points": "f4", "normals": "f4", "radiance": "f4", "rgb": "u1", "stderr": "f4", "faces": "u4"}
    for name, shape in shapes.items():
        array = getattr(surface, name)
        assert array.shape == shape and array.dtype == types[name] and array.flags.c_contiguous, name
    assert surface.faces.max() == n - 1
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-5)
    assert surface.points is surface.points and not surface.points.flags.writeable
    assert (surface.stderr > 0).any() and np.isfinite(surface.radiance).all()


def test_faces_turn_counter_clockwise_from_the_lit_side_whatever_the_grid_is(phantom, tmp_path):
    mirror = np.diag([-1.0, 1, 1, 1])
    for name, affine in (("right", np.eye(4)), ("left", mirror)):
        store = isolume.open(phantom, affine=affine).bake(ISOVALUE, store=tmp_path / f"{name}.isolume", **QUICK)
        surface = store.surface(ISOVALUE)
        a, b, c = (surface.points[surface.faces[:, k]].astype("f8") for k in range(3))
        facets = np.cross(b - a, c - a)
        normals = surface.normals[surface.faces].mean(axis=1)
        large = np.linalg.norm(facets, axis=1) > 1e-3
        assert ((facets * normals).sum(axis=1)[large] > 0).mean() > 0.99, name


def test_points_are_where_the_samples_are(surface):
    # The isosurface of {h = 0.5} of the balls is at their radii, within the error of linear interpolation.
    grid = (surface.points - [10, 20, 30]) / [1, 1.5, 2]
    balls = [((3, 4, 4), 2.6), ((6.5, 4, 4.2), 1.7), ((3.1, 8.5, 4), 2.2), ((3, 4, 10), 1.4)]
    inside = np.max([r - np.linalg.norm(grid - at, axis=1) for at, r in balls], axis=0)
    assert np.abs(inside).max() < 0.25
    assert surface.metres == 1e-3


def test_colours_are_exposed_radiance_in_srgb(store):
    surface = store.surface(ISOVALUE, "sky", exposure=-1)
    assert surface.exposure == pytest.approx(-1)
    radiance = surface.radiance
    lit = (radiance >= 0).all(axis=1)
    np.testing.assert_allclose(surface.linear_rgb[lit], np.clip(radiance[lit] / 2, 0, 1), atol=1e-6)
    assert np.abs(surface.rgb.astype(int) - np.round(255 * srgb(surface.linear_rgb))).max() <= 1
    automatic = store.surface(ISOVALUE, "sky")
    brightest = automatic.linear_rgb.max(axis=1)
    assert np.quantile(brightest, 0.99) == pytest.approx(1, abs=0.02)


def test_light_is_linear_and_turns(store):
    image = np.zeros((16, 32, 3), "f4")
    image[3:6, 4:9] = [5, 3, 1]
    other = np.ones((16, 32, 3), "f4")
    one = store.surface(ISOVALUE, isolume.Environment(image)).radiance
    two = store.surface(ISOVALUE, other).radiance
    both = store.surface(ISOVALUE, image + other).radiance
    np.testing.assert_allclose(one + two, both, atol=2e-5 * np.abs(both).max())
    # A turn by whole pixels is a roll of the image: the u of an image falls as the light turns counter-clockwise.
    turned = store.surface(ISOVALUE, image, rotate=90).radiance
    again = store.surface(ISOVALUE, isolume.Environment(image, rotate=45), rotate=45).radiance
    np.testing.assert_allclose(turned, again, atol=1e-5)
    rolled = store.surface(ISOVALUE, np.roll(image, -8, axis=1)).radiance
    np.testing.assert_allclose(turned, rolled, atol=1e-4 * np.abs(one).max())


def test_transfer_is_what_light_is_multiplied_with(store):
    # Under the same light from everywhere only the first coefficient counts: L_00 = sqrt(4 pi), and radiance is the sum over layers
    # of albedo^(k+1) T_k00 L_00 and the tail.
    surface = store.surface(ISOVALUE, "constant", albedo=0.5)
    transfer = surface.transfer
    assert transfer.shape == (len(surface.points), 2, 9)
    a = np.sqrt(4 * np.pi) * transfer[..., 0]
    escaping = np.maximum(1 - a.sum(axis=1), 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        x = 0.5 * np.nan_to_num(np.minimum(a[:, 1] / a[:, 0], escaping / (escaping + a[:, 1])))
    expected = 0.5 * a[:, 0] + 0.25 * a[:, 1] * (1 + x / (1 - x))
    np.testing.assert_allclose(surface.radiance[:, 1], expected, rtol=5e-3, atol=1e-4)


def test_materials(store):
    grey = store.surface(ISOVALUE, "sky", albedo=0.4)
    red = store.surface(ISOVALUE, "sky", albedo=(0.4, 0.2, 0))
    np.testing.assert_array_equal(grey.radiance[:, 0], red.radiance[:, 0])
    assert (red.radiance[:, 2] == 0).all()
    glowing = store.surface(ISOVALUE, "constant:0", emission=(1, 0, 0))
    assert (glowing.radiance[:, 0] >= 1).all() and (glowing.radiance[:, 1:] == 0).all()
    low, high = (store.surface(ISOVALUE, "sky", colormap=f"viridis:{r}").radiance.mean(axis=0) for r in ("0..9", "-9..0.5"))
    assert low[2] > low[1] and high[1] > high[2]
    for options, name in [
        (dict(albedo=2), "albedo"),
        (dict(albedo=(1, 2)), "albedo"),
        (dict(emission=-1), "emission"),
        (dict(colormap="virids"), "colormap"),
        (dict(window="none of these"), "window"),
        (dict(exposure=1e9), "exposure"),
        (dict(rotate=float("nan")), "rotate"),
        (dict(env="sunst"), "environment"),
    ]:
        with pytest.raises(isolume.Error) as refused:
            store.surface(**(dict(isovalue=ISOVALUE, env="sky") | options))
        assert name in refused.value.name, (options, refused.value)
    for image in [np.ones((4, 8)), np.ones((4, 8, 4)), np.ones((4, 8, 3), "u1"), np.full((4, 8, 3), np.nan)]:
        with pytest.raises(isolume.Error):
            isolume.Environment(image)


def test_suns_are_lit_apart_where_asked_for(store):
    soft = store.surface(ISOVALUE, "sun:30,50")
    sharp = store.surface(ISOVALUE, "sun:30,50", sun_split=True)
    assert not soft.notes or "apart" not in soft.notes[0]
    assert sharp.notes
    assert np.abs(soft.radiance - sharp.radiance).max() > 0.05 * soft.radiance.max()


def test_a_store_has_textures_where_it_was_baked_so(tmp_path, phantom, store):
    whole = isolume.open(phantom).bake(store=tmp_path / "all.isolume", **QUICK)
    assert whole.isovalues is None
    found = whole.textures("constant", albedo=1)
    assert found.radiance.shape == (14, 12, 10, 3) and found.valid.shape == found.value.shape == (14, 12, 10)
    np.testing.assert_allclose(found.value, phantom, atol=1e-5)
    np.testing.assert_array_equal(found.affine, np.eye(4))
    # A white furnace: albedo 1 under radiance 1 from everywhere is 1, but for noise and cut layers.
    lit = found.radiance[found.valid == 1]
    assert abs(lit.mean() - 1) < 0.05
    # A surface of it is looked up in the texture.
    assert abs(whole.surface(0.7, "constant", albedo=1).radiance.mean() - 1) < 0.05
    with pytest.raises(isolume.Error, match="texture"):
        store.textures("sky")


def test_files(surface, tmp_path):
    for name in ("a.glb", "a.ply", "a.stl", "a.png"):
        surface.write(tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000
    surface.write(tmp_path / "b.glb", radiance=True, transfer=True, float_colour=True, scale=0.01)
    data = (tmp_path / "b.glb").read_bytes()
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    attributes = header["meshes"][0]["primitives"][0]["attributes"]
    assert {"_RADIANCE", "_STDERR", "_T1_SH_DEGREE_0_COEF_0"} <= attributes.keys()
    assert (tmp_path / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    surface.write(tmp_path / "c.glb", for_web=True, lod="50%")
    # Most of a file of 13 kB is its header.
    assert (tmp_path / "c.glb").stat().st_size < (tmp_path / "a.glb").stat().st_size / 2
    surface.write(tmp_path / "c.usdz", lod=200, lightmap=128)
    assert (tmp_path / "c.usdz").read_bytes()[:2] == b"PK"
    with pytest.raises(isolume.Error, match="25%"):
        surface.write(tmp_path / "d.glb", lod="many")
    with pytest.raises(isolume.Error, match=r"\.glb"):
        surface.write(tmp_path / "a.obj")
    with pytest.raises(isolume.Error, match="width"):
        surface.write(tmp_path / "a.ply", width=3)
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_file()) == ["a.glb", "a.ply", "a.png", "a.stl", "b.glb", "c.glb", "c.usdz"]


def test_pictures(surface):
    picture = surface.picture(width=90, height=60, view="front", background=(0, 0, 0))
    assert picture.shape == (60, 90, 3) and picture.dtype == np.uint8
    assert picture[0, 0].tolist() == [0, 0, 0] and picture.max() > 100
    clear = surface.picture(width=90, height=60, view=(20, 30), background="transparent")
    assert clear.shape == (60, 90, 4) and clear[0, 0, 3] == 0 and clear[..., 3].max() == 255
    assert surface.picture(width=30, height=20, background="env", perspective=40, tone="filmic").std() > 1
    for wrong in (dict(view="under"), dict(tone="loud"), dict(background=(2, 0, 0)), dict(background="sky"), dict(width=0)):
        with pytest.raises(isolume.Error):
            surface.picture(**wrong)


def test_notebooks_get_a_still(surface):
    assert surface._repr_png_()[:4] == b"\x89PNG"
    assert re.search(r'<img alt="isolume.Surface[^"]*" src="data:image/png;base64,[A-Za-z0-9+/=]+"/>', surface._repr_html_())


def test_records_say_how_it_was_made(surface, store):
    assert surface.record["environment"] == ENVIRONMENT and surface.record["volume"] == "balls"
    assert store.bands == [3, 3] and store.volumes == ["balls"] and repr(store).startswith("<isolume.Store ")
    zarr = pytest.importorskip("zarr")
    assert isinstance(store.zarr, zarr.Group) and "transfer" in store.zarr
