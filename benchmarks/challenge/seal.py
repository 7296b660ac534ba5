"""Seals: hashes that commit to a truth before anybody answers, and seeds derived from a secret key."""

from __future__ import annotations

import csv
import hashlib
import hmac
import json
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

SEEDS = 1_000_000_000
"""Seeds are drawn from this number to twice it, beyond all seeds of development and published tables."""


def key_of(path: Path) -> bytes:
    """Return the key of an edition; draw and write it if the file is missing."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(secrets.token_hex(32) + "\n")
    return bytes.fromhex(path.read_text().strip())


def drawn(key: bytes, label: str) -> int:
    """Return the number that a key gives to a label, from 0 to 2^64 - 1."""
    return int.from_bytes(hmac.new(key, label.encode(), hashlib.sha256).digest()[:8], "big")


def seed(key: bytes, label: str) -> int:
    """Return the seed that a key gives to a label."""
    return SEEDS + drawn(key, label) % SEEDS


def salt(key: bytes, name: str) -> str:
    """Return the salt of a case, which keeps anybody from guessing its truth by trying."""
    return hmac.new(key, f"salt {name}".encode(), hashlib.sha256).hexdigest()


def sealed(truth: Mapping[str, Any]) -> str:
    """Return the seal of a truth: SHA-256 of its canonical JSON, which includes the salt."""
    rest = {name: value for name, value in truth.items() if name != "salt"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256((str(truth["salt"]) + text).encode()).hexdigest()


def write_seals(folder: Path, truths: Mapping[str, Mapping[str, Any]]) -> None:
    """Write `seals.csv` with the seal of every case that exists.

    Args:
        folder: Folder of the cases.
        truths: Truths by name of the case.
    """
    with (folder / "seals.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["case", "seal"])
        writer.writerows([name, sealed(truth)] for name, truth in sorted(truths.items()))


def read_seals(folder: Path) -> dict[str, str]:
    """Return the seals of a folder of cases."""
    with (folder / "seals.csv").open(newline="") as file:
        return {row["case"]: row["seal"] for row in csv.DictReader(file)}
