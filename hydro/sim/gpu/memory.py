"""Arrays on the device, and checks for a GPU.

On a GPU the arrays provide `__cuda_array_interface__`: torch and other libraries use them without a copy.  In
the simulator of numba-cuda (`NUMBA_ENABLE_CUDASIM=1`), which runs the same kernels without a GPU, they are
numpy arrays.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from hydro.core.errors import UsageError

INSTALL = "install hydro's extra `gpu`: pip install 'deep-hydro-sim[gpu]'"
"""Remedy for missing packages."""


def require() -> None:
    """Check that a GPU is available.

    Raises:
        UsageError: numba-cuda is not installed, or finds no GPU.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise UsageError(f"numba-cuda is not installed, but a GPU needs it: {INSTALL}")
    from numba import cuda

    if not simulated() and not cuda.is_available():
        raise UsageError(
            "numba-cuda finds no GPU: use a machine with an NVIDIA GPU and its driver, or the processor"
        )


def simulated() -> bool:
    """Return whether numba-cuda runs kernels in its simulator, on the processor."""
    from numba import config

    return bool(config.ENABLE_CUDASIM)


def put(values: ArrayLike, dtype: DTypeLike | None = None) -> Any:
    """Return a copy of a host array on the GPU."""
    array = np.array(values, dtype=dtype, order="C")
    if simulated():
        return array
    from numba import cuda

    return cuda.to_device(array)


def zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> Any:
    """Return a new array of zeros on the GPU."""
    return put(np.zeros(shape, dtype))


def seen(values: Any, dtype: DTypeLike = np.float64) -> Any:
    """Return an array that GPU kernels can use: a device array shares its memory, a host array is copied.

    Args:
        values: Array on the device, of any library, or on the host.
        dtype: Type for kernels; a host array is converted.
    """
    if simulated() or not hasattr(values, "__cuda_array_interface__"):
        host = np.ascontiguousarray(values, dtype)
        return host if simulated() else put(host)
    from numba import cuda

    return cuda.as_cuda_array(values)


def shared(tensor: Any) -> Any:
    """Return a tensor on the GPU as an array that kernels accept, with the same memory."""
    if simulated():
        return tensor.numpy()
    from numba import cuda

    return cuda.as_cuda_array(tensor)


def host(values: Any) -> NDArray[Any]:
    """Return a copy of an array on the GPU as a numpy array."""
    return np.array(values) if simulated() else values.copy_to_host()


def write(array: Any, values: NDArray[Any]) -> None:
    """Overwrite an array on the GPU with a host array of the same shape and type."""
    if simulated():
        array[:] = values
    else:
        array.copy_to_device(np.ascontiguousarray(values))
