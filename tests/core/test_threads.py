"""Work that is shared among threads, and how many of them there are within it."""

from __future__ import annotations

import threading

import pytest

from hydro.core.errors import DataError, UsageError
from hydro.core.threads import available, require_numbers, shared, spread


def test_what_is_shared_comes_in_order_and_leaves_each_its_part(monkeypatch):
    monkeypatch.setenv("HYDRO_THREADS", "6")

    def deeper(item: int) -> list[int]:
        return [available(), *shared(lambda _: available(), range(2))]

    assert available() == 6
    assert list(shared(lambda item: 10 * item, range(20))) == list(range(0, 200, 10))
    assert list(shared(deeper, range(3))) == [[2, 1, 1]] * 3
    assert available() == 6


@pytest.mark.parametrize("threads", [None, 1, 3])
def test_pieces_come_in_order_and_one_thread_is_the_present_one(threads, monkeypatch):
    monkeypatch.setenv("HYDRO_THREADS", "2")
    here = threading.get_ident()
    assert spread(lambda piece: 10 * piece, range(20), threads) == list(range(0, 200, 10))
    outside = {here} != set(spread(lambda _: threading.get_ident(), range(20), threads))
    assert outside == (threads != 1)
    assert spread(lambda _: threading.get_ident(), [0], threads) == [here]


def test_an_error_is_raised_where_its_result_would_come():
    def refuse(item: int) -> int:
        if item == 2:
            raise DataError("two")
        return item

    found = shared(refuse, range(5))
    assert [next(found), next(found)] == [0, 1]
    with pytest.raises(DataError, match="two"):
        next(found)


@pytest.mark.parametrize("name", ["HYDRO_THREADS", "NUMBA_NUM_THREADS"])
@pytest.mark.parametrize("text", ["-3", "0", "two", "1.5", ""])
def test_a_number_of_threads_that_is_none_is_refused_with_its_variable(name, text, monkeypatch):
    monkeypatch.setenv(name, text)
    with pytest.raises(UsageError, match=name):
        require_numbers()
