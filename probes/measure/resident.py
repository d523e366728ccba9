#!/usr/bin/env python3
"""Largest private and file-backed memory of a command, sampled every 5 ms: resident.py COMMAND...; and volumes to measure with:
resident.py --gyroid N TYPE OUT.raw PERIODS [RADIUS] writes a gyroid (with RADIUS in a shell alone) and its sidecar OUT.json."""
import json
import resource
import subprocess
import sys
import time


def gyroid(n, kind, out, periods, radius=None):
    import numpy as np

    a = (np.arange(n, dtype=np.float32) + 0.5) / n * 2 * np.pi * periods
    u = (np.arange(n, dtype=np.float32) + 0.5) / n * 2 - 1
    s, c, top = np.sin(a), np.cos(a), {"uint8": 255, "uint16": 65535, "float32": 1}[kind]
    with open(out, "wb") as file:
        for k in range(n):
            v = (s[None, :] * c[:, None] + s[:, None] * c[k] + s[k] * c[None, :]) / 3 * 0.5 + 0.5
            if radius is not None:
                r = np.sqrt(u[None, :] ** 2 + u[:, None] ** 2 + u[k] ** 2)
                v = np.where((r > radius) & (r < radius + 0.12), v, 0)
            file.write((v * top).astype(kind).tobytes())
    with open(out.rsplit(".", 1)[0] + ".json", "w") as file:
        json.dump({"dims": [n] * 3, "type": kind, "data": out.rsplit("/", 1)[-1]}, file)


def watch(command):
    process, start, peak = subprocess.Popen(command), time.time(), {}
    while process.poll() is None:
        try:
            with open(f"/proc/{process.pid}/status") as status:
                for line in status:
                    key, _, value = line.partition(":")
                    if key in ("RssAnon", "RssFile", "VmRSS"):
                        peak[key] = max(peak.get(key, 0), int(value.split()[0]) * 1024 / 1e6)
        except OSError:
            pass
        time.sleep(0.005)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print({key: f"{value:.1f} MB" for key, value in peak.items()}, f"{time.time() - start:.1f} s, user {used.ru_utime:.1f} s,",
          f"exit {process.returncode}", file=sys.stderr)


if sys.argv[1:2] == ["--gyroid"]:
    n, kind, out, periods, *radius = sys.argv[2:]
    gyroid(int(n), kind, out, float(periods), *map(float, radius))
else:
    watch(sys.argv[1:])
