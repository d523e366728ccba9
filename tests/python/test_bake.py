"""Bakes from Python: goals, progress, interrupts, threads, and the same bytes as ever."""

import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import ENVIRONMENT, ISOVALUE, QUICK, phantom_of

import isolume

#: A bake that takes minutes, unless it is stopped.
LONG = dict(rays=4096, layers=2, bands=3)


def bytes_of(folder):
    files = sorted(p for p in pathlib.Path(folder).rglob("*") if p.is_file() and p.name != "lock")
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def test_three_lines(phantom):
    store = isolume.open(phantom).bake(ISOVALUE, **QUICK)
    surface = store.surface(ISOVALUE, "sunset")
    assert surface.rgb.shape == surface.points.shape and surface.rgb.std() > 5


def test_threads_do_not_change_bytes(tmp_path, phantom):
    for threads in (1, 2):
        isolume.open(phantom).bake(ISOVALUE, threads=threads, store=tmp_path / f"{threads}.isolume", **QUICK)
    assert bytes_of(tmp_path / "1.isolume") == bytes_of(tmp_path / "2.isolume")
    isolume.open(phantom).bake(ISOVALUE, seed=1, store=tmp_path / "3.isolume", **QUICK)
    assert bytes_of(tmp_path / "1.isolume") != bytes_of(tmp_path / "3.isolume")


def test_the_program_finds_the_same_store(tmp_path, phantom):
    np.save(tmp_path / "balls.npy", phantom)
    volume = isolume.open(tmp_path / "balls.npy")
    volume.bake(ISOVALUE, store=tmp_path / "a.isolume", **QUICK)
    line = ["bake", "-q", "balls.npy", "--isovalues", str(ISOVALUE), "-o", "b.isolume"]
    line += ["--rays", "16", "--layers", "2", "--bands", "3"]
    subprocess.run([sys.executable, "-m", "isolume", *line], cwd=tmp_path, check=True)
    a, b = bytes_of(tmp_path / "a.isolume"), bytes_of(tmp_path / "b.isolume")
    assert a.keys() == b.keys()
    assert [name for name in a if a[name] != b[name]] == []


def test_a_goal_is_reached_and_the_error_is_stated(tmp_path, phantom):
    store = isolume.open(phantom).bake(ISOVALUE, error=0.05, env="sky", bands=3, store=tmp_path / "goal.isolume")
    error = store.error("sky", ISOVALUE)
    assert 0 < error.noise <= 0.06
    assert error.rms is not None and 0 < error.rms < 0.5 and error.p95 >= error.rms / 2 and error.check_points > 0


def test_progress_is_told_and_its_exception_passes_through(tmp_path, phantom):
    told = []
    big = np.kron(phantom, np.ones((2, 2, 2), "f4"))
    isolume.open(big).bake(ISOVALUE, rays=64, bands=3, store=tmp_path / "p.isolume", progress=lambda *a: told.append(a))
    done, total, _ = told[-1]
    assert done == total > 0 and [d for d, _, _ in told] == sorted(d for d, _, _ in told)

    class Enough(Exception):
        pass

    def stop(done, total, left):
        raise Enough

    with pytest.raises(Enough):
        isolume.open(big).bake(ISOVALUE, store=tmp_path / "stopped.isolume", progress=stop, **LONG)
    with pytest.raises(TypeError, match="progress"):
        isolume.open(big).bake(ISOVALUE, progress=3)


def test_a_bar_is_shown(tmp_path, phantom, capfd):
    isolume.open(phantom).bake(ISOVALUE, store=tmp_path / "bar.isolume", progress=True, **QUICK)
    assert "bake" in capfd.readouterr().err


def test_an_interrupt_ends_a_bake_and_the_next_one_goes_on(tmp_path, phantom):
    # Where a shell starts the tests in the background, it has told them to ignore it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    big = np.kron(phantom, np.ones((4, 4, 4), "f4"))
    begun = threading.Event()

    def interrupt():
        begun.wait()
        os.kill(os.getpid(), signal.SIGINT)

    killer = threading.Thread(target=interrupt)
    killer.start()
    volume, place = isolume.open(big), tmp_path / "i.isolume"
    try:
        with pytest.raises(KeyboardInterrupt):
            volume.bake(ISOVALUE, store=place, progress=lambda *a: begun.set(), **LONG)
    finally:
        begun.set()
        killer.join()
        signal.signal(signal.SIGINT, before)
    # The lock is free, and what is there is sound.
    store = volume.bake(ISOVALUE, store=place, **QUICK)
    assert store.surface(ISOVALUE, ENVIRONMENT).radiance.mean() > 0


def test_other_threads_run_meanwhile(tmp_path, phantom):
    ticks, stop = [0], threading.Event()

    def tick():
        while not stop.is_set():
            ticks[0] += 1
            time.sleep(0)

    thread = threading.Thread(target=tick)
    thread.start()
    before = ticks[0]
    isolume.open(phantom).bake(ISOVALUE, rays=256, store=tmp_path / "t.isolume")
    during = ticks[0] - before
    stop.set()
    thread.join()
    assert during > 10


def test_two_bakes_at_a_time(tmp_path, phantom):
    stores = {}

    def bake(name):
        stores[name] = isolume.open(phantom).bake(ISOVALUE, store=tmp_path / f"{name}.isolume", **QUICK)

    threads = [threading.Thread(target=bake, args=(name,)) for name in "ab"]
    [t.start() for t in threads]
    [t.join() for t in threads]
    assert bytes_of(stores["a"].path) == bytes_of(stores["b"].path)


SCRIPT = """
import multiprocessing, sys
sys.path.insert(0, {tests!r})
from conftest import phantom_of, QUICK, ISOVALUE
import isolume

def light(number):
    store = isolume.open(phantom_of()).bake(ISOVALUE, store={folder!r} + f"/{{number}}.isolume", **QUICK)
    return float(store.surface(ISOVALUE).radiance.sum())

if __name__ == "__main__":
    first = light(0)
    with multiprocessing.get_context({method!r}).Pool(2) as pool:
        assert pool.map(light, [1, 2]) == [first, first]
    print("the same")
"""


@pytest.mark.parametrize("method", ["spawn", "fork"])
@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
def test_processes_of_multiprocessing(tmp_path, method):
    script = tmp_path / "pool.py"
    script.write_text(SCRIPT.format(tests=os.path.dirname(__file__), folder=str(tmp_path), method=method))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=600)
    assert done.stdout == "the same\n", done.stderr


def test_what_a_store_lacks_is_baked_into_it(tmp_path, phantom):
    volume = isolume.open(phantom)
    store = volume.bake(ISOVALUE, store=tmp_path / "grows.isolume", **QUICK)
    higher = store.surface(1.0, ENVIRONMENT)
    assert store.isovalues == [ISOVALUE, 1.0]
    alone = volume.bake(1.0, store=tmp_path / "alone.isolume", **QUICK).surface(1.0, ENVIRONMENT)
    np.testing.assert_array_equal(higher.radiance, alone.radiance)
    # A store that is opened by its path has its volume in it.
    again = isolume.open(tmp_path / "grows.isolume")
    np.testing.assert_array_equal(again.surface(1.0, ENVIRONMENT).radiance, higher.radiance)
    assert len(again.surface(1.2, ENVIRONMENT).points) > 0 and again.isovalues == [ISOVALUE, 1.0, 1.2]


def test_the_cache_is_found_again(tmp_path, phantom):
    first = isolume.open(phantom).bake(ISOVALUE, cache=tmp_path / "own", **QUICK)
    second = isolume.open(phantom).bake(ISOVALUE, cache=tmp_path / "own", **QUICK)
    assert first.path == second.path and str(tmp_path / "own") in first.path


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (dict(rays=3), "rays"),
        (dict(error=0), "error"),
        (dict(error=float("nan")), "error"),
        (dict(time=-1), "seconds"),
        (dict(layers=0), "bands"),
        (dict(texture=float("nan")), "texture"),
        (dict(estimator="guess"), "estimator"),
        (dict(isovalues=[]), "isovalues"),
        (dict(isovalues=99), "isovalue"),
        (dict(isovalues="much"), "isovalue"),
        (dict(env="no-such-light"), "environment"),
    ],
)
def test_what_no_bake_can_do_is_refused_and_leaves_no_store(tmp_path, phantom, options, name):
    place = tmp_path / "x.isolume"
    arguments = dict(isovalues=ISOVALUE, store=place) | options
    with pytest.raises(isolume.Error) as refused:
        isolume.open(phantom).bake(**arguments)
    assert refused.value.name == name and refused.value.kind == "argument" and not place.exists()
    with pytest.raises(TypeError):
        isolume.open(phantom).bake(isovalues=[None])
    with pytest.raises(isolume.Error) as refused:
        isolume.open(phantom).bake(ISOVALUE, store=place, memory_limit=1000)
    assert refused.value.kind == "limit" and refused.value.expected == "1000 bytes"


def test_errors_have_parts_and_can_be_pickled(tmp_path):
    import pickle

    (tmp_path / "bad.nrrd").write_bytes(b"NRRD0004\ntype: float\n\n")
    with pytest.raises(isolume.Error) as refused:
        isolume.open(tmp_path / "bad.nrrd")
    error = refused.value
    assert error.kind == "format" and "bad.nrrd" in error.path and error.given and error.expected and error.remedy
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) and again.path == error.path
    with pytest.raises(isolume.Error, match="did you mean|exists"):
        isolume.open(tmp_path / "bad.nrd")
    with pytest.raises(isolume.Error) as refused:
        isolume.open(tmp_path / "none.isolume")
    assert "none.isolume" in str(refused.value)


def test_scenes_and_coupled_volumes(tmp_path):
    scenes = pathlib.Path(__file__).parents[2] / "examples/scenes"
    pair = isolume.open(scenes / "pair.toml")
    assert len(pair.names) == 2
    store = pair.bake(47, rays=4, layers=1, bands=2, store=tmp_path / "pair.isolume")
    surface = store.surface(47, "sky")
    assert len(surface.isovalues) == 2 and len(store.volumes) == 2
    assert len(surface.points) == len(surface.radiance) == surface.faces.max() + 1
    assert surface.transfer.shape == (len(surface.points), 1, 3, 4)
    box = isolume.open(scenes / "box.toml").bake("40%", rays=4, layers=1, bands=2, store=tmp_path / "box.isolume")
    dim = box.surface("40%", "constant:0", exposure=0).radiance
    bright = box.surface("40%", "constant:0", exposure=0, luminaires={"ceiling": 2}).radiance
    np.testing.assert_allclose(bright, 2 * dim, rtol=1e-3, atol=1e-6)
    with pytest.raises(isolume.Error) as refused:
        box.surface("40%", "sky", luminaires={"cieling": 2})
    assert "ceiling" in refused.value.remedy
