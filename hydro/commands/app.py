"""Command `app`: the workbench, a local web page for the whole job."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import message
from hydro.core.errors import UsageError

VEHICLE_ENDING = ".toml"


def app(
    files: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[VEHICLE] [LOG]...",
            show_default=False,
            help="Vehicle file (.toml), and a log, the logs of one dive, or a raw table.",
        ),
    ] = None,
    map_: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", show_default=False, help="Map of the logs; default: proposed."),
    ] = None,
    folder: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            show_default=False,
            help="Folder to list, read and write; repeat for more. Default: the current one.",
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port; 0 is any free one.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="Address to listen on; default: this machine.", rich_help_panel=ADVANCED
        ),
    ] = "127.0.0.1",
    token: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            show_default=False,
            help="Secret in the address; default: a random one.",
            rich_help_panel=ADVANCED,
        ),
    ] = None,
    max_upload: Annotated[
        float,
        typer.Option(
            min=0.001, metavar="GB", help="Largest file that may be uploaded.", rich_help_panel=ADVANCED
        ),
    ] = 2.0,
    max_expanded: MaxExpanded = None,
) -> None:
    """Open the workbench, a local page for the whole job.

    The page compares a vehicle with a recording and finds missing effects. It adds and tunes them with live
    curves, and saves the vehicle file, the study and its report. Without files it opens a bundled sample.
    It needs the extra app: pip install 'deep-hydro-sim[app]'.

        hydro app
        hydro app vehicle.toml dive.mcap --map map.toml

    Details:

    The server answers only this machine and needs no network. The printed address has a random token.
    Requests without it are refused, and so are requests of other pages. The page lists, reads and writes
    only the folders of --folder, and reads the files of the command line. Uploads go to a private folder
    that is removed at the end. Ctrl-C ends the server; what was saved stays.

    Keys: space plays, the arrows step (with shift by 10 s), 1 to 5 choose a step, Ctrl-Z and Ctrl-Y undo and
    redo.

        hydro app --port 8430 --no-browser --folder dives
    """
    try:
        import nicegui  # noqa: F401
    except ImportError:
        raise UsageError("hydro app needs NiceGUI: pip install 'deep-hydro-sim[app]'") from None
    from hydro.app.desk import Desk
    from hydro.app.places import Places
    from hydro.app.server import bound, is_loopback, serve

    given = files or []
    vehicles = [one for one in given if one.endswith(VEHICLE_ENDING)]
    logs = [one for one in given if not one.endswith(VEHICLE_ENDING)]
    if len(vehicles) > 1:
        raise UsageError(f"{vehicles[1]}: a second vehicle file; give one")
    named = [*given, *([str(map_)] if map_ is not None else [])]
    for name in named:
        if not Path(name).exists():
            raise UsageError(f"{name}: no such file")
    folders = folder or [Path(".")]
    for one in folders:
        if not one.is_dir():
            raise UsageError(f"{one}: no such folder; create it, or name another with --folder")
    places = Places.of(folders, named)
    desk = Desk(
        places,
        vehicles[0] if vehicles else "",
        logs,
        str(map_) if map_ is not None else "",
        round(max_upload * 1e9),
    )
    address, listening = bound(host, port, token)
    if not is_loopback(host):
        message(f"hydro: {host} is not a loopback address: whoever has the token can use this page")

    def ready() -> None:
        message(f"hydro: workbench at {address.link}")
        message("hydro: Ctrl-C ends it")
        if browser:
            import webbrowser

            webbrowser.open(address.link)

    serve(desk, address, listening, ready)


COMMANDS = {
    app: "hydro app datasets/hidden/vehicle.toml datasets/hidden/measured.parquet",
}
