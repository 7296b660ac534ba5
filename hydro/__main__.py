"""`python -m hydro` is `hydro`."""

import sys


def main() -> int:
    """Run the `hydro` command line and return its exit code; it is 130 after Ctrl-C."""
    try:
        from hydro.cli import main as run

        return run()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
