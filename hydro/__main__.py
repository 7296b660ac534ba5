"""`python -m hydro` is `hydro`."""

import sys

from hydro.cli import main

if __name__ == "__main__":
    sys.exit(main())
