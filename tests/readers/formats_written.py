"""Volumes as other programs write them, read by isolume and compared sample by sample.

    python tests/readers/formats_written.py ISOLUME

The phantom of 5 x 7 x 9 samples, 100x + 10y + z, is written by VTK, SimpleITK, nibabel, pynrrd, tifffile, GridDataFormats and
NumPy in every encoding that they have, in straight, oblique and left-handed frames. `isolume info --json` says where its samples
lie, and the BLAKE3 of them with all that belongs to them: the same is computed here of what was written. The place of every
sample must be that of the program that wrote it, within 1e-5 of the box. Exit code 0: everything holds.
"""

import gzip
import itertools
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import blake3
import numpy as np

isolume = sys.argv[1]
folder = pathlib.Path(tempfile.mkdtemp(prefix="isolume-formats-"))
counts = {}
failures = []

DIMS = (5, 7, 9)
SPACING = np.array([0.5, 0.7, 1.1])
ORIGIN = np.array([10.0, -20.0, 30.0])
GRID = np.stack(np.meshgrid(*[np.arange(n) for n in DIMS], indexing="ij"))
PHANTOM = 100 * GRID[0] + 10 * GRID[1] + GRID[2]  # [x, y, z]


def turned(axis, angle):
    """The rotation about an axis (Rodrigues)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


OBLIQUE = turned([1, 2, -3], 0.7)
FRAMES = {"straight": np.eye(3), "oblique": OBLIQUE, "left-handed": OBLIQUE @ np.diag([1, 1, -1])}


def affine_of(direction, spacing=SPACING, origin=ORIGIN):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = direction * spacing, origin
    return out


def ras(lps):
    return np.diag([-1, -1, 1, 1]) @ lps


def kept(values):
    """The samples in a type that isolume keeps."""
    if values.dtype.kind in "iu" and values.dtype.itemsize > 2:
        low, high = int(values.min()), int(values.max())
        if low >= 0 and high < 1 << 16:
            return values.astype("u2")
        return values.astype("i2" if -(1 << 15) <= low and high < 1 << 15 else "f4")
    return values.astype("f4") if values.dtype.kind == "f" else values


def info(path, *options):
    command = [isolume, "info", str(path), "--json", *options]
    return subprocess.run(command, capture_output=True, text=True)


def refused(kind, path, *words, options=()):
    """The file is refused with these words."""
    counts[kind] = counts.get(kind, 0) + 1
    run = info(path, *options)
    text = run.stdout + run.stderr
    if run.returncode == 0 or not all(word in text for word in words):
        failures.append(f"{kind} {path.name} {options}: not refused with {words}: {text[:300]}")


def holds(kind, path, values, affine, options=(), metres=None, scaling=(1.0, 0.0)):
    """The file has these samples [x, y, z] at these places."""
    counts[kind] = counts.get(kind, 0) + 1

    def fail(text):
        failures.append(f"{kind} {path.name} {' '.join(options)}: {text}")

    run = info(path, *options)
    if run.returncode:
        return fail(run.stderr.strip() or run.stdout.strip())
    found = json.loads(run.stdout)
    if tuple(found["dims"]) != values.shape:
        return fail(f"dims {found['dims']}, not {values.shape}")
    corners = np.array([*itertools.product(*[range(n) for n in values.shape])], float)
    places = lambda m: corners @ np.asarray(m)[:3, :3].T + np.asarray(m)[:3, 3]
    expected, here = places(affine), places(found["world_from_grid"])
    off, box = np.abs(expected - here).max(), np.linalg.norm(np.ptp(expected, axis=0))
    if not off <= 1e-5 * box:
        return fail(f"samples are off by {off:.3e}: {found['world_from_grid']}, not {np.asarray(affine)[:3].tolist()}")
    if metres is not None and found["metres_per_unit"] != metres:
        return fail(f"{found['metres_per_unit']} metres, not {metres}")
    samples = kept(values)
    name = {"u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "f4": "float32"}[samples.dtype.str[1:]]
    matrix = np.array(found["world_from_grid"])
    hasher = blake3.blake3(name.encode())
    hasher.update(np.array(samples.shape, "<u8").tobytes())
    numbers = [*matrix[:, :3].T.ravel(), *matrix[:, 3], *scaling]
    hasher.update(np.array(numbers, "<f8").tobytes())
    hasher.update(samples.astype(samples.dtype.newbyteorder("<")).tobytes(order="F"))
    if found["type"] != name or found["content_hash"] != hasher.hexdigest():
        got = (found["type"], found["range"], found["scaling"])
        return fail(f"samples differ: {got}, not {(name, float(values.min()), float(values.max()))}")


def vtk_files():
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk

    def image(direction=np.eye(3), first=(0, 0, 0), dims=DIMS):
        data = vtk.vtkImageData()
        data.SetExtent(*[v for f, n in zip(first, dims) for v in (f, f + n - 1)])
        data.SetSpacing(*SPACING)
        data.SetOrigin(*ORIGIN)
        data.SetDirectionMatrix(*direction.ravel())
        return data

    def add(to, values, name="value"):
        flat = values.reshape(values.shape[0], -1, order="F").T if values.ndim == 4 else values.ravel(order="F")
        array = numpy_to_vtk(np.ascontiguousarray(flat), deep=True)
        array.SetName(name)
        to.AddArray(array)
        return array

    def places(data):
        """Index from 0 to world, by VTK's own map."""
        first = data.GetExtent()[::2]
        out = np.eye(4)
        point = [0.0] * 3
        data.TransformContinuousIndexToPhysicalPoint(*[float(v) for v in first], point)
        out[:3, 3] = point
        for axis in range(3):
            index = [float(v) for v in first]
            index[axis] += 1
            data.TransformContinuousIndexToPhysicalPoint(*index, point)
            out[:3, axis] = np.array(point) - out[:3, 3]
        return out

    def write(data, name, mode="appended raw", compressor="None", wide=True, big=False, block=None, parts=None):
        path = folder / name
        writer = vtk.vtkXMLPImageDataWriter() if parts else vtk.vtkXMLImageDataWriter()
        writer.SetInputData(data)
        writer.SetFileName(str(path))
        {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
        writer.SetEncodeAppendedData(mode == "appended base64")
        writer.SetCompressorType({"None": 0, "ZLib": 1, "LZ4": 2, "LZMA": 3}[compressor])
        (writer.SetHeaderTypeToUInt64 if wide else writer.SetHeaderTypeToUInt32)()
        (writer.SetByteOrderToBigEndian if big else writer.SetByteOrderToLittleEndian)()
        if block:
            writer.SetBlockSize(block)
        if parts:
            writer.SetNumberOfPieces(parts[0])
            writer.SetStartPiece(0)
            writer.SetEndPiece(parts[0] - 1)
            writer.SetGhostLevel(parts[1])
        assert writer.Write()
        return path

    frames = {name: image(direction) for name, direction in FRAMES.items()}
    for data in frames.values():
        add(data.GetPointData(), PHANTOM.astype("u2"))
    for mode, compressor, wide, big in itertools.product(
        ["ascii", "binary", "appended raw", "appended base64"], ["None", "ZLib", "LZ4", "LZMA"], [False, True], [False, True]
    ):
        name = f"{mode}-{compressor}-{64 if wide else 32}-{'big' if big else 'little'}.vti"
        path = write(frames["oblique"], name, mode, compressor, wide, big)
        if compressor == "LZMA":
            refused("VTI", path, "vtkLZMADataCompressor", "SetCompressorTypeToZLib")
        else:
            holds("VTI", path, PHANTOM.astype("u2"), places(frames["oblique"]))
    # What the refusal says to do, as it says it.
    remedy = info(path).stderr.split("Python:")[-1].replace("FILE", str(path)).replace("OUT.vti", str(folder / "remedy.vti"))
    subprocess.run([sys.executable, "-c", "\n".join(line.strip() for line in remedy.splitlines())], check=True)
    holds("VTI", folder / "remedy.vti", PHANTOM.astype("u2"), places(frames["oblique"]))
    # More than one block, the last one short, of 64-bit numbers.
    doubles = image(FRAMES["left-handed"])
    add(doubles.GetPointData(), PHANTOM.astype("f8"))
    for mode, compressor in itertools.product(["binary", "appended raw", "appended base64"], ["ZLib", "LZ4"]):
        path = write(doubles, f"blocks-{mode}-{compressor}.vti", mode, compressor, block=512)
        holds("VTI", path, PHANTOM.astype("f8"), places(doubles))
    for kind in ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"]:
        data = image()
        add(data.GetPointData(), PHANTOM.astype(kind))
        for mode in ["ascii", "binary", "appended raw"]:
            holds("VTI", write(data, f"{kind}-{mode}.vti", mode, big=kind > "i2"), PHANTOM.astype(kind), places(data))
    for name, data in frames.items():
        path = write(data, f"{name}.vti")
        holds("VTI", path, PHANTOM.astype("u2"), affine_of(FRAMES[name]))
        holds("VTI", path, PHANTOM.astype("u2"), places(data))
        packed = path.with_suffix(".vti.gz")
        packed.write_bytes(gzip.compress(path.read_bytes()))
        holds("VTI", packed, PHANTOM.astype("u2"), places(data))
    moved = image(OBLIQUE, first=(3, -2, 7))
    add(moved.GetPointData(), PHANTOM.astype("f4"))
    for mode in ["ascii", "binary", "appended raw"]:
        holds("VTI", write(moved, f"extent-{mode}.vti", mode), PHANTOM.astype("f4"), places(moved))

    # Values of cells: one sample less an axis, half a step inside. Both by VTK's centres of cells.
    for first in [(0, 0, 0), (3, -2, 7)]:
        cells = image(OBLIQUE, first=first, dims=[n + 1 for n in DIMS])
        add(cells.GetCellData(), PHANTOM.astype("u2"))
        centres = vtk.vtkCellCenters()
        centres.SetInputData(cells)
        centres.Update()
        at = lambda x, y, z: np.array(centres.GetOutput().GetPoint(x + DIMS[0] * (y + DIMS[1] * z)))
        affine = np.eye(4)
        affine[:3, 3] = at(0, 0, 0)
        affine[:3, :3] = np.stack([at(1, 0, 0), at(0, 1, 0), at(0, 0, 1)], axis=1) - at(0, 0, 0)[:, None]
        for mode in ["ascii", "binary", "appended raw"]:
            holds("VTI", write(cells, f"cells-{first[0]}-{mode}.vti", mode), PHANTOM.astype("u2"), affine)

    # Several arrays, one of vectors: the active one, else by name and component.
    several = image()
    vectors = np.stack([PHANTOM + 1000 * c for c in range(3)]).astype("f4")
    add(several.GetPointData(), PHANTOM.astype("u2"), "density")
    add(several.GetPointData(), vectors, "velocity")
    add(several.GetCellData(), np.arange(4 * 6 * 8).reshape(4, 6, 8).astype("i2"), "label")
    pairs = ["ascii None", "binary None", "binary ZLib", "appended raw ZLib", "appended base64 None"]
    for mode, compressor in [pair.rsplit(" ", 1) for pair in pairs]:
        path = write(several, f"several-{mode}-{compressor}.vti", mode, compressor)
        refused("VTI", path, "density, velocity, label", "--array", options=["--array", "none"])
        holds("VTI", path, PHANTOM.astype("u2"), affine_of(np.eye(3)), ["--array", "density"])
        for c in range(3):
            holds("VTI", path, vectors[c], affine_of(np.eye(3)), ["--array", "velocity", "--channel", str(c)])
        inner = affine_of(np.eye(3), origin=ORIGIN + SPACING / 2)
        holds("VTI", path, np.arange(4 * 6 * 8).reshape(4, 6, 8).astype("i2"), inner, ["--array", "label"])
    several.GetPointData().SetActiveScalars("density")
    holds("VTI", write(several, "active.vti"), PHANTOM.astype("u2"), affine_of(np.eye(3)))
    # Parts that share a layer of points, perhaps with ghosts.
    for (count, ghosts), compressor, mode in itertools.product([(1, 0), (3, 0), (4, 1)], ["None", "ZLib"], ["appended raw", "ascii"]):
        path = write(moved, f"parts-{count}-{ghosts}-{compressor}-{mode}.pvti", mode, compressor, parts=(count, ghosts))
        holds("pVTI", path, PHANTOM.astype("f4"), places(moved))


def itk_files():
    import SimpleITK as sitk

    def image(values, direction=np.eye(3), vector=False):
        axes = values.transpose(3, 2, 1, 0) if vector else values.transpose(2, 1, 0)
        out = sitk.GetImageFromArray(np.ascontiguousarray(axes), isVector=vector)
        out.SetSpacing(SPACING.tolist())
        out.SetOrigin(ORIGIN.tolist())
        out.SetDirection(direction.ravel().tolist())
        return out

    def places(of):
        """RAS+ from the index, by ITK's own map."""
        point = lambda *index: np.array(of.TransformContinuousIndexToPhysicalPoint([float(i) for i in index])[:3])
        rest = [0] * (of.GetDimension() - 3)
        out = np.eye(4)
        out[:3, 3] = point(0, 0, 0, *rest)
        for axis in range(3):
            out[:3, axis] = point(*np.eye(3)[axis], *rest) - out[:3, 3]
        return ras(out)

    def write(of, name, packed=False):
        sitk.WriteImage(of, str(folder / name), packed)
        return folder / name

    kinds = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"]
    for name, direction in FRAMES.items():
        for kind, packed, suffix in itertools.product(kinds, [False, True], ["mha", "mhd", "nrrd", "nhdr"]):
            if name != "straight" and kind != "u2":
                continue
            of = image(PHANTOM.astype(kind), direction)
            assert np.allclose(places(of), ras(affine_of(direction)))
            title = {"mha": "MHA", "mhd": "MHD"}.get(suffix, "NRRD")
            path = write(of, f"{name}-{kind}-{packed}.{suffix}", packed)
            holds(title, path, PHANTOM.astype(kind), places(of), metres=1e-3 if title != "NRRD" else None)
    # What another program wrote in the other byte order, and as text.
    of = image(PHANTOM.astype("u2"), OBLIQUE)
    head = write(of, "base.mhd").read_text()
    raw = PHANTOM.astype(">u2").tobytes(order="F")
    big = head.replace("ByteOrderMSB = False", "ByteOrderMSB = True").replace("base.raw", "LOCAL")
    (folder / "big.mha").write_bytes(big.encode() + raw)
    text = head.replace("BinaryData = True", "BinaryData = False").replace("base.raw", "LOCAL")
    (folder / "text.mha").write_text(text + " ".join(map(str, PHANTOM.ravel(order="F"))) + "\n")
    for name in ["big.mha", "text.mha"]:
        read = sitk.GetArrayFromImage(sitk.ReadImage(str(folder / name))).transpose(2, 1, 0)
        holds("MHA", folder / name, read, places(of))
        assert np.array_equal(read, PHANTOM), name
    # Components and time.
    vectors = np.stack([PHANTOM + 1000 * c for c in range(3)]).astype("i2")
    of = image(vectors, FRAMES["left-handed"], vector=True)
    series = sitk.JoinSeries([image((PHANTOM + 1000 * t).astype("i2"), OBLIQUE) for t in range(3)], 5.0, 2.5)
    for suffix, packed in itertools.product(["mha", "mhd", "nrrd"], [False, True]):
        title = {"mha": "MHA", "mhd": "MHD"}.get(suffix, "NRRD")
        path = write(of, f"vector-{packed}.{suffix}", packed)
        late = write(series, f"series-{packed}.{suffix}", packed)
        for c in range(3):
            holds(title, path, vectors[c], places(of), ["--channel", str(c)])
            holds(title, late, (PHANTOM + 1000 * c).astype("i2"), places(series), ["--timepoint", str(c)])


def nibabel_files():
    import nibabel

    for (version, make), (name, direction), code, suffix, order in itertools.product(
        [(1, nibabel.Nifti1Image), (2, nibabel.Nifti2Image)], FRAMES.items(), ["sform", "qform"], ["nii", "nii.gz"], "<>"
    ):
        affine = affine_of(direction)
        header = make.header_class(endianness=order)
        header.set_data_dtype(order + "i2")
        image = make(PHANTOM.astype("i2"), affine, header)
        image.set_sform(affine if code == "sform" else None, int(code == "sform"))
        image.set_qform(affine if code == "qform" else None, int(code == "qform"))
        image.header.set_xyzt_units("mm", "sec")
        path = folder / f"{name}-{code}-{'little' if order == '<' else 'big'}-{version}.{suffix}"
        nibabel.save(image, path)
        holds(f"NIfTI-{version}", path, PHANTOM.astype("i2"), nibabel.load(path).affine, metres=1e-3)
        assert np.allclose(nibabel.load(path).affine, affine, atol=1e-4)
    for kind in ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"]:
        image = nibabel.Nifti2Image(PHANTOM.astype(kind), affine_of(OBLIQUE), dtype=np.dtype(kind))
        nibabel.save(image, folder / f"{kind}.nii")
        holds("NIfTI-2", folder / f"{kind}.nii", PHANTOM.astype(kind), affine_of(OBLIQUE))
    both = np.stack([np.stack([PHANTOM + 1000 * c + 2000 * t for t in range(3)], axis=3) for c in range(2)], axis=4)
    for version, make in [(1, nibabel.Nifti1Image), (2, nibabel.Nifti2Image)]:
        path = folder / f"series-{version}.nii.gz"
        nibabel.save(make(both.astype("i2"), affine_of(OBLIQUE)), path)
        refused(f"NIfTI-{version}", path, "channels", options=["--channel", "2"])
        for c, t in itertools.product(range(2), range(3)):
            options = ["--channel", str(c), "--timepoint", str(t)]
            holds(f"NIfTI-{version}", path, both[..., t, c].astype("i2"), affine_of(OBLIQUE), options)
        pair = nibabel.Nifti1Pair if version == 1 else nibabel.Nifti2Pair
        nibabel.save(pair(PHANTOM.astype("i2"), affine_of(OBLIQUE)), folder / f"pair-{version}.img")
        holds(f"NIfTI-{version}", folder / f"pair-{version}.hdr", PHANTOM.astype("i2"), affine_of(OBLIQUE))


def nrrd_files():
    import nrrd

    for (name, direction), encoding, detached in itertools.product(FRAMES.items(), ["raw", "gzip", "ascii"], [False, True]):
        affine = affine_of(direction)
        header = {"space": "left-posterior-superior", "space directions": affine[:3, :3].T, "space origin": ORIGIN,
                  "space units": ["mm"] * 3, "encoding": encoding}
        path = folder / f"{name}-{encoding}-{detached}.{'nhdr' if detached else 'nrrd'}"
        nrrd.write(str(path), PHANTOM.astype("u2"), header, detached_header=detached)
        holds("NRRD", path, PHANTOM.astype("u2"), ras(affine), metres=1e-3)


def grid_files():
    import gridData

    edges = lambda spacing: [ORIGIN[a] + spacing[a] * (np.arange(DIMS[a] + 1) - 0.5) for a in range(3)]
    for kind, suffix in itertools.product(["f4", "f8", "i4"], ["dx", "dx.gz"]):
        path = folder / f"{kind}.{suffix}"
        grid = gridData.Grid(PHANTOM.astype(kind), edges=edges(SPACING))
        grid.export(str(path), "DX")
        read = gridData.Grid(str(path))
        affine = affine_of(np.diag(read.delta), np.ones(3), read.origin)
        assert np.array_equal(read.grid, PHANTOM) and np.allclose(affine, affine_of(np.eye(3)))
        holds("DX", path, PHANTOM.astype(kind), affine, metres=1e-10)
    # An oblique grid as text, which GridDataFormats reads but does not write.
    steps = affine_of(OBLIQUE)[:3, :3]
    lines = ["# oblique", f"object 1 class gridpositions counts {' '.join(map(str, DIMS))}", f"origin {' '.join(map(str, ORIGIN))}"]
    lines += ["delta " + " ".join(map(repr, map(float, steps[:, a]))) for a in range(3)]
    lines += [f"object 2 class gridconnections counts {' '.join(map(str, DIMS))}"]
    lines += [f"object 3 class array type double rank 0 items {PHANTOM.size} data follows"]
    lines += [" ".join(map(str, row)) for row in PHANTOM.reshape(-1, 3)] + ['attribute "dep" string "positions"']
    (folder / "oblique.dx").write_text("\n".join(lines) + "\n")
    holds("DX", folder / "oblique.dx", PHANTOM.astype("f8"), affine_of(OBLIQUE))
    for order in "<>":
        # Borders of the first and the last cell, as GridDataFormats reads them.
        first, last = ORIGIN - SPACING / 2, ORIGIN + SPACING * (np.array(DIMS) - 0.5)
        head = struct.pack(order + "5i", 3, 200, *DIMS[::-1])
        head += struct.pack(order + "6f", *[v for a in (2, 1, 0) for v in (first[a], last[a])])
        path = folder / f"{'little' if order == '<' else 'big'}.plt"
        path.write_bytes(head + PHANTOM.astype(order + "f4").tobytes(order="F"))
        read = gridData.Grid(str(path))
        assert np.array_equal(read.grid, PHANTOM) and np.allclose(read.origin, ORIGIN, atol=1e-5)
        holds("PLT", path, PHANTOM.astype("f4"), affine_of(np.eye(3), read.delta, read.origin), metres=1e-10)


def numpy_files():
    for save, kind in itertools.product([np.savez, np.savez_compressed], ["u1", "u2", ">i2", "f4", ">f8", "i8"]):
        zyx = np.ascontiguousarray(PHANTOM.transpose(2, 1, 0).astype(kind))
        native = PHANTOM.astype(np.dtype(kind).newbyteorder("="))
        path = folder / f"{save.__name__}-{kind.replace('>', 'big')}.npz"
        save(path, volume=zyx, scalar=3.5)
        holds("npz", path, native, np.eye(4))
        save(path, volume=np.asfortranarray(zyx), affine=affine_of(OBLIQUE), unit=np.array("um"))
        holds("npz", path, native, affine_of(OBLIQUE), metres=1e-6)
        save(path, a=zyx, b=zyx[::-1], spacing=SPACING)
        refused("npz", path, "one of a, b", options=["--array", "c"])
        holds("npz", path, native[:, :, ::-1], affine_of(np.eye(3), SPACING, np.zeros(3)), ["--array", "b"])


CHECKS = [vtk_files, itk_files, nibabel_files, nrrd_files, grid_files, numpy_files]
if len(sys.argv) > 2:
    CHECKS = [c for c in CHECKS if c.__name__ in sys.argv[2:]]
for check in CHECKS:
    check()
for failure in failures[:40]:
    print("FAIL", failure)
print(", ".join(f"{kind}: {n} files" for kind, n in counts.items()), f"- {len(failures)} failures")
if not failures:
    import shutil

    shutil.rmtree(folder)
sys.exit(bool(failures))
