"""`python -m hydro` is `hydro`."""

import sys


def main() -> int:
    """Run the command line; interrupted while its modules are still being loaded, it ends as quietly."""
    try:
        from hydro.cli import main as run

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
