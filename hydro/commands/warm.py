"""Command `warm`: compile the physics before the first use."""

from __future__ import annotations

from hydro.commands.shell import message


def warm() -> None:
    """Compile the physics for this machine, once after an installation.

    The first command that needs a part of the physics compiles it otherwise, and takes a minute longer than
    the next ones. The compiled code is kept in the user's cache folder, or in HYDRO_CACHE_DIR.

        hydro warm
    """
    from hydro.study.kernels import compile_kernels

    message("hydro: compiling the physics for this machine, about two minutes of processor time")
    message(f"hydro: compiled in {compile_kernels():.0f} s")


COMMANDS = {warm: "hydro warm"}
