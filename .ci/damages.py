"""Damages random files of a store in random ways and looks at what the program makes of it.

usage: damages.py ISOLUME FOLDER SECONDS [SEED]

Of each damaged store the program may say what is wrong (exit 1, naming a file of the store), or give the same bytes as
of the sound one. Another exit code, a panic, and other bytes without a word are failures; the damage is printed.
"""

import pathlib, random, shutil, subprocess, sys, time

program, folder, seconds = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]), float(sys.argv[3])
seed = int(sys.argv[4]) if len(sys.argv) > 4 else int(time.strftime("%Y%m%d"))
numbers = random.Random(seed)
shutil.rmtree(folder, ignore_errors=True)
folder.mkdir(parents=True)


def run(*words):
    return subprocess.run([program, *words], cwd=folder, capture_output=True, text=True, errors="replace")


def damage(path):
    """Damages a file; what was done."""
    data = bytearray(path.read_bytes())
    kind = numbers.choice(["cut", "empty", "zero", "flip", "remove", "grow"])
    if kind == "remove":
        path.unlink()
        return kind
    at = numbers.randrange(len(data) + 1)
    if kind == "cut":
        del data[at:]
    elif kind == "empty":
        data.clear()
    elif kind == "zero":
        data[at : at + 256] = bytes(len(data[at : at + 256]))
    elif kind == "grow":
        data += numbers.randbytes(1 + at % 64)
    else:
        for _ in range(1 + numbers.randrange(8)):
            if data:
                data[numbers.randrange(len(data))] ^= 1 << numbers.randrange(8)
    path.write_bytes(data)
    return f"{kind} at {at}"


assert run("bake", "bumpbox:40", "--rays", "16", "--layers", "2", "-q", "-o", "sound").returncode == 0
relight = ("relight", "STORE", "-i", "47", "-e", "sunset", "-q", "-o", "out.ply")
export = ("export", "STORE", "-e", "sunset", "-q", "-o", "out.nrrd")


def result(command, store):
    out = folder / command[-1]
    out.unlink(missing_ok=True)
    done = run(*[store if word == "STORE" else word for word in command])
    return done, out.read_bytes() if out.exists() else None


expected = {command: result(command, "sound")[1] for command in (relight, export)}
assert all(expected.values())
files = sorted(p.relative_to(folder / "sound") for p in (folder / "sound").rglob("*") if p.is_file())
runs = refused = failures = 0
start = time.time()
while time.time() - start < seconds:
    shutil.rmtree(folder / "s", ignore_errors=True)
    shutil.copytree(folder / "sound", folder / "s")
    path = numbers.choice(files)
    what = damage(folder / "s" / path)
    for command in (relight, export):
        runs += 1
        done, found = result(command, "s")
        said = done.stderr + done.stdout
        refused += done.returncode == 1
        names_it = any(part in said for part in ("s/", "store", "chunk"))
        good = (done.returncode == 0 and found == expected[command]) or (done.returncode == 1 and names_it)
        if not good or "panicked" in said:
            failures += 1
            print(f"{path}: {what}: {command[0]} exit {done.returncode}, {said.strip()[-300:]}", flush=True)
    done = run("doctor", "s")
    if done.returncode not in (0, 1) or "panicked" in done.stderr:
        failures += 1
        print(f"{path}: {what}: doctor exit {done.returncode}, {done.stderr.strip()[-300:]}", flush=True)
print(f"seed {seed}: {runs} commands on damaged stores, {refused} refused, {failures} failures")
sys.exit(failures > 0)
