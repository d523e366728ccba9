"""Volumes as other programs write them, read by isolume and compared sample by sample.

    python tests/readers/formats_written.py ISOLUME

The phantom of 5 x 7 x 9 samples, 100x + 10y + z, is written by VTK, SimpleITK, nibabel, pynrrd, tifffile, GridDataFormats,
NumPy, zarr-python, ome-zarr, pydicom and highdicom in every encoding that they have, in straight, oblique and left-handed frames. `isolume info --json` says where its samples
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
        holds("VTI", path, PHANTOM.astype("u2"), places(frames["oblique"]))
    # More than one block, the last one short, of 64-bit numbers.
    doubles = image(FRAMES["left-handed"])
    add(doubles.GetPointData(), PHANTOM.astype("f8"))
    for mode, compressor in itertools.product(["binary", "appended raw", "appended base64"], ["ZLib", "LZ4", "LZMA"]):
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


def zarr_files():
    import numcodecs
    import zarr
    from ome_zarr.format import FormatV04, FormatV05
    from ome_zarr.writer import write_multiscale

    zyx = lambda values: np.ascontiguousarray(values.transpose(2, 1, 0))
    spacing = ["--spacing", "0.5,0.7,1.1mm"]
    placed = affine_of(np.eye(3), origin=np.zeros(3))
    chunkings = [(9, 7, 5), (4, 3, 2), (16, 16, 16), (1, 7, 5), (2, 2, 2)]

    def plain(name, values, options=spacing, path=None, **how):
        path = folder / f"{name}.zarr"
        zarr.create_array(str(path), data=zyx(values), **how)
        read = zarr.open(str(path), mode="r")[:].transpose(2, 1, 0)
        holds("Zarr", path, read, placed, options, metres=1e-3)
        assert np.array_equal(read, values, equal_nan=True), name
        return path

    # Version 2: every compressor and filter that is read, by what shuffles before it.
    shuffles = [numcodecs.Blosc.NOSHUFFLE, numcodecs.Blosc.SHUFFLE, numcodecs.Blosc.BITSHUFFLE]
    packers = {f"blosc-{name}-{s}-{block}": numcodecs.Blosc(cname=name, clevel=level, shuffle=s, blocksize=block)
               for name, level in [("lz4", 5), ("lz4hc", 9), ("zstd", 3), ("zlib", 4), ("blosclz", 9), ("lz4", 0)]
               for s in shuffles for block in [0, 256]}
    packers |= {"none": None, "gzip": numcodecs.GZip(), "zlib": numcodecs.Zlib(), "zstd": numcodecs.Zstd(level=7), "lz4": numcodecs.LZ4()}
    for (name, packer), kind in itertools.product(packers.items(), ["u1", "f4"]):
        for chunks in chunkings[1:3]:
            title = f"v2-{name}-{kind}-{'x'.join(map(str, chunks))}"
            plain(title, PHANTOM.astype(kind), zarr_format=2, chunks=chunks, compressors=packer)
    # Enough samples for blocks that are split by bytes, and far matches of blosclz.
    rng = np.random.default_rng(7)
    x, y, z = np.meshgrid(*[np.arange(n) for n in (70, 80, 90)], indexing="ij")
    large = {"smooth": (1e4 * np.sin(x / 9) * np.cos(y / 7) + z).astype("i2"), "noise": rng.integers(0, 1 << 16, x.shape).astype("u2"),
             "sparse": np.where(rng.random(x.shape) < 0.01, x, 0).astype("f4"), "bands": ((x // 3 + y * z) % 7).astype("u1"),
             "long": rng.integers(0, 1 << 8, x.shape).astype("f8")}
    for number, ((kind, values), (name, packer)) in enumerate(itertools.product(large.items(), packers.items())):
        if number % 3 and "blosclz" not in name:
            continue
        plain(f"v2-large-{kind}-{name}", values, zarr_format=2, chunks=(64, 64, 64), compressors=packer)
    for kind, order in itertools.product(["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"], "CF"):
        values = (PHANTOM % 100 if kind in ("u1", "i1") else PHANTOM).astype(kind)
        plain(f"v2-{kind}-{order}", values, zarr_format=2, chunks=(4, 3, 2), order=order, filters=[numcodecs.Shuffle(np.dtype(kind).itemsize)])
        if values.itemsize > 1:
            big = values.astype(">" + kind)
            path = folder / f"v2-big-{kind}-{order}.zarr"
            zarr.create_array(str(path), data=zyx(big), zarr_format=2, chunks=(4, 3, 2), order=order)
            holds("Zarr", path, values, placed, spacing, metres=1e-3)
    # Version 3.
    from zarr.codecs import BloscCodec, Crc32cCodec, GzipCodec, TransposeCodec, ZstdCodec

    threes = {"none": [], "gzip": [GzipCodec()], "zstd": [ZstdCodec(level=3, checksum=True)], "blosc": [BloscCodec(cname="lz4", shuffle="bitshuffle")],
              "blosc-zstd": [BloscCodec(cname="zstd", shuffle="shuffle")], "crc": [Crc32cCodec()], "gzip-crc": [GzipCodec(), Crc32cCodec()]}
    for (name, packers3), chunks, separator in itertools.product(threes.items(), chunkings, [None, {"name": "v2", "separator": "."}]):
        key = {"chunk_key_encoding": separator} if separator else {}
        plain(f"v3-{name}-{'x'.join(map(str, chunks))}-{bool(separator)}", PHANTOM.astype("u2"), chunks=chunks, compressors=packers3, **key)
    for (name, packers3), (kind, values) in itertools.product(threes.items(), large.items()):
        plain(f"v3-large-{name}-{kind}", values, chunks=(32, 32, 32), shards=(96, 64, 64), compressors=packers3)
        plain(f"v3-turned-{name}-{kind}", values, chunks=(32, 40, 64), filters=[TransposeCodec(order=(2, 0, 1))], compressors=packers3)
    for kind in ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"]:
        values = (PHANTOM % 100 if kind in ("u1", "i1") else PHANTOM).astype(kind)
        plain(f"v3-{kind}", values, chunks=(2, 3, 2), shards=(4, 6, 6))
    path = folder / "start.zarr"
    zarr.create_array(str(path), data=zyx(PHANTOM.astype("u2")), chunks=(3, 2, 2), shards={"shape": (6, 4, 6), "index_location": "start"})
    holds("Zarr", path, PHANTOM.astype("u2"), placed, spacing)

    # What is not stored is the fill value.
    for version, fill in itertools.product([2, 3], [7.5, np.nan, -np.inf]):
        path = folder / f"gaps-{version}-{fill}.zarr"
        sharded = {"shards": (4, 4, 4)} if version == 3 else {}
        some = zarr.create_array(str(path), shape=(9, 7, 5), chunks=(2, 2, 2), dtype="f4", fill_value=fill, zarr_format=version, **sharded)
        some[1:4, 2:5, 1:3] = zyx(PHANTOM)[1:4, 2:5, 1:3]
        read = zarr.open(str(path), mode="r")[:].transpose(2, 1, 0)
        # isolume has no other samples than finite ones: the smallest stands for them.
        finite = np.where(np.isfinite(read), read, read[np.isfinite(read)].min())
        holds("Zarr", path, finite, placed, spacing)

    # OME-Zarr by its writer: axes in any order, channels and times, levels, units.
    units = {"x": "micrometer", "y": "micrometer", "z": "nanometer", "t": "second"}
    for fmt, axes in itertools.product([FormatV04(), FormatV05()], ["zyx", "xyz", "tczyx", "czyx", "tzyx"]):
        if fmt.version == "0.4" and axes == "xyz":
            continue
        path = folder / f"ome-{fmt.version}-{axes}.zarr"
        group = zarr.open_group(str(path), mode="w", zarr_format=2 if fmt.version == "0.4" else 3)
        both = lambda c, t: PHANTOM + 1000 * c + 2000 * t
        rank5 = np.array([[both(c, t).transpose(2, 1, 0) for c in range(2)] for t in range(3)], "u2")  # tczyx
        data = rank5[tuple(slice(None) if a in axes else 0 for a in "tczyx")]
        data = data.transpose([[a for a in "tczyx" if a in axes].index(a) for a in axes])
        coarse = data[tuple(slice(None, None, 2) if a in "xyz" else slice(None) for a in axes)]
        scale = {"x": 0.5, "y": 0.7, "z": 1100.0, "t": 5.0, "c": 1.0}
        moved = {"x": 10.0, "y": -20.0, "z": 30000.0}
        levels = []
        for factor in [1, 2]:
            levels.append([{"type": "scale", "scale": [scale[a] * (factor if a in "xyz" else 1) for a in axes]},
                           {"type": "translation", "translation": [moved.get(a, 0.0) + (factor - 1) / 2 * scale[a] for a in axes]}])
        kinds = {"t": "time", "c": "channel"}
        write_multiscale([data, coarse], group, fmt=fmt, axes=[{"name": a, "type": kinds.get(a, "space"), **({"unit": units[a]} if a in units else {})} for a in axes],
                         coordinate_transformations=levels, storage_options={"chunks": tuple(4 for _ in axes)})
        for level, c, t in itertools.product([0, 1], range(2 if "c" in axes else 1), range(3 if "t" in axes else 1)):
            step = np.array([0.5, 0.7, 1.1]) * (1 + level)
            origin = ORIGIN + level / 2 * np.array([0.5, 0.7, 1.1])
            values = both(c, t)[:: 1 + level, :: 1 + level, :: 1 + level].astype("u2")
            options = ["--level", str(level)] + (["--channel", str(c)] if "c" in axes else []) + (["--timepoint", str(t)] if "t" in axes else [])
            holds(f"OME-Zarr {fmt.version}", path, values, affine_of(np.eye(3), step, origin), options, metres=1e-6)
            part = values[1:3, 0:2, 1:]
            shifted = origin + step * np.array([1, 0, 1])
            holds(f"OME-Zarr {fmt.version}", path, part, affine_of(np.eye(3), step, shifted), [*options, "--region", "1:3,0:2,1:"], metres=1e-6)
        refused("OME-Zarr", path, "0 to 1", options=["--level", "2"])

    # Damage of every kind.
    good = folder / "good.zarr"
    zarr.create_array(str(good), data=zyx(PHANTOM.astype("u2")), chunks=(4, 4, 4), compressors=[ZstdCodec(), Crc32cCodec()])
    import shutil

    def damaged(change, *words):
        path = folder / "damaged.zarr"
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(good, path)
        change(path)
        refused("Zarr", path, *words)

    def meta(**fields):
        def change(path):
            file = path / "zarr.json"
            said = json.loads(file.read_text()) | fields
            file.write_text(json.dumps(said))
        return change

    def chunk(edit):
        return lambda path: (path / "c/1/0/0").write_bytes(edit((path / "c/1/0/0").read_bytes()))

    damaged(chunk(lambda b: b""), "c/1/0/0", "no checksum")
    damaged(chunk(lambda b: b[:-1]), "c/1/0/0", "checksum")
    damaged(chunk(lambda b: b[:9] + bytes([b[9] ^ 4]) + b[10:]), "c/1/0/0", "checksum")
    damaged(lambda p: shutil.rmtree(p / "c"), "chunks", "copy it again")
    damaged(meta(shape=[9, 7, -5]), "shape")
    damaged(meta(shape=[9, 7, 10**15]), "--region")
    damaged(meta(shape=[9, 7]), "axes")
    damaged(meta(data_type="complex64"), "data_type")
    damaged(meta(data_type="uint8"), "expected a chunk")
    damaged(meta(codecs=[{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "pcodec"}]), "pcodec")
    damaged(meta(chunk_grid={"name": "regular", "configuration": {"chunk_shape": [0, 4, 4]}}), "chunks")
    damaged(meta(fill_value="x"), "fill_value")
    damaged(lambda p: (p / "zarr.json").write_text("{"), "JSON")
    damaged(lambda p: (p / "zarr.json").write_text("[]"), "node_type")


def dicom_files():
    import shutil

    import pydicom
    import SimpleITK as sitk
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.sequence import Sequence
    from pydicom.uid import (CTImageStorage, DeflatedExplicitVRLittleEndian, ExplicitVRBigEndian, ExplicitVRLittleEndian, ImplicitVRLittleEndian,
                             JPEG2000, JPEG2000Lossless, JPEGLSLossless, RLELossless, generate_uid)

    normal_of = lambda d: np.cross(d[:, 0], d[:, 1])
    CT = (PHANTOM - 500).astype("i2")

    def series(name, values=CT, direction=OBLIQUE, syntax=ExplicitVRLittleEndian, step=None, spacing=SPACING, uid=None, skip=(), edit=None, order=None,
               bits=16, stored=None, time=None, folder_of=None):
        """One file a section, of names and instance numbers in another order than the places."""
        path = folder_of or folder / name
        path.mkdir(exist_ok=True)
        uid = uid or generate_uid()
        step = normal_of(direction) * spacing[2] if step is None else step
        for z in range(values.shape[2]):
            if z in skip:
                continue
            data = Dataset()
            data.file_meta = FileMetaDataset()
            data.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian if syntax in (RLELossless, JPEG2000Lossless, JPEGLSLossless, JPEG2000) else syntax
            data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = CTImageStorage
            data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = generate_uid()
            data.PatientName, data.PatientID, data.Modality, data.SeriesInstanceUID, data.SeriesNumber = "Doe^Jane", "secret", "CT", uid, 3
            data.SeriesDescription, data.InstanceNumber = "phantom", values.shape[2] - z
            inner = Dataset()
            inner.ReferencedSOPInstanceUID = generate_uid()
            data.ReferencedImageSequence = Sequence([inner, inner])
            # Of known and of unknown length.
            data["ReferencedImageSequence"].is_undefined_length = inner.is_undefined_length_sequence_item = bool(z % 2)
            data.ImageOrientationPatient = [float(f"{v:.9f}") for v in [*direction[:, 0], *direction[:, 1]]]
            data.ImagePositionPatient = [float(f"{v:.9f}") for v in ORIGIN + z * step]
            # Rows first; both of the next are wrong on purpose.
            data.PixelSpacing, data.SliceThickness, data.SpacingBetweenSlices = [spacing[1], spacing[0]], 9, 7
            data.Rows, data.Columns, data.SamplesPerPixel, data.PhotometricInterpretation = values.shape[1], values.shape[0], 1, "MONOCHROME2"
            data.BitsAllocated, data.BitsStored = bits, stored or bits
            data.HighBit, data.PixelRepresentation = data.BitsStored - 1, int(values.dtype.kind == "i")
            if time is not None:
                data.TemporalPositionIdentifier = time
            if edit:
                edit(data, z)
            pixels = np.ascontiguousarray(values[:, :, z].T)
            big = syntax == ExplicitVRBigEndian
            data.PixelData = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<")).tobytes()
            if values.dtype.itemsize == 1:
                data.PixelData += b"\0" * (len(data.PixelData) % 2)
                data["PixelData"].VR = "OB"
            else:
                data["PixelData"].VR = "OW"
            if syntax in (RLELossless, JPEG2000Lossless, JPEGLSLossless):
                data.compress(syntax, generate_instance_uid=False)
            at = (z * 7 + 3) % 23 if order is None else order(z)
            data.save_as(path / f"{at:03}{'' if time is None else f'-{time}'}.dcm", enforce_file_format=True)
        return path

    def places(direction=OBLIQUE, step=None, spacing=SPACING, origin=ORIGIN):
        out = np.eye(4)
        out[:3, :2] = direction[:, :2] * spacing[:2]
        out[:3, 2] = normal_of(direction) * spacing[2] if step is None else step
        out[:3, 3] = origin
        return ras(out)

    def itk(path):
        reader = sitk.ImageSeriesReader()
        reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(path)))
        read = reader.Execute()
        point = lambda *i: np.array(read.TransformContinuousIndexToPhysicalPoint([float(v) for v in i]))
        out = np.eye(4)
        out[:3, 3] = point(0, 0, 0)
        for axis in range(3):
            out[:3, axis] = point(*np.eye(3)[axis]) - out[:3, 3]
        return sitk.GetArrayFromImage(read).transpose(2, 1, 0), ras(out)

    for name, direction in [("straight", np.eye(3)), ("oblique", OBLIQUE), ("turned", OBLIQUE @ np.diag([-1, 1, -1]))]:
        for syntax in [ExplicitVRLittleEndian, ImplicitVRLittleEndian, ExplicitVRBigEndian, DeflatedExplicitVRLittleEndian, RLELossless]:
            for kind in ["i2", "u2", "u1"]:
                values = (PHANTOM % 256 if kind == "u1" else PHANTOM - (500 if kind == "i2" else 0)).astype(kind)
                path = series(f"{name}-{syntax.name}-{kind}", values, direction, syntax, bits=8 * values.itemsize)
                holds("DICOM", path, values, places(direction), metres=1e-3)
                # GDCM reads neither the RLE nor the big-endian files of pydicom.
                if syntax in (ExplicitVRLittleEndian, ImplicitVRLittleEndian, DeflatedExplicitVRLittleEndian):
                    read, where = itk(path)
                    assert np.array_equal(read, values) and np.allclose(where, places(direction), atol=1e-5), (name, syntax, kind)
                    holds("DICOM", path, read.astype(values.dtype), where)
                    holds("DICOM", sorted(path.iterdir())[4], values, places(direction))
    # JPEG 2000 without loss, of samples with and without sign; its encoder wants more pixels.
    x, y, z = np.meshgrid(*[np.arange(n) for n in (70, 90, 9)], indexing="ij")
    for kind, stored in [("i2", 16), ("i2", 12), ("u2", 16), ("u2", 12), ("u1", 8)]:
        values = (900 * np.sin(x / 5) * np.cos(y / 8) + z * 11 + np.random.default_rng(3).integers(0, 9, x.shape)).astype("i2")
        values = values if kind == "i2" else (values + 2000).astype("u2") if kind == "u2" else ((values + 2000) // 16).astype("u1")
        path = series(f"jpeg2000-{kind}-{stored}", values, syntax=JPEG2000Lossless, bits=8 * values.itemsize, stored=stored)
        holds("DICOM", path, values, places())
    # JPEG, by libjpeg's codecs in imagecodecs: lossless in its seven predictors, baseline as that decodes it.
    import imagecodecs
    from pydicom.encaps import encapsulate
    from pydicom.uid import JPEGBaseline8Bit, JPEGLossless, JPEGLosslessSV1, UID

    def packed(name, values, syntax, encode, bits):
        path = series(name, values, bits=bits, stored=bits if bits == 8 else 12)
        for file in path.iterdir():
            data = pydicom.dcmread(file)
            data.PixelData = encapsulate([encode(data.pixel_array)])
            data["PixelData"].VR = "OB"
            data.file_meta.TransferSyntaxUID = syntax
            data["PixelData"].is_undefined_length = True
            data.save_as(file, enforce_file_format=True)
        return path

    for predictor in range(1, 8):
        for kind, bits in [("u2", 16), ("u1", 8)]:
            values = (PHANTOM % (1 << 12 if bits == 16 else 256)).astype(kind)
            encode = lambda image: imagecodecs.jpeg_encode(image, lossless=True, predictor=predictor, bitspersample=12 if image.itemsize == 2 else 8)
            path = packed(f"lossless-{predictor}-{kind}", values, JPEGLosslessSV1 if predictor == 1 else JPEGLossless, encode, bits)
            holds("DICOM", path, values, places())
    values = (PHANTOM % 256).astype("u1")
    encode = lambda image: imagecodecs.jpeg_encode(image, level=90)
    path = packed("baseline", values, JPEGBaseline8Bit, encode, 8)
    found = json.loads(info(path).stdout or "{}")
    decoded = np.stack([imagecodecs.jpeg_decode(encode(np.ascontiguousarray(values[:, :, z].T))).T for z in range(9)], axis=2)
    if not found or abs(found["range"][0] - float(decoded.min())) > 2 or abs(found["range"][1] - float(decoded.max())) > 2:
        failures.append(f"baseline: {info(path).stderr}{found.get('range')}, not {decoded.min()} to {decoded.max()}")
    counts["DICOM"] += 1
    refused("DICOM", series("jpeg-ls", CT, syntax=JPEGLSLossless), "JPEG-LS", "gdcmconv --raw")

    # Values: 12 bits with an overlay above, slopes of the series and of each slice, padding.
    twelve = (PHANTOM - 500).astype("i2")
    dirty = ((twelve & 0xfff) | 0x3000).astype("u2").view("i2")
    holds("DICOM", series("twelve", dirty, stored=12), twelve, places())
    slope = lambda a, b: lambda data, z: setattr(data, "RescaleSlope", a) or setattr(data, "RescaleIntercept", b)
    path = series("hounsfield", PHANTOM.astype("u2"), edit=slope(1, -1024))
    holds("DICOM", path, PHANTOM.astype("u2"), places(), scaling=(1.0, -1024.0))
    assert np.array_equal(itk(path)[0], PHANTOM - 1024)

    def pet(data, z):
        data.RescaleSlope, data.RescaleIntercept, data.Modality = [0.5, 0.25, 2][z % 3], z, "PT"

    path = series("pet", PHANTOM.astype("u2"), edit=pet)
    read = np.stack([PHANTOM[:, :, z] * [0.5, 0.25, 2][z % 3] + z for z in range(9)], axis=2)
    assert np.allclose(itk(path)[0], read)
    holds("DICOM", path, read.astype("f4"), places())

    def pad(data, z):
        data.add_new(0x00280120, "SS", -2000)

    padded = CT.copy()
    padded[0, 0, :], padded[4, 6, :] = -2000, -2000
    holds("DICOM", series("padding", padded, edit=pad), np.where(padded == -2000, padded[padded != -2000].min(), padded), places())

    # A tilted gantry: sheared, as SimpleITK is not (it warns and takes the normal).
    tilt = np.cos(np.radians(15)) * normal_of(OBLIQUE) * 1.1 + np.sin(np.radians(15)) * OBLIQUE[:, 1] * 1.1
    path = series("tilt", step=tilt)
    holds("DICOM", path, CT, places(step=tilt))
    if "15.00" not in info(path).stdout:
        failures.append("tilt: the angle is not told")

    # Missing slices: named; interpolated where allowed. Not equal distances: refused.
    path = series("gaps", skip=(4, 5), direction=np.eye(3))
    refused("DICOM", path, "2 slices missing between slices 3 and 4", "--allow-gaps")
    filled = CT.astype("f8")
    for z in (4, 5):
        filled[:, :, z] = filled[:, :, 3] + (z - 3) / 3 * (filled[:, :, 6] - filled[:, :, 3])
    holds("DICOM", path, np.round(filled).astype("i2"), places(np.eye(3)), ["--allow-gaps"])
    irregular = lambda data, z: setattr(data, "ImagePositionPatient", [0, 0, z + (0.3 if z == 4 else 0)])
    refused("DICOM", series("irregular", direction=np.eye(3), edit=irregular), "distance", "dcm2niix")
    sideways = lambda data, z: setattr(data, "ImagePositionPatient", [3.0 if z == 4 else 0, 0, z])
    refused("DICOM", series("sideways", direction=np.eye(3), edit=sideways), "off the line")
    one = series("one", CT[:, :, :1])
    refused("DICOM", one, "at least two")
    # The same files twice, and the same slices under other names.
    path = series("twice")
    for file in list(path.iterdir()):
        shutil.copy(file, path / f"copy-{file.name}")
    holds("DICOM", path, CT, places())
    path, uid = folder / "again", generate_uid()
    for n in range(2):
        series("again", uid=uid, order=lambda z: 100 * n + z)
    holds("DICOM", path, CT, places())

    # Two times at each place, two series in a folder, a localiser among them.
    uid = generate_uid()
    for t in (1, 2):
        path = series("times", (CT + 1000 * t).astype("i2"), uid=uid, time=t)
    for t in (1, 2):
        holds("DICOM", path, (CT + 1000 * t).astype("i2"), places(), ["--timepoint", str(t - 1)])
    path = folder / "mixed"
    path.mkdir()
    uids = [generate_uid(), generate_uid()]
    series("mixed", uid=uids[0], folder_of=path, order=lambda z: z)
    number = lambda data, z: setattr(data, "SeriesNumber", 9) or setattr(data, "SeriesDescription", "localiser")
    series("mixed", CT[:, :, :3] * 2, uid=uids[1], folder_of=path, order=lambda z: 100 + z, edit=number)
    (path / "readme.txt").write_text("not an image")
    found = json.loads(info(path).stdout)
    assert len(found["series"]) == 2 and "localiser" in found["series"][1] and "Doe" not in str(found), found["series"]
    holds("DICOM", path, CT, places(), ["--series", "0"])
    holds("DICOM", path, CT, places(), ["--series", uids[0]])
    holds("DICOM", path, CT[:, :, :3] * 2, places(), ["--series", "1"])
    holds("DICOM", path, CT[1:3, :, 2:], places(origin=ORIGIN + OBLIQUE[:, 0] * 0.5 + 2 * 1.1 * normal_of(OBLIQUE)), ["--series", "0", "--region", "1:3,:,2:"])
    refused("DICOM", path, "2 series", "phantom", options=["--series", "7"])
    nested = folder / "nested"
    shutil.copytree(series("inside"), nested / "a/b")
    holds("DICOM", nested, CT, places())

    # Enhanced multi-frame, by hand after PS3.3 C.7.6.16, and segments by highdicom.
    def multiframe(name, syntax, order):
        data = pydicom.dcmread(next(iter(series(f"base-{name}").iterdir())))
        for tag in ["ImageOrientationPatient", "ImagePositionPatient", "PixelSpacing", "SliceThickness", "SpacingBetweenSlices", "ReferencedImageSequence"]:
            delattr(data, tag)
        data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2.1"
        item = lambda **fields: [setattr(d := Dataset(), k, v) or d for k, v in fields.items()][-1]
        measures = Dataset()
        measures.PixelSpacing, measures.SliceThickness = [SPACING[1], SPACING[0]], 5
        shared = Dataset()
        shared.PixelMeasuresSequence = Sequence([measures])
        shared.PlaneOrientationSequence = Sequence([item(ImageOrientationPatient=[float(f"{v:.9f}") for v in [*OBLIQUE[:, 0], *OBLIQUE[:, 1]]])])
        data.SharedFunctionalGroupsSequence = Sequence([shared])
        frames = []
        for z in order:
            one = Dataset()
            one.PlanePositionSequence = Sequence([item(ImagePositionPatient=[float(f"{v:.9f}") for v in ORIGIN + z * 1.1 * normal_of(OBLIQUE)])])
            transform = Dataset()
            transform.RescaleSlope, transform.RescaleIntercept, transform.RescaleType = 2, -10, "HU"
            one.PixelValueTransformationSequence = Sequence([transform])
            frames.append(one)
        data.PerFrameFunctionalGroupsSequence = Sequence(frames)
        data.NumberOfFrames = len(order)
        pixels = np.stack([CT[:, :, z].T for z in order])
        data.PixelData = pixels.astype("<i2").tobytes()
        data["PixelData"].VR = "OW"
        if syntax:
            data.compress(syntax, generate_instance_uid=False)
        path = folder / f"{name}.dcm"
        data.save_as(path, enforce_file_format=True)
        return path

    order = [3, 0, 8, 1, 7, 2, 6, 5, 4]
    for name, syntax in [("frames", None), ("frames-rle", RLELossless)]:
        path = multiframe(name, syntax, order)
        holds("DICOM", path, CT, places(), scaling=(2.0, -10.0))
        with open(path, "rb") as file:
            piped = subprocess.run([isolume, "info", "/dev/stdin", "--json"], stdin=file, capture_output=True, text=True)
        counts["DICOM"] += 1
        if piped.returncode or json.loads(piped.stdout)["dims"] != [5, 7, 9]:
            failures.append(f"{name} by a pipe: {piped.stderr}")
    refused("DICOM", multiframe("frames-gap", None, [0, 1, 3, 4]), "1 slices missing")
    import highdicom
    from highdicom.seg import SegmentAlgorithmTypeValues, SegmentationTypeValues, SegmentDescription
    from pydicom.sr.codedict import codes

    def identified(data, z):
        data.StudyInstanceUID, data.FrameOfReferenceUID, data.StudyID = "1.2.3", "1.2.4", "1"
        data.AccessionNumber = data.StudyDate = data.StudyTime = data.PatientBirthDate = data.PatientSex = ""
        data.ReferringPhysicianName = ""

    sources = [pydicom.dcmread(f) for f in sorted(series("source", edit=identified).iterdir())]
    sources.sort(key=lambda d: np.dot(normal_of(OBLIQUE), np.array(d.ImagePositionPatient, float)))
    masks = np.zeros((9, 7, 5, 2), "u1")
    masks[2:5, 1:4, 1:3, 0] = 1
    masks[4:8, 3:6, 2:5, 1] = 1
    describe = lambda n, label: SegmentDescription(n, label, codes.SCT.Organ, codes.SCT.Liver, SegmentAlgorithmTypeValues.MANUAL)
    segmentation = highdicom.seg.Segmentation(sources, masks, SegmentationTypeValues.BINARY, [describe(1, "liver"), describe(2, "spleen")], generate_uid(), 1,
                                              generate_uid(), 1, "m", "m", "1", "1", omit_empty_frames=True)
    path = folder / "segments.dcm"
    segmentation.save_as(path)
    used = [z for z in range(9) if masks[z].any()]
    for n, label in enumerate(["liver", "spleen"]):
        values = masks[used[0] : used[-1] + 1, :, :, n].transpose(2, 1, 0)
        holds("DICOM", path, values, places(origin=ORIGIN + used[0] * 1.1 * normal_of(OBLIQUE)), ["--channel", label])

    # Damage.
    good = series("good")
    victim = sorted(good.iterdir())[3]
    whole = victim.read_bytes()

    def damaged(bytes_, *words):
        victim.write_bytes(bytes_)
        refused("DICOM", good, *words)
        victim.write_bytes(whole)

    damaged(whole[:-3], victim.name)
    damaged(whole[:300], victim.name)
    at = whole.index(b"\x28\x00\x10\x00US")
    damaged(whole[: at + 8] + b"\xff\xff" + whole[at + 10 :], "")
    at = whole.index(b"\x20\x00\x0e\x00UI")
    damaged(whole[: at + 6] + b"\xff\xff" + whole[at + 8 :], "")
    holds("DICOM", good, CT, places())
    empty = folder / "empty.dcm"
    empty.write_bytes(b"")
    refused("DICOM", empty, "empty")
    colour = lambda data, z: setattr(data, "PhotometricInterpretation", "PALETTE COLOR")
    refused("DICOM", series("colour", edit=colour), "colour")
    nowhere = lambda data, z: delattr(data, "ImagePositionPatient")
    refused("DICOM", series("nowhere", edit=nowhere), "position")


def tiff_files():
    import uuid

    import tifffile

    zyx = np.ascontiguousarray(PHANTOM.transpose(2, 1, 0).astype("u2"))
    sizes = dict(PhysicalSizeX=0.5, PhysicalSizeY=0.7, PhysicalSizeZ=1.1)
    placed = affine_of(np.eye(3), origin=np.zeros(3))
    for big, packing in itertools.product([False, True], [None, "zlib", "lzw", "packbits"]):
        path = folder / f"plain-{big}-{packing}.ome.tif"
        tifffile.imwrite(path, zyx, bigtiff=big, compression=packing, metadata=dict(axes="ZYX", **sizes))
        holds("OME-TIFF", path, PHANTOM.astype("u2"), placed, metres=1e-6)
        holds("OME-TIFF", path, PHANTOM[1:4, :, 2:5].astype("u2"), affine_of(np.eye(3), origin=np.array([0.5, 0, 2.2])), ["--region", "1:4,:,2:5"])
    # Levels below each page, of 12 x 8 pixels so that halves are whole.
    x, y, z = np.meshgrid(np.arange(12), np.arange(8), np.arange(4), indexing="ij")
    wide = (100 * x + 10 * y + z).astype("u2")
    for big, axes in itertools.product([False, True], ["ZYX", "CZYX"]):
        path = folder / f"pyramid-{big}-{axes}.ome.tif"
        full = np.ascontiguousarray(wide.transpose(2, 1, 0))
        full = full if axes == "ZYX" else np.stack([full, full + 2000])
        with tifffile.TiffWriter(path, bigtiff=big) as file:
            file.write(full, subifds=2, photometric="minisblack", metadata=dict(axes=axes, **sizes))
            file.write(full[..., ::2, ::2], subfiletype=1, photometric="minisblack")
            file.write(full[..., ::4, ::4], subfiletype=1, photometric="minisblack")
        for level, channel in itertools.product(range(3), range(1 if axes == "ZYX" else 2)):
            step = 2**level
            options = ["--level", str(level)] + ([] if axes == "ZYX" else ["--channel", str(channel)])
            values = wide[::step, ::step] + 2000 * channel
            holds("OME-TIFF", path, values.astype("u2"), affine_of(np.eye(3), SPACING * [step, step, 1], np.zeros(3)), options)
        refused("OME-TIFF", path, "0 to 2", options=["--level", "3"])
    # A set of one file for each channel, as tifffile reads it, and with its description in a companion.
    both = [zyx, zyx + 1000]
    names = [f"set-{c}.ome.tif" for c in range(2)]
    ids = [f"urn:uuid:{uuid.uuid4()}" for _ in range(2)]
    blocks = "".join(f'<TiffData FirstZ="{z}" FirstC="{c}" FirstT="0" IFD="{z}" PlaneCount="1"><UUID FileName="{names[c]}">{ids[c]}</UUID></TiffData>'
                     for c in range(2) for z in range(9))
    pixels = ('<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="5" SizeY="7" SizeZ="9" SizeC="2" SizeT="1" '
              'PhysicalSizeX="0.5" PhysicalSizeY="0.7" PhysicalSizeZ="1.1"><Channel ID="Channel:0:0" Name="DAPI" SamplesPerPixel="1"/>'
              f'<Channel ID="Channel:0:1" Name="GFP" SamplesPerPixel="1"/>{blocks}</Pixels></Image>')
    head = '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="{}">{}</OME>'
    for c in range(2):
        tifffile.imwrite(folder / names[c], both[c], description=head.format(ids[c], pixels), metadata=None)
    assert np.array_equal(tifffile.imread(folder / names[0], is_ome=True), np.stack(both))
    for c, which in itertools.product(range(2), range(2)):
        holds("OME-TIFF", folder / names[which], (PHANTOM + 1000 * c).astype("u2"), placed, ["--channel", str(c)], metres=1e-6)
    (folder / names[1]).rename(folder / "elsewhere.tif")
    refused("OME-TIFF", folder / names[0], names[1], options=["--channel", "GFP"])
    holds("OME-TIFF", folder / names[0], PHANTOM.astype("u2"), placed, ["--channel", "DAPI"])
    for c in range(2):
        only = f'<BinaryOnly MetadataFile="set.companion.ome" UUID="{ids[c]}"/>'
        tifffile.imwrite(folder / names[c], both[c], description=head.format(ids[c], only), metadata=None)
    (folder / "set.companion.ome").write_text(head.format("urn:uuid:none", pixels))
    for c, name in itertools.product(range(2), [*names, "set.companion.ome"]):
        holds("OME-TIFF", folder / name, (PHANTOM + 1000 * c).astype("u2"), placed, ["--channel", str(c)], metres=1e-6)
    (folder / "set.companion.ome").unlink()
    refused("OME-TIFF", folder / names[0], "set.companion.ome")
    outside = head.format("urn:uuid:x", pixels.replace(names[1], "../" + names[1]))
    tifffile.imwrite(folder / "outside.ome.tif", zyx, description=outside, metadata=None)
    refused("OME-TIFF", folder / "outside.ome.tif", "--allow-outside", options=["--channel", "1"])

    # Folders of slices: with one of them missing between others.
    slices = folder / "slices"
    slices.mkdir()
    for z in range(9):
        if z != 4:
            tifffile.imwrite(slices / f"s{z}.tif", zyx[z], metadata=None)
    refused("slices", slices, "1 missing", "--allow-gaps")
    holds("slices", slices, PHANTOM.astype("u2"), affine_of(np.eye(3), np.ones(3), np.zeros(3)), ["--allow-gaps", "--spacing", "1,1,1"])


CHECKS = [vtk_files, itk_files, nibabel_files, nrrd_files, grid_files, numpy_files, tiff_files, zarr_files, dicom_files]
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
