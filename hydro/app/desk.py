"""State of the server: what the command line gave, and the tabs that are open."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from hydro.app.places import Places
from hydro.app.worker import Worker

if TYPE_CHECKING:
    from hydro.app.opening import Proposed
    from hydro.app.session import Session

MOST_TABS = 6
"""Maximum number of sessions that are kept; the one that was unused for longest is dropped."""
TABLE = ".parquet"
"""Ending of a raw table."""


@dataclass
class Choice:
    """Files that the user of a tab has chosen to open.

    Attributes:
        vehicle: Vehicle file; empty for the one in the recording, or the preset that fits.
        logs: A raw table, or the logs of one dive.
        map: Map file; empty for a raw table, or to propose one.
        correct: Whether to accept the directions of the thrusters that the audit states.
        holdout: Held-out recording; empty without one.
        before: Recording before a change; empty without one.
        guess: Reason why the vehicle was chosen for the user; empty if the user chose it.
    """

    vehicle: str = ""
    logs: tuple[str, ...] = ()
    map: str = ""
    correct: bool = False
    holdout: str = ""
    before: str = ""
    guess: str = ""

    def choose(self, logs: tuple[str, ...], sample: str) -> None:
        """Change the choice to another recording.

        A raw table opens alone, so that it gives way to a recording that is chosen after it.  The map, and a
        vehicle that the user did not choose, belong to the earlier recording and are dropped.

        Args:
            logs: A raw table, or the logs of one dive, in the order in which they were chosen.
            sample: Vehicle file of the sample.
        """
        if any(one.endswith(TABLE) for one in logs):
            logs = logs[-1:]
        if logs != self.logs and (self.guess or self.vehicle == sample):
            self.vehicle, self.guess = "", ""
        self.logs, self.map, self.correct = logs, "", False


@dataclass
class Tab:
    """State of one tab of the browser, which survives a reload of the page.

    Attributes:
        name: Key of the tab in the page's address.
        choice: Files that the user has chosen to open.
        session: Open recording, vehicle and history.
        worker: Worker process of the tab.
        owner: Client of the page that shows the tab; another page with the same address takes it over.
        proposed: Map that was proposed for the chosen logs.
        step: Number of the step that is shown, 1 to 5.
    """

    name: str
    choice: Choice
    session: Session
    worker: Worker
    owner: str = ""
    proposed: Proposed | None = None
    step: int = 1


@dataclass
class Desk:
    """State of the server: files of the command line, and open tabs.

    Attributes:
        places: Folders that may be read and written.
        vehicle: Vehicle file of the command line; empty without one.
        logs: Logs of the command line.
        map: Map of the command line; empty without one.
        largest: Maximum size of an upload [bytes].
        uploaded: Paths of all files that any tab has uploaded.
        worker: Function that makes the worker of a tab.
        tabs: Tabs by name, the one that was used last at the end.
        spare: Worker that has been started for the next new tab; None without one.
    """

    places: Places
    vehicle: str = ""
    logs: Sequence[str] = ()
    map: str = ""
    largest: int = 0
    uploaded: list[str] = field(default_factory=list)
    worker: Callable[[], Worker] = Worker
    tabs: dict[str, Tab] = field(default_factory=dict)
    spare: Worker | None = None

    def prepare(self) -> None:
        """Start the worker of the first tab, which loads its libraries while the browser opens the page."""
        self.spare = self.worker()
        self.spare.start()

    def tab(self, name: str) -> Tab:
        """Return a tab by its name; if no such tab is open, a new one with the files of the command line."""
        from hydro.app.session import Session

        if (found := self.tabs.pop(name, None)) is None:
            choice = Choice(self.vehicle, tuple(self.logs), self.map)
            worker, self.spare = self.spare or self.worker(), None
            found = Tab(secrets.token_urlsafe(6), choice, Session(), worker)
        self.tabs[found.name] = found
        while len(self.tabs) > MOST_TABS:
            oldest = next(iter(self.tabs))
            self.tabs.pop(oldest).worker.close()
        return found

    def close(self) -> None:
        """End the worker processes of all tabs and remove the uploaded files."""
        for worker in (self.spare, *(tab.worker for tab in self.tabs.values())):
            if worker is not None:
                worker.close()
        self.places.close()
