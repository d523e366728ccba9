"""Progress as users want it: a bar, or a call."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

Progress = Callable[[int, int, "float | None"], Any]


@contextmanager
def progress_of(wanted: bool | Progress | None):
    """The call that a bake makes now and then: done, total, seconds left."""
    if wanted is None or wanted is False:
        yield None
    elif wanted is not True:
        if not callable(wanted):
            raise TypeError(f"progress: given {wanted!r}, expected True or a function of done, total, seconds left")
        yield wanted
    else:
        try:
            from tqdm.auto import tqdm
        except ImportError:
            yield _told
            print(file=sys.stderr)
        else:
            with tqdm(desc="bake", unit=" texels", unit_scale=True) as bar:

                def tell(done: int, total: int, left: float | None) -> None:
                    bar.total = total
                    bar.update(done - bar.n)

                yield tell


def _told(done: int, total: int, left: float | None) -> None:
    rest = "" if left is None else f", {left:.0f} s left"
    print(f"\rbake: {100 * done / max(total, 1):.0f} %{rest}   ", end="", file=sys.stderr, flush=True)
