"""The program: ``python -m isolume``, and the command ``isolume`` that the package installs."""

from __future__ import annotations

import sys

from . import _isolume


def main() -> int:
    """Runs the program with the arguments of the process."""
    return _isolume.main(["isolume", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
