"""Seeds of fuzzing that other programs write: zarr-python, pydicom, tifffile and VTK.

    python tests/fuzz/corpus.py

A folder is one file here: for each of its files the name, a zero, the length in four bytes (little-endian), the bytes.
"""

import pathlib
import struct
import tempfile

import imagecodecs
import numcodecs
import numpy as np
import pydicom
import tifffile
import vtk
import zarr
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.sequence import Sequence
from vtk.util.numpy_support import numpy_to_vtk
from zarr.codecs import BloscCodec, Crc32cCodec, GzipCodec, ZstdCodec

root = pathlib.Path(__file__).parent / "corpus"
z, y, x = np.meshgrid(np.arange(3), np.arange(4), np.arange(5), indexing="ij")
phantom = (100 * x + 10 * y + z).astype("u2")


def folder(target, name, make):
    with tempfile.TemporaryDirectory() as path:
        path = pathlib.Path(path)
        make(path)
        out = b""
        for file in sorted(p for p in path.rglob("*") if p.is_file()):
            bytes_ = file.read_bytes()
            out += str(file.relative_to(path)).encode() + b"\0" + struct.pack("<I", len(bytes_)) + bytes_
        (root / target).mkdir(exist_ok=True)
        (root / target / name).write_bytes(out)


def array(**how):
    return lambda path: zarr.create_array(str(path), data=phantom, overwrite=True, **how)


for name, how in {
    "v2-blosc-lz4": dict(zarr_format=2, chunks=(2, 4, 5), compressors=numcodecs.Blosc("lz4", shuffle=1)),
    "v2-blosclz": dict(zarr_format=2, chunks=(3, 4, 5), compressors=numcodecs.Blosc("blosclz", shuffle=2)),
    "v2-zlib": dict(zarr_format=2, chunks=(3, 2, 5), order="F", compressors=numcodecs.Zlib()),
    "v2-lz4": dict(zarr_format=2, chunks=(3, 4, 5), compressors=numcodecs.LZ4(), filters=[numcodecs.Shuffle(2)]),
    "v3-shards": dict(chunks=(1, 2, 5), shards=(2, 4, 5), compressors=[ZstdCodec(), Crc32cCodec()]),
    "v3-gzip": dict(chunks=(3, 4, 5), compressors=GzipCodec()),
    "v3-blosc-zstd": dict(chunks=(3, 4, 5), compressors=BloscCodec(cname="zstd")),
}.items():
    folder("zarr", name, array(**how))


def ome(path):
    group = zarr.open_group(str(path), mode="w", zarr_format=3)
    axes = [{"name": "c", "type": "channel"}] + [{"name": a, "type": "space", "unit": "micrometer"} for a in "zyx"]
    levels = []
    for level in range(2):
        group.create_array(str(level), data=np.stack([phantom[:, :: 1 + level, :: 1 + level]]), chunks=(1, 2, 2, 2))
        scale = {"type": "scale", "scale": [1, 1, 1 + level, 1 + level]}
        levels.append({"path": str(level), "coordinateTransformations": [scale, {"type": "translation", "translation": [0, 0, level / 2, level / 2]}]})
    group.attrs["ome"] = {"version": "0.5", "multiscales": [{"axes": axes, "datasets": levels}], "omero": {"channels": [{"label": "DAPI"}]}}


folder("zarr", "ome", ome)


def series(pack=None, syntax="1.2.840.10008.1.2.1", frames=False, kind="<i2", side=None):
    """Three slices of 5 x 4 samples, or as many frames of one file."""

    def make(path):
        volume = np.kron(phantom, np.ones((1, side, side), "u2")) if side else phantom
        for n in range(1 if frames else 3):
            data = Dataset()
            data.file_meta = FileMetaDataset()
            data.file_meta.TransferSyntaxUID = syntax
            data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2"
            data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = f"1.2.{n + 1}"
            data.Modality, data.SeriesInstanceUID, data.SeriesNumber = "CT", "1.2.9", 1
            placed = [Dataset() for _ in range(3)]
            for k, one in enumerate(placed):
                one.ImagePositionPatient = [1, 2, k * 1.5]
            measures, turned, values = data, data, data
            if frames:
                measures, turned, values, shared = Dataset(), Dataset(), Dataset(), Dataset()
                shared.PixelMeasuresSequence, shared.PlaneOrientationSequence = Sequence([measures]), Sequence([turned])
                shared.PixelValueTransformationSequence = Sequence([values])
                data.SharedFunctionalGroupsSequence = Sequence([shared])
                groups = []
                for one in placed:
                    group = Dataset()
                    group.PlanePositionSequence = Sequence([one])
                    groups.append(group)
                data.PerFrameFunctionalGroupsSequence = Sequence(groups)
                data.NumberOfFrames = 3
            else:
                data.ImagePositionPatient = placed[n].ImagePositionPatient
            measures.PixelSpacing, turned.ImageOrientationPatient = [0.7, 0.5], [1, 0, 0, 0, 1, 0]
            values.RescaleSlope, values.RescaleIntercept = 1, -1024 + (n if pack is None else 0)
            data.Rows, data.Columns, data.SamplesPerPixel, data.PhotometricInterpretation = *volume.shape[1:], 1, "MONOCHROME2"
            bits = 8 * np.dtype(kind).itemsize
            data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = bits, bits, bits - 1, int("i" in kind)
            sections = [volume[k].astype(kind) for k in (range(3) if frames else [n])]
            if pack:
                data.PixelData = encapsulate([pack(section) for section in sections])
                data["PixelData"].VR, data["PixelData"].is_undefined_length = "OB", True
            else:
                data.add_new(0x00280120, "SS", -7)
                data.PixelData = b"".join(section.tobytes() for section in sections)
                data["PixelData"].VR = "OW"
            data.save_as(path / f"{n}.dcm", enforce_file_format=True)

    return make


def run_lengths(section):
    from pydicom.pixels.encoders import RLELosslessEncoder

    return RLELosslessEncoder.encode(section, encoding_plugin="pydicom", rows=section.shape[0], columns=section.shape[1], samples_per_pixel=1,
                                     bits_allocated=16, bits_stored=16, pixel_representation=1, photometric_interpretation="MONOCHROME2", number_of_frames=1)


folder("dicom", "explicit", series())
folder("dicom", "implicit", series(syntax="1.2.840.10008.1.2"))
folder("dicom", "big", series(syntax="1.2.840.10008.1.2.2", kind=">i2"))
folder("dicom", "deflated", series(syntax="1.2.840.10008.1.2.1.99"))
folder("dicom", "frames", series(frames=True))
folder("dicom", "rle", series(run_lengths, "1.2.840.10008.1.2.5"))
folder("dicom", "jpeg", series(lambda s: imagecodecs.jpeg_encode(s), "1.2.840.10008.1.2.4.50", kind="u1"))
folder("dicom", "jpeg-lossless", series(lambda s: imagecodecs.jpeg_encode(s, lossless=True, predictor=1, bitspersample=12), "1.2.840.10008.1.2.4.70", kind="<u2"))
folder("dicom", "jpeg-2000", series(lambda s: imagecodecs.jpeg2k_encode(s, codecformat="j2k", reversible=True, resolutions=2), "1.2.840.10008.1.2.4.90", kind="<u2", side=4))

with tifffile.TiffWriter(root / "tiff/pyramid.ome.tif") as file:
    file.write(phantom, subifds=1, photometric="minisblack", metadata=dict(axes="ZYX", PhysicalSizeX=0.5, PhysicalSizeY=0.5))
    file.write(phantom[:, ::2, ::2], subfiletype=1, photometric="minisblack")

image = vtk.vtkImageData()
image.SetDimensions(5, 4, 3)
samples = numpy_to_vtk(phantom.ravel(), deep=True)
samples.SetName("value")
image.GetPointData().SetScalars(samples)
writer = vtk.vtkXMLImageDataWriter()
writer.SetInputData(image)
writer.SetFileName(str(root / "vti/lzma.vti"))
writer.SetCompressorTypeToLZMA()
assert writer.Write()
