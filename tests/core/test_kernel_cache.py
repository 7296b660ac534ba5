"""The cache of compiled kernels costs no result: damaged files, full disks, folders of other people."""

from __future__ import annotations

import contextlib
import errno
import os
import pickle
import pwd
import stat
import subprocess
import sys
import tempfile
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from filelock import FileLock
from modules import imported

from hydro.core import kernel_cache, kernel_turns
from hydro.core.errors import HydroNotice, HydroWarning
from hydro.core.kernel_cache import KernelCache
from hydro.core.kernel_turns import compile_in_turns

ROOT = Path(__file__).resolve().parents[2]
NAME = "kernels-of-a-test"


@pytest.fixture(autouse=True)
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache and a folder for temporary files of the test's own."""
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("HYDRO_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.setattr(kernel_cache._Saving, "works", True)
    monkeypatch.setattr(kernel_cache._First, "told", None)
    kernel_cache.folder.cache_clear()
    yield tmp_path
    kernel_cache.folder.cache_clear()


@pytest.fixture
def module(tmp_path: Path) -> ModuleType:
    """A module with a function to compile."""
    (tmp_path / "made.py").write_text("def twice(x):\n    return 2.0 * x\n")
    return imported(tmp_path / "made.py")


def compiled(module: ModuleType, place: Path) -> tuple[float, int, list[str]]:
    """What the function makes of 3, how often that was loaded from the cache, and what was warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        kernel_cache._fault_in_existing.cache_clear()
        kernel_cache._warn_of_damage.cache_clear()
        kernel_cache._announce_compilation.cache_clear()
        dispatcher = numba.njit(module.twice)
        dispatcher._cache = KernelCache(module.twice, place)
        value = dispatcher(3.0)
    assert all(issubclass(one.category, HydroWarning) for one in caught)
    lines = [str(one.message) for one in caught if not issubclass(one.category, HydroNotice)]
    assert not [line for line in lines if "\n" in line]
    return value, sum(dispatcher.stats.cache_hits.values()), lines


def test_the_first_compilation_is_told_once(module: ModuleType) -> None:
    """Of an empty cache, and not of one that has a kernel."""
    place, _ = found()
    assert place is not None
    told = []
    for _ in range(2):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            kernel_cache._announce_compilation.cache_clear()
            dispatcher = numba.njit(module.twice)
            dispatcher._cache = KernelCache(module.twice, place)
            dispatcher(3.0)
        told.append([str(one.message) for one in caught])
    assert told == [[kernel_cache.COMPILING], []]


def test_a_long_first_compilation_is_not_silent(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "SILENCE", 0.0)
    monkeypatch.setattr(kernel_cache._First, "told", None)
    monkeypatch.setattr(kernel_cache._First, "count", 0)
    place, _ = found()
    assert place is not None
    kernel_cache._announce_compilation.cache_clear()
    dispatcher = numba.njit(module.twice)
    dispatcher._cache = KernelCache(module.twice, place)
    with pytest.warns(HydroNotice) as told:
        assert (dispatcher(3.0), dispatcher(3)) == (6.0, 6.0)
    assert [str(one.message) for one in told] == [
        kernel_cache.COMPILING,
        "compiling kernels: 1 compiled",
        "compiling kernels: 2 compiled",
    ]


def found(name: str = NAME) -> tuple[Path | None, list[str]]:
    """The folder for kernels, and what was warned of."""
    kernel_cache.folder.cache_clear()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        place = kernel_cache.folder(name)
    return place, [str(one.message) for one in caught]


def test_a_failure_to_write_is_told_once_and_ends_all_writing() -> None:
    with pytest.warns(HydroWarning, match="cannot be kept") as told:
        kernel_cache._stop_saving("here", OSError(errno.ENOSPC, "no space"))
    assert len(told) == 1
    assert not kernel_cache._Saving.works
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kernel_cache._stop_saving("there", OSError(errno.ENOSPC, "no space"))


def test_a_kernel_is_kept_where_nobody_else_can_write(module: ModuleType) -> None:
    place, lines = found()
    assert place is not None
    assert lines == []
    before = os.umask(0)
    try:
        assert compiled(module, place) == (6.0, 0, [])
    finally:
        os.umask(before)
    assert compiled(module, place) == (6.0, 1, [])
    for path in (place.parent, place, *place.rglob("*")):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600)


def cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def emptied(content: bytes) -> bytes:
    return b""


def garbage(content: bytes) -> bytes:
    return np.random.default_rng(0).bytes(3000)


def flipped(content: bytes) -> bytes:
    return content[:-200] + bytes([content[-200] ^ 1]) + content[-199:]


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", [cut, emptied, garbage, flipped])
def test_a_damaged_file_is_compiled_again_and_told_with_its_folder(
    damage: Callable[[bytes], bytes], suffix: str, module: ModuleType
) -> None:
    place, _ = found()
    assert place is not None
    compiled(module, place)
    (path,) = place.rglob(f"*.{suffix}")
    path.write_bytes(damage(path.read_bytes()))
    value, hits, (line,) = compiled(module, place)
    assert (value, hits) == (6.0, 0)
    assert line.startswith(f"{place}: damaged or foreign compiled kernels are compiled again")
    assert compiled(module, place) == (6.0, 1, [])


def test_what_numba_cannot_load_is_compiled_again(
    module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, _ = found()
    assert place is not None
    compiled(module, place)

    def broken(*arguments: Any) -> None:
        raise AttributeError("of another version")

    monkeypatch.setattr(kernel_cache._Compiled, "rebuild", broken)
    value, hits, (line,) = compiled(module, place)
    assert (value, hits) == (6.0, 0)
    assert line.startswith(f"{place}: ")


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES])
def test_a_disk_that_takes_nothing_is_told_once(
    code: int, module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, _ = found()
    assert place is not None
    tried = []

    def refuse(self: Any, path: str) -> None:
        tried.append(path)
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(kernel_cache._Files, "_open_for_write", refuse)
    value, _, (line,) = compiled(module, place)
    assert value == 6.0
    assert line == (
        f"{place}: compiled kernels cannot be kept ({os.strerror(code).lower()}): make room, or name another "
        "folder in HYDRO_CACHE_DIR"
    )
    assert compiled(module, place) == (6.0, 0, [])
    assert len(tried) == 1


def test_without_a_home_folder_the_cache_is_a_private_temporary_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(number: int) -> None:
        raise KeyError(number)

    for name in ("HYDRO_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    place, (line,) = found()
    assert place == tmp_path / "tmp" / f"hydro-{os.geteuid()}" / NAME
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    assert "there is no home folder" in line
    assert str(place.parent) in line


def test_a_command_needs_neither_a_home_folder_nor_a_known_user(tmp_path: Path) -> None:
    program = (
        "import pwd, sys\n"
        "def unknown(number): raise KeyError(number)\n"
        "pwd.getpwuid = unknown\n"
        "from hydro import cli\n"
        "sys.exit(cli.main(sys.argv[1:]))\n"
    )
    vehicle = str(ROOT / "datasets" / "vehicles" / "auv151.toml")
    line = [sys.executable, "-c", program, "check", vehicle]
    environment = {"PATH": os.defpath, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    done = subprocess.run(line, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("hydro: warning: kernel cache: there is no home folder")


def test_an_empty_name_of_a_cache_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HYDRO_CACHE_DIR")
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", name)
        assert found() == (tmp_path / ".cache" / "hydro" / NAME, [])


@pytest.mark.parametrize("mode", [0o770, 0o720, 0o702, 0o777])
def test_a_folder_that_others_can_write_to_is_not_loaded_from(
    mode: int, tmp_path: Path, module: ModuleType
) -> None:
    place, _ = found()
    assert place is not None
    compiled(module, place)
    place.chmod(mode)
    other, (line,) = found()
    assert other == tmp_path / "tmp" / f"hydro-{os.geteuid()}" / NAME
    assert line.startswith(f"{place}: others can write to it, so compiled kernels are kept in {other.parent}")
    assert compiled(module, other) == (6.0, 0, [])


def test_rights_of_others_above_the_kernels_are_taken_back() -> None:
    place, _ = found()
    assert place is not None
    place.parent.chmod(0o775)
    assert found() == (place, [])
    assert stat.S_IMODE(place.parent.stat().st_mode) == 0o755


def test_a_folder_in_which_anybody_can_replace_ours_is_not_used(tmp_path: Path) -> None:
    place, _ = found()
    assert place is not None
    place.parents[1].chmod(0o777)
    other, (line,) = found()
    assert other is not None
    assert other.is_relative_to(tmp_path / "tmp")
    assert line.startswith(f"{place.parents[1]}: others can replace it")
    place.parents[1].chmod(0o1777)
    assert found() == (place, [])


def test_a_folder_of_another_user_is_not_loaded_from(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    place, _ = found()
    assert place is not None
    if os.geteuid() == 0:
        os.chown(place, 1234, -1)
        other, (line,) = found()
        assert other == tmp_path / "tmp" / "hydro-0" / NAME
        assert line.startswith(f"{place}: it belongs to another user, so compiled kernels are kept in")
        return
    own = os.geteuid()  # who is not root cannot give files away, but can seem to be another user
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    nowhere, (line,) = found()
    assert nowhere is None
    assert line.startswith(
        f"{place.parent}: it belongs to another user, so kernels are compiled in every run"
    )


def test_code_in_a_file_of_others_is_not_run(tmp_path: Path, module: ModuleType) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
            return (tmp_path / "sprung").touch, ()

    place, _ = found()
    assert place is not None
    compiled(module, place)
    (path,) = place.rglob("*.nbi")
    content = pickle.dumps(Trap())
    path.write_bytes(kernel_cache._MARK + zlib.crc32(content).to_bytes(4, "little") + content)
    path.chmod(0o666)
    value, hits, (line,) = compiled(module, place)
    assert (value, hits) == (6.0, 0)
    assert line.startswith(f"{place}: damaged or foreign")
    assert not (tmp_path / "sprung").exists()
    path.parent.chmod(0o777)
    assert compiled(module, place)[:2] == (6.0, 0)
    assert not (tmp_path / "sprung").exists()


def test_a_link_among_the_temporary_files_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "aim").mkdir(mode=0o700)
    (tmp_path / "tmp" / f"hydro-{os.geteuid()}").symlink_to(tmp_path / "aim")
    monkeypatch.setenv("HYDRO_CACHE_DIR", str(tmp_path / "made.py"))
    (tmp_path / "made.py").touch()
    nowhere, (line,) = found()
    assert nowhere is None
    assert "kernels are compiled in every run" in line
    assert not any((tmp_path / "aim").iterdir())


def in_turns(module: ModuleType, place: Path) -> Any:
    """Return the function's dispatcher, whose process takes turns with others."""
    dispatcher = numba.njit(module.twice)
    dispatcher._cache = KernelCache(module.twice, place)
    compile_in_turns(dispatcher, dispatcher._cache.turns)
    return dispatcher


def test_a_kernel_that_another_process_compiles_is_waited_for_and_loaded(
    module: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other process is a thread, which holds the lock until it has kept the kernel."""
    place, _ = found()
    assert place is not None
    first, second = in_turns(module, place), in_turns(module, place)
    alone = numba.njit(module.twice)
    alone(3.0)
    result = alone.overloads[(numba.float64,)]
    lock = first._cache.turns._path
    lock.parent.mkdir(mode=0o700)
    monkeypatch.setattr(kernel_turns, "SILENCE", 0.05)
    kernel_turns._announce_waiting.cache_clear()
    looked = threading.Event()
    load = KernelCache._load_overload

    def seen(self: KernelCache, *arguments: Any) -> Any:
        result = load(self, *arguments)
        looked.set()
        return result

    monkeypatch.setattr(KernelCache, "_load_overload", seen)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with FileLock(lock, thread_local=False) as held:

            def keep() -> None:
                looked.wait()
                time.sleep(0.2)
                first._cache.save_overload((numba.float64,), result)
                held.release()

            other = threading.Thread(target=keep)
            other.start()
            assert second(3.0) == 6.0
            other.join()
    assert sum(second.stats.cache_hits.values()) == 1
    assert [str(one.message) for one in caught].count(kernel_turns.WAITING) == 1


def test_a_lock_is_released_after_a_compilation_and_after_a_failed_one(module: ModuleType) -> None:
    place, _ = found()
    assert place is not None
    dispatcher = in_turns(module, place)
    for argument in (3.0, "three"):
        with contextlib.suppress(numba.TypingError):
            dispatcher(argument)
        FileLock(dispatcher._cache.turns._path).acquire(blocking=False)
