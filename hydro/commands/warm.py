"""Command `warm`: compile the physics before the first use."""

from __future__ import annotations

from hydro.commands.shell import message, progress


def warm() -> None:
    """Compile the physics for this machine, once after an installation.

    The first command that needs a part of the physics compiles it otherwise, and takes about 15 s longer than
    the next ones. The compiled code is kept in the user's cache folder, or in HYDRO_CACHE_DIR.

        hydro warm
    """
    from hydro.study.kernels import compile_kernels

    message("hydro: compiling the physics for this machine, about a minute of processor time")
    with progress("compile"):
        taken = compile_kernels()
    message(f"hydro: compiled in {taken:.0f} s")


COMMANDS = {warm: "hydro warm"}
