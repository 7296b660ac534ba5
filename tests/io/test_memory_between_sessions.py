"""Memory between sessions is released where a session needed much, and only there."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from hydro.io import memory


@pytest.fixture
def collected(monkeypatch) -> list[None]:
    """Collections of garbage, counted and not made."""
    made = list[None]()
    monkeypatch.setattr(gc, "collect", lambda: made.append(None))
    monkeypatch.setattr(memory._Released, "size", 0)
    return made


def test_memory_is_released_again_only_after_the_process_has_grown(collected):
    memory.give_back()
    memory.give_back()
    assert len(collected) == 1
    held = np.ones(2 * memory.WORTH // 8)
    memory.give_back()
    assert len(collected) == 2
    assert held.all()


def test_memory_is_always_released_where_its_size_is_not_known(collected, monkeypatch, tmp_path):
    monkeypatch.setattr(memory, "_STATUS", tmp_path / "none")
    memory.give_back()
    memory.give_back()
    assert len(collected) == 2
