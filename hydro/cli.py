"""Root of the command line: registers the commands and converts errors to exit codes.

0 done; 1 fault of the data or a file; 2 wrong usage; 3 bug in hydro, or a new change that `hydro track`
found; 130 interrupted.  One line on stderr gives the problem, its place and the remedy; tracebacks appear
only with `--debug`.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from hydro.commands import (
    app as workbench,
)
from hydro.commands import (
    collect,
    companion,
    compare,
    data,
    demo,
    diagnose,
    diff,
    explain,
    export,
    files,
    fit,
    imports,
    interrupts,
    models,
    partition,
    physics,
    places,
    replay,
    report,
    rl,
    serve,
    start,
    streams,
    study,
    track,
    vehicle,
    warm,
)
from hydro.commands import help as help_

HELP = """Find the physics that an underwater vehicle model lacks, and simulate it.

\b
  hydro demo
  hydro start dive.bag
  hydro explain vehicle.toml dive.bag --map map.toml -o study
"""

SECTIONS: dict[str, tuple[ModuleType, ...]] = {
    "Start": (start, workbench, demo, warm),
    "Compare and diagnose": (explain, diagnose, track, compare, fit, report),
    "Data": (imports, files, partition, collect, companion),
    "Vehicle files and simulation": (vehicle, physics, diff, export, serve),
    "Networks and policies": (data, models, replay, study, rl),
}
"""Modules of commands by section of `hydro --help`.  `COMMANDS` of a module has its functions, each with an
example that runs.  A module with `NAME` and `HELP` is a group of commands under one name."""

GROUPS = tuple(one for modules in SECTIONS.values() for one in modules if not hasattr(one, "NAME"))
"""Modules whose commands are directly under `hydro`."""

FAMILIES = tuple(one for modules in SECTIONS.values() for one in modules if hasattr(one, "NAME"))
"""Modules whose commands are in a group, such as `hydro rl`."""


class Sectioned(help_.Pasted, TyperGroup):
    """Group of commands whose help lists them by section, with the summaries in one column."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the list of commands to `formatter`, in the place of the options.

        Args:
            ctx: Click's context of the parser.
            formatter: Click's formatter of the help text, changed in place.
        """
        self.format_commands(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the name and the summary of every command to `formatter`, under the title of its section.

        Args:
            ctx: Click's context of the parser.
            formatter: Click's formatter of the help text, changed in place.
        """
        width = max(map(len, self.commands))
        rows: dict[str, list[tuple[str, str]]] = {title: [] for title in SECTIONS}
        for name, command in self.commands.items():
            section: str = getattr(command, "rich_help_panel", "")
            rows[section].append((name.ljust(width), command.get_short_help_str()))
        for title, listed in rows.items():
            with formatter.section(title):
                formatter.write_dl(listed)


app = typer.Typer(
    name="hydro",
    cls=Sectioned,
    help=HELP,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"], "max_content_width": 100},
    epilog="Options: --version, --debug, --install-completion, COMMAND --help.",
)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"hydro {version('deep-hydro-sim')}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error; works after a command, too.")
    ] = False,
) -> None:
    """Accept the options before any command."""


def _register(home: typer.Typer, commands: Mapping[Callable[..., None], str], section: str) -> None:
    """Add functions as commands; a trailing underscore, as in `eval_`, is not part of the name."""
    for command, example in commands.items():
        summary = (command.__doc__ or "").partition("\n")[0]
        name = command.__name__.removesuffix("_")
        text = help_.example(example)
        home.command(name, cls=help_.Screen, short_help=summary, epilog=text, rich_help_panel=section)(
            places.checked(command)
        )


for title, modules in SECTIONS.items():
    for module in modules:
        if module in GROUPS:
            _register(app, module.COMMANDS, title)
        else:
            branch = typer.Typer(rich_markup_mode=None, help=module.HELP, no_args_is_help=True)
            _register(branch, module.COMMANDS, title)
            app.add_typer(branch, name=module.NAME, short_help=module.HELP, rich_help_panel=title)


def main(arguments: list[str] | None = None) -> int:
    """Run one command line, print a one-line message for an error, and return the exit code.

    Args:
        arguments: Words after `hydro`; by default those of the process.
    """
    streams.replace_closed()
    with streams.messages_may_be_lost(), streams.warnings_in_one_line(), interrupts.noted():
        return _main(arguments)


def _main(arguments: list[str] | None) -> int:
    arguments = sys.argv[1:] if arguments is None else arguments
    debug = "--debug" in arguments
    if not {"train", "demo"} & set(arguments):
        # hydro's own threads share the work by shots, windows or vehicles, on matrices of a few dozen rows.
        # BLAS threads in addition only wait for each other.  On two busy cores, a diagnosis of one minute
        # took 34 s of processor time with one BLAS thread; with two it had not finished after 168 s.  NumPy
        # reads the variable when it is first imported.  Only training has matrices large enough for BLAS
        # threads.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    arguments = [argument for argument in arguments if argument != "--debug"] or ["--help"]
    try:
        from hydro.core.threads import require_numbers

        require_numbers()  # numba raises on its import otherwise
        code = _run(arguments)
        sys.stdout.flush()
        return code
    except BaseException as error:
        if debug and isinstance(error, Exception):
            import traceback

            traceback.print_exc()
        return _exit_code(error)


@functools.cache
def _parser() -> Any:
    """Build the parser of all commands, once per process, because that takes longer than many a command."""
    return get_command(app)


def _run(arguments: list[str]) -> int:
    """Run the Typer application; return the exit code, also after `raise typer.Exit`."""
    code = _parser()(arguments, prog_name="hydro", standalone_mode=False)
    return code if isinstance(code, int) else 0


def _exit_code(error: BaseException) -> int:
    """Report an error in one line on stderr and return the exit code."""
    from hydro.core.errors import HydroError

    if isinstance(error, BrokenPipeError) or isinstance(error.__context__, BrokenPipeError):
        streams.leave()  # the reader of the pipe has closed, which Click turns into SystemExit(1)
        return 0
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 1
    if isinstance(error, KeyboardInterrupt) or interrupts.seen():
        return 130
    if isinstance(error, HydroError):
        return _report(str(error), error.exit_code)
    if type(error).__name__ == "NoArgsIsHelpError":  # group without a command: print its help
        print(str(error), file=sys.stderr)
        return 2
    if (usage := _usage_message(error)) is not None:
        return _report(usage, 2)
    if isinstance(error, OSError) and error.filename is not None:
        return _report(f"{error.filename}: {(error.strerror or str(error)).lower()}", 1)
    if isinstance(error, OSError) and error.errno is not None:
        streams.leave()
        return _report(streams.failure(error), 1)
    if isinstance(error, MemoryError):
        return _report("not enough memory: work on fewer rows at a time", 1)
    detail = " ".join(str(error).split())
    return _report(
        f"{type(error).__name__}: {detail}; this is a bug: please report it with --debug's output", 3
    )


def _usage_message(error: BaseException) -> str | None:
    """Return one line for a usage error of Typer's parser, with the help command; None for other errors."""
    if not hasattr(error, "format_message"):
        return None
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "hydro"
    message = " ".join(error.format_message().split()).rstrip(".")
    return f"{message[:1].lower()}{message[1:]} (see {command} --help)"


def _report(message: str, code: int) -> int:
    """Print a message on stderr in one line, with control characters escaped; return the exit code."""
    line = "".join(one if one.isprintable() else repr(one)[1:-1] for one in message)
    print(f"hydro: {line}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
