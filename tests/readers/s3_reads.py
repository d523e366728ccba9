"""Stores in object storage: uploaded as they lie to a server of the S3 protocol on loopback (moto), opened there by zarr-python, and
read region by region. Each region has the bytes that the store on disk has, and takes no object but the chunks that it touches.

python s3_reads.py ISOLUME
Needs zarr, s3fs, boto3 and moto[server].
"""

import logging
import pathlib
import subprocess
import sys
import tempfile
import threading

import boto3
import numpy
import zarr
from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

BUCKET = "stores"
KEYS = {"aws_access_key_id": "key", "aws_secret_access_key": "secret"}


class Requests:
    """The server, and the names of the objects that it was asked for."""

    def __init__(self):
        self.names = []
        self.app = DomainDispatcherApplication(create_backend_app)

    def __call__(self, environ, start_response):
        if environ["REQUEST_METHOD"] == "GET":
            self.names.append(environ["PATH_INFO"].removeprefix(f"/{BUCKET}/"))
        return self.app(environ, start_response)


def arrays_of(group, place=""):
    for name, member in sorted(group.members()):
        path = f"{place}/{name}".lstrip("/")
        if isinstance(member, zarr.Array):
            yield path, member
        else:
            yield from arrays_of(member, path)


def regions(array):
    """Slices of one chunk each, all of them up to 64, then every so many."""
    per_axis = [range(0, length, step) for length, step in zip(array.shape, array.chunks)]
    starts = numpy.stack(numpy.meshgrid(*per_axis, indexing="ij"), -1).reshape(-1, len(array.shape))
    for start in starts[:: max(1, len(starts) // 64)]:
        yield tuple(slice(s, min(s + c, n)) for s, c, n in zip(start.tolist(), array.chunks, array.shape))


def same(a, b):
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def check(folder, endpoint, requests):
    client = boto3.client("s3", endpoint_url=endpoint, region_name="us-east-1", **KEYS)
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    for path in files:
        client.upload_file(str(path), BUCKET, f"{folder.name}/{path.relative_to(folder)}")
    options = {"endpoint_url": endpoint, "key": "key", "secret": "secret"}
    there = zarr.open_group(f"s3://{BUCKET}/{folder.name}", mode="r", storage_options=options)
    here = zarr.open_group(str(folder), mode="r")
    assert dict(there.attrs) == dict(here.attrs)
    local, read, asked = dict(arrays_of(here)), 0, 0
    remote = dict(arrays_of(there))
    assert local.keys() == remote.keys() and local, "the same arrays"
    for path, array in remote.items():
        for region in regions(array):
            requests.names.clear()
            found = array[region]
            chunks = {name for name in requests.names if "/c/" in name or name.endswith("/c")}
            # What was never baked has no object: it is asked for, and not there.
            assert len(chunks) <= 1, f"{path} {region}: {sorted(chunks)}"
            assert all(name.startswith(f"{folder.name}/{path}/") for name in chunks), (path, chunks)
            assert same(found, local[path][region]), f"{path} {region}"
            read, asked = read + 1, asked + len(chunks)
    assert asked > len(remote), "the server tells of requests"
    print(f"{folder.name}: {len(files)} objects, {len(remote)} arrays, {read} regions, each of at most one object")


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    requests = Requests()
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = make_server("127.0.0.1", 0, requests, threaded=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        endpoint = f"http://127.0.0.1:{server.server_port}"
        boto3.client("s3", endpoint_url=endpoint, region_name="us-east-1", **KEYS).create_bucket(Bucket=BUCKET)
        with tempfile.TemporaryDirectory() as folder:
            def run(*words):
                subprocess.run([program, *words, "-q"], cwd=folder, check=True)

            run("bake", "bumpbox:40", "--rays", "16", "--texture", "1", "-o", "all.isolume")
            run("bake", "gyroid:24", "--isovalues", "0", "--rays", "16", "-o", "surface.isolume")
            run("pack", "all.isolume", "-o", "packed.isolume", "--error", "1%")
            for name in ["all", "surface", "packed"]:
                check(pathlib.Path(folder) / f"{name}.isolume", endpoint, requests)
    finally:
        server.shutdown()


if __name__ == "__main__":
    main()
