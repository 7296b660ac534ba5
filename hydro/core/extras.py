"""Optional dependencies: the extra of the distribution that brings a package, and the error if it is missing.

`pip install deep-hydro-sim` brings what import, comparison, diagnosis, explanation, report and the MuJoCo
student need.  Networks and policies need torch and more, which is ten times as large.
"""

from __future__ import annotations

import importlib.util

from hydro.core.errors import UsageError

EXTRA_OF = {"torch": "learn", "torchrl": "rl", "tensordict": "rl", "gymnasium": "rl"}
"""Extra that brings an import package."""


class MissingExtraError(UsageError, ImportError):
    """Error: a package of an optional extra (`pip install 'deep-hydro-sim[EXTRA]'`) is not installed."""


def missing(package: str) -> MissingExtraError:
    """Return (not raise) the error that tells which extra to install for a missing package.

    Args:
        package: Import name of the package, a key of `EXTRA_OF`.
    """
    return MissingExtraError(
        f"{package} is not installed: install hydro's extra `{EXTRA_OF[package]}`: "
        f"pip install 'deep-hydro-sim[{EXTRA_OF[package]}]'"
    )


def require(*packages: str) -> None:
    """Check that import packages, keys of `EXTRA_OF`, are installed, without importing them.

    Raises:
        MissingExtraError: A package is not installed.
    """
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise missing(package)
