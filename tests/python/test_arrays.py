"""Arrays of every layout are the same volume, where they lie or copied."""

import gc
import warnings

import numpy as np
import pytest
from conftest import ENVIRONMENT, ISOVALUE, QUICK, phantom_of

import isolume


def layouts(a):
    """The same numbers, in every way that memory can hold them."""
    padded = np.zeros([2 * n for n in a.shape], a.dtype)
    padded[::2, ::2, ::2] = a
    read_only = a.copy()
    read_only.flags.writeable = False
    unaligned = np.frombuffer(b"\0" + a.tobytes(), np.uint8)[1:].view(a.dtype).reshape(a.shape)
    return {
        "C": a.copy(),
        "Fortran": np.asfortranarray(a),
        "transposed": np.ascontiguousarray(a.transpose(2, 0, 1)).transpose(1, 2, 0),
        "strided": padded[::2, ::2, ::2],
        "negative strides": np.ascontiguousarray(a[::-1, :, ::-1])[::-1, :, ::-1],
        "other byte order": a.astype(a.dtype.newbyteorder()),
        "read-only": read_only,
        "unaligned": unaligned,
        "float64": a.astype(np.float64),
        "a list": a.tolist(),
    }


def test_every_layout_gives_the_same_picture(tmp_path, phantom):
    expected = None
    for name, array in layouts(phantom).items():
        array = np.array(array) if isinstance(array, list) else array
        volume = isolume.open(array, spacing=(1, 1.5, 2))
        assert volume.shape == (14, 12, 10), name
        store = volume.bake(ISOVALUE, store=tmp_path / f"{name}.isolume", **QUICK)
        found = store.surface(ISOVALUE, ENVIRONMENT)
        got = [found.points, found.faces, found.radiance, found.picture(width=80, height=60, supersampling=1)]
        if expected is None:
            expected = got
        for a, b in zip(expected, got):
            np.testing.assert_array_equal(a, b, err_msg=name)
    # The largest ball is where it was put: x fastest, not mirrored.
    points = expected[0] / np.array([1, 1.5, 2])
    near = np.linalg.norm(points - [3, 4, 4], axis=1)
    assert np.isclose(near.min(), 2.6, atol=0.1)
    assert np.isclose(points[:, 2].max(), 10 + 1.4, atol=0.1) and np.isclose(points[:, 1].max(), 8.5 + 2.2, atol=0.1)
    assert np.isclose(points[:, 0].max(), 6.5 + 1.7, atol=0.1)


@pytest.mark.parametrize("dtype", ["f4", "u1", "i1", "u2", "i2", "?"])
def test_a_c_ordered_array_of_a_native_type_is_not_copied(dtype):
    array = (20 * phantom_of() > 10) if dtype == "?" else (20 * phantom_of() + 40).astype(dtype)
    volume = isolume.open(array)
    assert volume.address == array.__array_interface__["data"][0]
    assert volume.dtype == (np.uint8 if dtype == "?" else array.dtype)
    copied = isolume.open(array, copy=True)
    assert copied.address != array.__array_interface__["data"][0]


def test_the_axes_of_nibabel_are_read_where_they_are():
    array = np.asfortranarray(phantom_of().T)
    assert isolume.open(array, axes="xyz").address == array.__array_interface__["data"][0]


def test_an_array_that_is_read_is_read_only_until_nobody_reads_it(tmp_path):
    array = phantom_of()
    first, second = isolume.open(array), isolume.open(array)
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1
    store = second.bake(ISOVALUE, store=tmp_path / "a.isolume", **QUICK)
    del first, second
    gc.collect()
    assert not array.flags.writeable
    # A surface reads the samples, too: rays of pictures and of suns meet them.
    surface = store.surface(ISOVALUE)
    del store
    gc.collect()
    assert not array.flags.writeable
    del surface
    gc.collect()
    array[0] = 1
    fixed = phantom_of()
    fixed.flags.writeable = False
    isolume.open(fixed)
    gc.collect()
    assert not fixed.flags.writeable


@pytest.mark.parametrize("dtype", ["i4", "u4", "i8", "u8", "f8", "f2", "g", ">i2", ">f4", ">f8"])
def test_other_types_convert(dtype):
    whole = np.maximum(np.round(20 * phantom_of()), 0)
    array = whole.astype(dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        volume = isolume.open(array)
    assert volume.range == (float(array.min()), float(array.max()))
    points = volume.bake(10.5, store=None, **QUICK).surface(10.5).points
    expected = isolume.open(whole.astype("f4")).bake(10.5, **QUICK).surface(10.5).points
    np.testing.assert_allclose(points, expected, atol=1e-4)


def test_conversions_that_lose_something_warn(phantom):
    with pytest.warns(UserWarning, match="float64 samples were rounded"):
        isolume.open(phantom.astype("f8") / 3)
    with pytest.warns(UserWarning, match="stored as float32"):
        isolume.open((phantom * 1e6).astype("i4"))
    bad = phantom.copy()
    bad[0, 0, :3] = np.nan, np.inf, -np.inf
    with pytest.warns(UserWarning, match="3|NaN"):
        assert np.isfinite(isolume.open(bad).range).all()
    assert np.isnan(bad[0, 0, 0])


@pytest.mark.parametrize("dtype", ["c8", "O", "U3", "M8[s]"])
def test_what_is_no_number_is_a_type_error(dtype):
    with pytest.raises(TypeError):
        isolume.open(np.ones((3, 3, 3)).astype(dtype))
    with pytest.raises(TypeError):
        isolume.open(object())


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (dict(spacing=0), "spacing"),
        (dict(spacing=(1, 2)), "spacing"),
        (dict(spacing=(1, 1, np.nan)), "spacing"),
        (dict(origin=(1, 2)), "origin"),
        (dict(affine=np.zeros((4, 4))), "affine"),
        (dict(affine=np.eye(3)), "affine"),
        (dict(affine=np.eye(4), spacing=1), "affine"),
        (dict(unit="parsec"), "unit"),
        (dict(solid="left"), "solid"),
        (dict(up="w"), "up"),
        (dict(axes="zxy"), "axes"),
        (dict(channel=0), "channel"),
        (dict(timepoint=0), "timepoint"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(phantom, options, name):
    with pytest.raises(isolume.Error) as refused:
        isolume.open(phantom, **options)
    assert refused.value.name == name, refused.value
    assert refused.value.given and refused.value.expected and refused.value.remedy
    phantom[0] = 1


def test_shapes_that_are_no_volume(phantom):
    for shape in [(5,), (4, 4), (0, 3, 3)]:
        with pytest.raises(isolume.Error):
            isolume.open(np.zeros(shape, "f4"))
    with pytest.raises(isolume.Error, match="at least 2 samples"):
        isolume.open(np.arange(81, dtype="f4").reshape(1, 9, 9)).bake(40.5)
    # An affine with an array in Fortran order may mean either.
    with pytest.raises(isolume.Error, match="axes"):
        isolume.open(np.asfortranarray(phantom), affine=np.eye(4))


def test_channels_and_times(phantom):
    many = np.stack([phantom, phantom + 3])
    assert isolume.open(many, channel=1).range == isolume.open(phantom + 3).range
    assert isolume.open(many, timepoint=0).range == isolume.open(phantom).range
    assert isolume.open(np.stack([many, many + 9]), timepoint=1, channel=1).range == isolume.open(phantom + 12).range
    assert isolume.open(many[:1]).shape == phantom.shape
    with pytest.raises(isolume.Error, match="channel=0 to 1"):
        isolume.open(many)
    with pytest.raises(isolume.Error, match="0 to 1"):
        isolume.open(many, channel=2)


def test_an_affine_is_the_map_from_samples_to_world(phantom, tmp_path):
    turn = np.array([[0, -2.0, 0, 5], [1.5, 0, 0, -3], [0, 0.5, 3, 7], [0, 0, 0, 1]])
    plain = isolume.open(phantom).bake(ISOVALUE, store=tmp_path / "plain.isolume", **QUICK).surface(ISOVALUE)
    placed = isolume.open(phantom, affine=turn)
    np.testing.assert_array_equal(placed.affine, turn)
    turned = placed.bake(ISOVALUE, store=tmp_path / "turned.isolume", **QUICK).surface(ISOVALUE)
    expected = plain.points @ turn[:3, :3].T + turn[:3, 3]
    np.testing.assert_allclose(turned.points, expected, atol=1e-4)


def test_masked_arrays_need_a_fill(phantom):
    assert isolume.open(np.ma.masked_array(phantom)).shape == phantom.shape
    with pytest.raises(isolume.Error, match="mask"):
        isolume.open(np.ma.masked_less(phantom, 0))


def test_what_makes_arrays_is_taken(phantom):
    class Holder:
        def __array__(self, dtype=None, copy=None):
            return phantom

    assert isolume.open(Holder()).shape == phantom.shape
    assert isolume.open(np.matrix([[1.0, 2.0]]).A[None].repeat(2, 0).repeat(2, 1)).shape == (2, 2, 2)


def test_the_end_of_a_volume_keeps_the_exception_that_ended_it():
    array = np.random.default_rng(1).random((6, 6, 6), dtype=np.float32)
    with pytest.raises(TypeError, match="nonsense"):
        isolume.open(array).bake(nonsense=1)
    assert array.flags.writeable
