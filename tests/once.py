"""Preprocessed recordings, kept for the tests of one process that preprocess the same recording again.

Preprocessing is a pure function: from the same vehicle and table it returns the same result.  Most tests of
commands read one of a few bundled recordings, and preprocessing takes longer than the rest of such a test.
Tests of the preprocessing, and tests that replace a part of it, compute it again.
"""

from __future__ import annotations

import functools
import hashlib
import io
import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import pytest

from hydro.core.diagnosis import log_faults

MOST = 6
"""Maximum number of kept results; the result of the largest bundled recording takes some 50 MB."""
ANEW = ("app", "core/audit", "core/cleaning", "core/logs", "core/preprocessing", "core/recording")
"""Folders of the tests that always compute again."""
ABOVE = tuple(f"hydro.core.{name}" for name in ("diagnosis.pipeline", "discovery", "explanation", "history"))
"""Modules that use preprocessed recordings: whatever is replaced in them, preprocessing stays the same."""
TESTS = Path(__file__).resolve().parent


class _Kept:
    """Whether the running test may use kept results."""

    wanted = False


def kept_for(item: pytest.Item) -> None:
    """Decide whether a test may use kept results."""
    _Kept.wanted = not item.path.relative_to(TESTS).as_posix().startswith(ANEW)


def watched(setattr: Callable[..., None]) -> Callable[..., None]:
    """Wrap a method of `monkeypatch`: after it replaces a part of preprocessing, no kept result is used."""

    @functools.wraps(setattr)
    def and_anew(self: pytest.MonkeyPatch, target: Any, *others: Any, **options: Any) -> None:
        named = getattr(target, "__module__", None) or getattr(target, "__name__", "")
        replaced = target if isinstance(target, str) else named
        if replaced.startswith("hydro.core") and not replaced.startswith(ABOVE):
            _Kept.wanted = False
        return setattr(self, target, *others, **options)

    return and_anew


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a pure function of a vehicle and a raw table, so that it is computed once for both."""
    results, changing = OrderedDict[bytes, Any](), threading.Lock()

    @functools.wraps(function)
    def known_or_computed(vehicle: Any, raw: pl.DataFrame, *others: Any, **options: Any) -> Any:
        if not _Kept.wanted or any(one is not None for one in (*others, *options.values())):
            return function(vehicle, raw, *others, **options)
        key = _key(vehicle, raw)
        with changing:
            found = results.pop(key, None)
        if found is None:
            found = function(vehicle, raw)
        with changing:  # the workbench preprocesses in threads
            results[key] = found
            while len(results) > MOST:
                results.popitem(last=False)
        return found

    return known_or_computed


def _key(vehicle: Any, raw: pl.DataFrame) -> bytes:
    """Digest of every number of a vehicle and a table."""
    stream = io.BytesIO()
    raw.rechunk().write_ipc(stream)
    digest = hashlib.blake2b(msgspec.json.encode(vehicle, enc_hook=lambda array: array.tolist()))
    digest.update(stream.getbuffer())
    return digest.digest()


def install() -> None:
    """Keep results of `preprocess`; modules that import it later import the wrapped function."""
    log_faults.preprocess = once(log_faults.preprocess)
    pytest.MonkeyPatch.setattr = watched(pytest.MonkeyPatch.setattr)
