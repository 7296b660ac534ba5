"""Arrays where the vehicles of a GPU fly, and whether there is one.

On a GPU they speak `__cuda_array_interface__`: torch and others see them without a copy.  In numba-cuda's
simulator (`NUMBA_ENABLE_CUDASIM=1`), which runs the same kernels without a GPU, they are numpy's.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from hydro.core.errors import UsageError

INSTALL = "install hydro's extra `gpu`: pip install 'deep-hydro-sim[gpu]'"


def require() -> None:
    """Refuse to go on without a GPU.

    Raises:
        UsageError: numba-cuda is not installed, or finds no GPU.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise UsageError(f"numba-cuda is not installed, and a GPU needs it: {INSTALL}")
    from numba import cuda

    if not simulated() and not cuda.is_available():
        raise UsageError(
            "numba-cuda finds no GPU: fly on a machine with an NVIDIA GPU and its driver, or on the processor"
        )


def simulated() -> bool:
    """Whether numba-cuda runs kernels in its simulator."""
    from numba import config

    return bool(config.ENABLE_CUDASIM)


def put(values: ArrayLike, dtype: DTypeLike | None = None) -> Any:
    """A copy of an array of the host, on the device."""
    array = np.array(values, dtype=dtype, order="C")
    if simulated():
        return array
    from numba import cuda

    return cuda.to_device(array)


def zeros(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> Any:
    """An array of zeros on the device."""
    return put(np.zeros(shape, dtype))


def seen(values: Any, dtype: DTypeLike = np.float64) -> Any:
    """What kernels take of somebody's array: the same memory where it lies on the device, else a copy.

    Args:
        values: An array of the device, of whichever library, or one of the host.
        dtype: Of what kernels take; one of the host is converted.
    """
    if simulated() or not hasattr(values, "__cuda_array_interface__"):
        host = np.ascontiguousarray(values, dtype)
        return host if simulated() else put(host)
    from numba import cuda

    return cuda.as_cuda_array(values)


def shared(tensor: Any) -> Any:
    """A tensor of the device as kernels take it: the same memory."""
    if simulated():
        return tensor.numpy()
    from numba import cuda

    return cuda.as_cuda_array(tensor)


def host(values: Any) -> NDArray[Any]:
    """A copy of an array of the device, on the host."""
    return np.array(values) if simulated() else values.copy_to_host()


def write(array: Any, values: NDArray[Any]) -> None:
    """Overwrite an array of the device by one of the host, of its shape and type."""
    if simulated():
        array[:] = values
    else:
        array.copy_to_device(np.ascontiguousarray(values))
