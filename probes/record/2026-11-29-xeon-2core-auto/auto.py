"""What `auto` chooses: the data volumes, signed, CT, noisy and label fields, and the negative of each.

    python auto.py DATA WORK [--pictures]

DATA: the folder of the data volumes; WORK: for the arrays and pictures. Writes WORK/auto.csv and WORK/auto.png. Needs numpy,
nibabel, pynrrd, Pillow, and `isolume` on the path.
"""
import csv, json, os, subprocess, sys
import nibabel, nrrd, numpy as np
from PIL import Image

data, work = sys.argv[1] + "/", sys.argv[2] + "/"
os.makedirs(work, exist_ok=True)


def ccp4(name):
    b = open(data + name, "rb").read()
    h = np.frombuffer(b[:1024], "<i4")
    return np.frombuffer(b[1024 + h[23]:], "<f4")[:h[:3].prod()].reshape(h[2::-1])


nifti = lambda name: nibabel.load(data + name).get_fdata().T.astype("i2")
volumes = {n: nifti(n + ".nii.gz") for n in ("mni152_t1", "mni152_t1_2mm")}
volumes |= {n: nrrd.read(data + n + ".nrrd")[0].T for n in ("purkinje_neuron", "caffeine_density", "nachr_m2_water")}
volumes |= {"rna_1jzv": ccp4("rna_1jzv.ccp4"), "emd_3197": ccp4("emd_3197.map")}
volumes["ironprot"] = np.frombuffer(open(data + "ironprot.vtk", "rb").read()[-68**3:], "u1").reshape(68, 68, 68).astype("i2")
# Made: lobes like an orbital, a CT of shells, a ball in coloured noise, labels.
g = np.mgrid[-1:1:64j, -1:1:64j, -1:1:64j]
r, rng = np.sqrt((g**2).sum(0)), np.random.default_rng(0)
volumes["lobes"] = (g[2] * np.exp(-6 * r)).astype("f4")
ct = np.where(r < .8, 40., -1000.)
ct[(r > .6) & (r < .7)] = 1000
volumes["ct"] = (ct + rng.normal(0, 20, ct.shape)).astype("i2")
k = np.fft.fftfreq(64)
low = (k[:, None, None]**2 + k[:, None]**2 + k**2) < .25**2
em = np.fft.ifftn(np.fft.fftn(rng.normal(size=r.shape)) * low).real
volumes["em"] = (em / em.std() + 5 * (r < .3)).astype("f4")
labels = np.zeros(r.shape, "i2")
labels[r < .7], labels[r < .5], labels[r < .3] = 3, 5, 9
volumes["labels"] = labels

rows, pictures = [], []
for name, volume in volumes.items():
    for sign in (1, -1):
        field = np.ascontiguousarray(sign * volume)
        path = f"{work}{'' if sign > 0 else 'minus_'}{name}"
        np.save(path + ".npy", field)
        info = subprocess.run(["isolume", "info", path + ".npy", "--json"], capture_output=True, text=True, check=True)
        found = json.loads(info.stdout)["suggested_isovalue"]
        above = found["solid"].startswith("above")
        solid = field > found["value"] if above else field < found["value"]
        inner = np.ones_like(solid)
        inner[1:-1, 1:-1, 1:-1] = False
        more = " ".join(f"{v:g}" for v in found["more"])
        rows.append([os.path.basename(path), f"{found['value']:.6g}", more, "above" if above else "below",
                     f"{solid.mean():.4f}", f"{solid[inner].mean():.4f}", found["reason"]])
        if "--pictures" in sys.argv:
            subprocess.run(["isolume", "relight", path + ".npy", "--isovalue", "auto", "--env", "studio", "--size", "240x180",
                            "--rays", "16", "--layers", "2", "--no-draft", "--cache", work + "cache", "-q", "-o",
                            path + ".png"], check=True, stdout=subprocess.DEVNULL)
            pictures.append(Image.open(path + ".png").convert("RGB").resize((160, 120), Image.LANCZOS))
with open(work + "auto.csv", "w") as out:
    table = csv.writer(out)
    table.writerow("volume isovalue more solid share_of_box share_of_border reason".split())
    table.writerows(rows)
if pictures:
    sheet = Image.new("RGB", (960, 480))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (160 * (i % 6), 120 * (i // 6)))
    sheet.quantize(128).save(work + "auto.png", optimize=True)
