"""What other packages hand in and take back: places, units, and the colours that their pictures show."""

import numpy as np
import pytest
from conftest import ENVIRONMENT, ISOVALUE, QUICK, phantom_of

import isolume


def same_points(volume, tmp_path, name):
    return volume.bake(ISOVALUE, store=tmp_path / f"{name}.isolume", **QUICK).surface(ISOVALUE).points


def test_xarray_by_names_of_dimensions_and_coordinates(phantom, tmp_path):
    xr = pytest.importorskip("xarray")
    x = xr.Variable("x", 5 + 0.5 * np.arange(10), attrs={"units": "mm"})
    y = xr.Variable("y", 7 - 1.5 * np.arange(12), attrs={"units": "millimeter"})
    z = xr.Variable("z", 2.0 * np.arange(14), attrs={"units": "mm"})
    array = xr.DataArray(phantom, dims=("z", "y", "x"), coords=dict(x=x, y=y, z=z), name="density")
    volume = isolume.open(array)
    assert volume.address == phantom.__array_interface__["data"][0] and not phantom.flags.writeable
    assert volume.name == "density" and volume.metres == pytest.approx(1e-3) or volume.metres is None
    expected = np.array([[0.5, 0, 0, 5], [0, -1.5, 0, 7], [0, 0, 2, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(volume.affine, expected)
    other = isolume.open(array.transpose("x", "z", "y"))
    np.testing.assert_array_equal(same_points(volume, tmp_path, "a"), same_points(other, tmp_path, "b"))
    many = xr.concat([array, array + 1], "time").assign_coords(time=[10, 20])
    assert isolume.open(many, timepoint=1).range == isolume.open(array.values + 1).range
    with pytest.raises(isolume.Error, match="timepoint=0 to 1"):
        isolume.open(many)
    with pytest.raises(isolume.Error, match="unequal"):
        isolume.open(array.assign_coords(x=np.arange(10.0) ** 2))
    with pytest.raises(isolume.Error, match="dims"):
        isolume.open(array.isel(z=0))
    with pytest.raises(isolume.Error, match="dims"):
        isolume.open(array.rename(z="depth"))


def test_dask_in_slabs(phantom):
    da = pytest.importorskip("dask.array")
    array = da.from_array(phantom, chunks=(4, 5, 6))
    volume = isolume.open(array)
    assert volume.shape == phantom.shape and volume.range == isolume.open(phantom).range
    assert isolume.open(array.astype("f8")).dtype == np.float32


def test_simpleitk_has_the_place_that_its_file_has(phantom, tmp_path):
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(phantom)
    image.SetSpacing((0.5, 1.5, 2.0))
    image.SetOrigin((3, -4, 5))
    image.SetDirection((0, -1, 0, 1, 0, 0, 0, 0, 1))
    sitk.WriteImage(image, str(tmp_path / "a.mha"))
    sitk.WriteImage(image, str(tmp_path / "a.nii.gz"))
    volume = isolume.open(image)
    for name in ("a.mha", "a.nii.gz"):
        file = isolume.open(tmp_path / name)
        np.testing.assert_allclose(volume.affine, file.affine, atol=1e-6)
        assert file.up == volume.up == "anatomical" and file.metres == volume.metres
    # Where SimpleITK says that a sample is, in LPS.
    corner = np.array(image.TransformIndexToPhysicalPoint((9, 11, 13))) * [-1, -1, 1]
    np.testing.assert_allclose(volume.affine @ [9, 11, 13, 1], [*corner, 1], atol=1e-6)


def test_nibabel_has_the_place_and_the_values_that_its_file_has(tmp_path):
    nib = pytest.importorskip("nibabel")
    stored = np.round(40 * phantom_of()).astype("i2").T
    affine = np.array([[-1.5, 0, 0.1, 4], [0, 2, 0, 5], [0, 0.2, 1, 6], [0, 0, 0, 1.0]])
    image = nib.Nifti1Image(stored, affine)
    image.header.set_slope_inter(0.25, -3)
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, code=1)
    nib.save(image, tmp_path / "a.nii")
    loaded = nib.load(tmp_path / "a.nii")
    volume, file = isolume.open(loaded), isolume.open(tmp_path / "a.nii")
    np.testing.assert_allclose(volume.affine, file.affine, atol=1e-5)
    assert volume.dtype == file.dtype == np.int16 and volume.up == file.up == "anatomical"
    np.testing.assert_allclose(volume.range, file.range)
    np.testing.assert_allclose(volume.range, (loaded.get_fdata().min(), loaded.get_fdata().max()))
    # An image in memory has no scaling yet.
    in_memory = nib.Nifti1Image(np.asfortranarray(phantom_of().T), affine)
    held = isolume.open(in_memory)
    assert held.shape == phantom_of().shape
    assert held.address == np.asanyarray(in_memory.dataobj).__array_interface__["data"][0]


def background_of(picture):
    """Which pixels show something: those that differ from the corner."""
    return (picture.astype(int) != picture[0, 0].astype(int)).any(axis=2)


def test_pyvista_shows_the_colours_as_they_are(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    # So fine that it does not matter what lies between vertices.
    volume = isolume.open(phantom_of((42, 36, 30), 3))
    surface = volume.bake(ISOVALUE, store=tmp_path / "fine.isolume", rays=64, layers=2, bands=3).surface(ISOVALUE, "sky:30,50")
    mesh = surface.to_pyvista()
    assert mesh.n_points == len(surface.points) and mesh.n_cells == len(surface.faces)
    np.testing.assert_array_equal(mesh.point_data["RGB"], surface.rgb)
    np.testing.assert_allclose(mesh.point_data["radiance"], surface.radiance)
    plotter = pyvista.Plotter(off_screen=True, window_size=(320, 240), lighting=None)
    plotter.set_background((0x2C / 255, 0x30 / 255, 0x36 / 255))
    plotter.add_mesh(mesh, scalars="RGB", rgb=True, lighting=False)
    plotter.enable_parallel_projection()
    right, up = view_of(surface, plotter)
    picture = np.asarray(plotter.screenshot(return_img=True))[..., :3]
    plotter.close()
    ours = surface.picture(width=320, height=240, supersampling=1, cap=False)
    theirs_mean, ours_mean = (p[background_of(p)].mean(axis=0) for p in (picture, ours))
    # Both show the same side; between vertices VTK interpolates bytes of sRGB.
    np.testing.assert_allclose(theirs_mean, ours_mean, atol=2)
    assert abs(background_of(picture).mean() - background_of(ours).mean()) < 0.01


def view_of(surface, plotter):
    """Puts the camera of a plotter where our default view has it: azimuth 35°, elevation 25°, in the frame of the volume."""
    up, front = (np.array(a) for a in surface._inner.axes)
    right = np.cross(up, front)
    a, e = np.radians([35, 25])
    towards = np.cos(e) * (np.sin(a) * right + np.cos(a) * front) + np.sin(e) * up
    centre = (surface.points.max(axis=0) + surface.points.min(axis=0)) / 2
    plotter.camera.position = centre + 100 * towards
    plotter.camera.focal_point = centre
    plotter.camera.up = up
    screen_up = up - (up @ towards) * towards
    screen_up /= np.linalg.norm(screen_up)
    screen_right = np.cross(screen_up, towards)
    # As our camera frames what it sees: whichever side is the tighter.
    along = [(surface.points - centre) @ v for v in (screen_right, screen_up)]
    middle = [(s.max() + s.min()) / 2 for s in along]
    shift = middle[0] * screen_right + middle[1] * screen_up
    plotter.camera.position = np.array(plotter.camera.position) + shift
    plotter.camera.focal_point = np.array(plotter.camera.focal_point) + shift
    half = [(s.max() - s.min()) / 2 for s in along]
    plotter.camera.parallel_scale = 1.05 * max(half[1], half[0] / (320 / 240))
    return screen_right, screen_up


def test_vtk_without_pyvista(surface):
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    mesh = surface.to_vtk()
    assert mesh.GetNumberOfPolys() == len(surface.faces)
    np.testing.assert_array_equal(vtk_to_numpy(mesh.GetPointData().GetScalars()), surface.rgb)
    np.testing.assert_array_equal(vtk_to_numpy(mesh.GetPoints().GetData()), surface.points)
    np.testing.assert_array_equal(vtk_to_numpy(mesh.GetPointData().GetNormals()), surface.normals)


def test_trimesh_keeps_vertices_and_colours(surface):
    pytest.importorskip("trimesh")
    mesh = surface.to_trimesh()
    assert len(mesh.vertices) == len(surface.points)
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], surface.rgb)
    assert mesh.is_watertight and mesh.volume > 0


def test_napari_takes_layer_data(surface):
    (points, faces, values), meta, kind = surface.to_napari()
    assert kind == "surface" and meta["shading"] == "none" and len(values) == len(points)
    np.testing.assert_array_equal(points, surface.points[:, ::-1])
    np.testing.assert_allclose(meta["vertex_colors"] * 255, surface.rgb)
    a, b, c = (points[faces[:, k]].astype("f8") for k in range(3))
    normals = surface.normals[:, ::-1][faces].mean(axis=1)
    facets = np.cross(b - a, c - a)
    large = np.linalg.norm(facets, axis=1) > 1e-3
    assert ((facets * normals).sum(axis=1)[large] > 0).mean() > 0.99


def test_ply_is_right_in_pyvista(surface, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    surface.write(tmp_path / "a.ply")
    mesh = pyvista.read(tmp_path / "a.ply")
    np.testing.assert_array_equal(mesh.point_data["RGB"], surface.rgb)
