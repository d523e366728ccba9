"""Two programs in alternating pairs: bake, relight and its contraction; the ratio of their times with its upper 95 % bound.

    python3 probes/measure/pairs.py BEFORE AFTER FOLDER [PAIRS]

BEFORE and AFTER are two builds of isolume, FOLDER is for what they write. The bound is that of a t-interval of the mean of the
logarithms of the ratios, one-sided.
"""

import json
import math
import os
import shutil
import subprocess
import sys
import time

BEFORE, AFTER, FOLDER = sys.argv[1:4]
PAIRS = int(sys.argv[4]) if len(sys.argv) > 4 else 15
EXAMPLES = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "examples")
BRAIN = os.path.join(EXAMPLES, "data", "mni152_t1_2mm.nii.gz")
BOX = os.path.join(EXAMPLES, "scenes", "box.toml")
# One-sided 95 % of Student's t by degrees of freedom.
STUDENT = {4: 2.132, 9: 1.833, 14: 1.761, 19: 1.729, 29: 1.699}


def run(words):
    start = time.perf_counter()
    done = subprocess.run(words, capture_output=True, text=True)
    seconds = time.perf_counter() - start
    if done.returncode != 0:
        sys.exit(f"{words}: {done.stderr}")
    return seconds, done.stdout


def path(name):
    return os.path.join(FOLDER, name)


def bake(program, source, store, *options):
    shutil.rmtree(path(store), ignore_errors=True)
    return run([program, "-q", "bake", source, *options, "-o", path(store), "--no-sync"])[0]


def relight(program, store, isovalue, step=None):
    line = [program, "--json", "relight", path(store), "--isovalue", isovalue, "--env", "courtyard", "-o", path("x.glb")]
    seconds, output = run(line)
    return seconds if step is None else json.loads(output)["files"][0]["seconds"][step]


def pairs(name, measure):
    measure(BEFORE), measure(AFTER)
    found = []
    for i in range(PAIRS):
        both = {program: measure(program) for program in ([BEFORE, AFTER] if i % 2 == 0 else [AFTER, BEFORE])}
        found.append((both[BEFORE], both[AFTER]))
    logs = [math.log(after / before) for before, after in found]
    mean = sum(logs) / len(logs)
    error = math.sqrt(sum((x - mean) ** 2 for x in logs) / (len(logs) - 1) / len(logs))
    bound = math.exp(mean + STUDENT.get(len(logs) - 1, 1.8) * error)
    medians = [sorted(times)[len(times) // 2] for times in zip(*found)]
    print(f"{name}: ratio {math.exp(mean):.4f}, at most {bound:.4f}; medians {medians[0]:.4f} s, {medians[1]:.4f} s", flush=True)


os.makedirs(FOLDER, exist_ok=True)
pairs("bake of the brain at 90, 64 rays", lambda p: bake(p, BRAIN, "m.isolume", "--isovalues", "90", "--rays", "64"))
pairs("bake of box.toml, 16 rays", lambda p: bake(p, BOX, "b.isolume", "--rays", "16"))
bake(BEFORE, BRAIN, "r.isolume", "--isovalues", "90,160", "--rays", "16")
pairs("relight of the brain at 90", lambda p: relight(p, "r.isolume", "90"))
pairs("its contraction", lambda p: relight(p, "r.isolume", "90", "contract"))
bake(BEFORE, BOX, "s.isolume", "--rays", "16")
pairs("relight of box.toml at 47", lambda p: relight(p, "s.isolume", "47"))
pairs("its contraction", lambda p: relight(p, "s.isolume", "47", "contract"))
