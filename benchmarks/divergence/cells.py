"""Cells of the study: the factors of each, changed one at a time from the centre, and some pairs."""

from __future__ import annotations

from dataclasses import dataclass

CONDITIONS = {"R_MLP": "mlp", "R_PhysFeat": "physfeat"}
"""Architecture of the network by condition."""


@dataclass(frozen=True)
class Data:
    """Data and protocol of a network.

    Attributes:
        minutes: Minutes of data: 2 and 20 of the bundled sample, 200 of the full recordings.
        noise: Profile of the sensor noise, a name of `core.simulation.sensor_noise.PROFILES`.
        accelerations: Whether accelerations are inputs.  Without them the network is trained as this project
            does for noisy logs: protocol `annealed`, stronger and decoupled weight decay.
    """

    minutes: int = 20
    noise: str = "none"
    accelerations: bool = True

    @property
    def name(self) -> str:
        """Name of the file of a network."""
        return f"{self.minutes}min-{self.noise}" + ("" if self.accelerations else "-velocities")


@dataclass(frozen=True)
class Cell:
    """Factors of one cell.

    Attributes:
        name: Name in the tables.
        data: Data and protocol of the network.
        conditioning: Preset of `sim.residual.conditioning`; `paper` is `paper-new`.
        lead: Time by which the network is evaluated ahead, as a share of the control step.
    """

    name: str
    data: Data = Data()
    conditioning: str = "paper"
    lead: float = 0.0


SHORT, NOISY, POOR = Data(minutes=2), Data(noise="dvl"), Data(minutes=2, noise="dvl")
CELLS = (
    Cell("centre"),
    Cell("2 min of data", SHORT),
    Cell("200 min of data", Data(minutes=200)),
    Cell("DVL noise", NOISY),
    Cell("DVL noise, without accelerations", Data(noise="dvl", accelerations=False)),
    Cell("conditioning off", conditioning="off"),
    Cell("beta weighs the old value", conditioning="paper-old"),
    Cell("lead 0.5", lead=0.5),
    Cell("2 min, conditioning off", SHORT, "off"),
    Cell("DVL noise, conditioning off", NOISY, "off"),
    Cell("DVL noise, beta old", NOISY, "paper-old"),
    Cell("2 min, DVL noise", POOR),
    Cell("2 min, DVL noise, conditioning off", POOR, "off"),
    Cell("2 min, DVL noise, beta old", POOR, "paper-old"),
)
"""Centre, one changed factor, then pairs and triples of the factors that a first trial named."""


def cell_of(name: str) -> Cell:
    """Return a cell by name."""
    return next(cell for cell in CELLS if cell.name == name)
