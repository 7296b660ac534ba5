"""Recordings of an underwater vehicle in Stonefish; `FOLDER` has them, `manifest.json` lists them."""

from pathlib import Path

FOLDER = Path(__file__).parent / "stonefish"
"""Folder of the recordings and the vehicle file."""
