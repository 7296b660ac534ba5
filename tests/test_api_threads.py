"""How many threads linear algebra has during the calls of `import hydro`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np  # noqa: F401  (loads the library whose threads are counted)
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from hydro.api.threads import one_thread

ONE, TWO = 1, 2


def threads() -> int:
    return max(int(one["num_threads"]) for one in threadpool_info() if one["user_api"] == "blas")


@pytest.fixture(autouse=True)
def two() -> Iterator[None]:
    with threadpool_limits(2, user_api="blas"):
        if threads() != TWO:
            pytest.skip("the linear algebra of this machine has one thread")
        yield


def test_a_call_has_one_thread_and_gives_the_others_back_also_where_it_fails() -> None:
    assert one_thread(threads)() == ONE
    assert threads() == TWO
    with pytest.raises(ZeroDivisionError):
        one_thread(lambda: 1 / 0)()
    assert threads() == TWO
