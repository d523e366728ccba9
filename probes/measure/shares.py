"""How even the shares of a bake are: processor time of every task of n, and the largest over the mean.

    python probes/measure/shares.py ISOLUME OUT.csv VOLUME N[,N…] -- OPTIONS OF BAKE

Each share runs alone, on one thread, into one store; its time is user and system time by the operating system. What every task needs
whatever its share (reading, the mesh, the pyramid, hashing) is that of the last share run once more, when nothing is left of it.
"""
import csv
import os
import shutil
import subprocess
import sys
import tempfile


def seconds(command):
    """User and system seconds of a command."""
    before = os.times()
    run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    after = os.times()
    assert run.returncode == 0, run.stderr
    return after.children_user - before.children_user + after.children_system - before.children_system


def main():
    isolume, out, volume, counts = sys.argv[1:5]
    options = sys.argv[sys.argv.index("--") + 1:]
    rows = []
    for n in map(int, counts.split(",")):
        folder = tempfile.mkdtemp(prefix="isolume-shares-")
        store = os.path.join(folder, "x.isolume")
        task = lambda i: [isolume, "bake", "-q", volume, "-o", store, "--threads", "1", "--chunks", f"{i}/{n}"] + options
        times = [seconds(task(i)) for i in range(1, n + 1)]
        fixed = min(seconds(task(n)) for _ in range(3))
        work = [max(t - fixed, 0.0) for t in times]
        mean, mean_work = sum(times) / n, sum(work) / n
        rows.append([volume, " ".join(options), n, round(sum(times), 2), round(fixed, 2),
                     round(max(times) / mean, 3), round(max(work) / mean_work, 3), " ".join(f"{t:.2f}" for t in times)])
        print(rows[-1][:7], flush=True)
        shutil.rmtree(folder)
    header = ["volume", "options", "tasks", "seconds_all", "seconds_fixed", "max_over_mean", "max_over_mean_without_fixed", "seconds"]
    new = not os.path.exists(out)
    with open(out, "a", newline="") as file:
        writer = csv.writer(file)
        if new:
            writer.writerow(header)
        writer.writerows(rows)


if __name__ == "__main__":
    main()
