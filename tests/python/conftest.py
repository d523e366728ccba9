"""What the tests have in common: an asymmetric phantom, and a small store of it."""

import numpy as np
import pytest

import isolume

#: A bake that takes a moment.
QUICK = dict(rays=16, layers=2, bands=3)
ISOVALUE = 0.5
ENVIRONMENT = "sun:30,50,40"


def phantom_of(shape=(14, 12, 10), fineness=1):
    """Four balls of different sizes along the axes: no permutation or mirror of the axes maps it onto itself."""
    z, y, x = np.meshgrid(*[np.arange(n, dtype=np.float32) / fineness for n in shape], indexing="ij")

    def ball(at, radius):
        return radius - np.sqrt((x - at[0]) ** 2 + (y - at[1]) ** 2 + (z - at[2]) ** 2)

    balls = [ball((3, 4, 4), 2.6), ball((6.5, 4, 4.2), 1.7), ball((3.1, 8.5, 4), 2.2), ball((3, 4, 10), 1.4)]
    return (np.maximum.reduce(balls) + ISOVALUE).astype(np.float32)


@pytest.fixture
def phantom():
    return phantom_of()


@pytest.fixture(scope="session")
def store(tmp_path_factory):
    volume = isolume.open(phantom_of(), spacing=(1.0, 1.5, 2.0), origin=(10, 20, 30), unit="mm", name="balls")
    return volume.bake(ISOVALUE, store=tmp_path_factory.mktemp("store") / "balls.isolume", **QUICK)


@pytest.fixture(scope="session")
def surface(store):
    return store.surface(ISOVALUE, ENVIRONMENT)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """No test looks into, or fills, the cache of who runs it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
