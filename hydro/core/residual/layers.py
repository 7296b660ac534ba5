"""Layer kernels of residual networks, and the interpreter of a program of layers.

A program is a table of doubles with one row per step: operation, source and target in a float32 workspace,
number of values, and offset of the weights.  Weights are float32 as torch trained them.  Matrices are
transposed so that the inner loop runs along a row.  Every sum has a fixed order, so a wrench depends neither
on the batch size nor on the thread.  Results agree with torch to a few float32 roundings.
"""

from __future__ import annotations

import math

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.core.compiled import kernel, within
from hydro.core.residual.mirrors import mirrored_wrench

# Operations of a step: `width` values at `source` are mapped to `length` values at `to`.
DENSE = 0  # W x + b
ACTIVATE = 1  # in place, by the function `ARGUMENT`
NORM = 2  # layer norm of x
ADD = 3  # x is added to the values at `to`
MIX = 4  # mean of `width` consecutive vectors at `source`, with weights from ARGUMENT on
DIRECTION = 5  # seven features of the velocity; see `_direction`
PASSIVE = 6  # C(nu) nu + D(nu) nu from the 36 numbers of A at `source`; see `_passive`
MIRRORED = 7  # the wrench of a velocity, from ARGUMENT points; see `core.residual.mirrors`

# Columns of a program.
OPERATION, SOURCE, WIDTH, TO, LENGTH, WEIGHTS, ARGUMENT, COLUMNS = range(8)

FUNCTIONS = {"relu": 0, "silu": 1, "tanh": 2, "softmax": 3}
SLOW = 0.1
"""Normalised speed below which the direction of motion is smoothed towards zero."""
EPSILON = 1e-5
"""Term added to the variance in a layer norm, torch's default."""

_ONE, _LOWEST, _HIGHEST, _LOG2_E = (np.float32(x) for x in (1.0, -87.0, 88.0, 1.44269504088896341))
_ROUNDER = np.float32(1.5 * 2.0**23)  # adding it rounds to an integer, held in the last bits
_ROUNDER_BITS = 0x4B400000
_LN_2, _LN_2_REST = np.float32(0.693359375), np.float32(-2.12194440e-4)  # the first is exact in nine bits
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(c)
    for c in (
        1.9875691500e-4,
        1.3981999507e-3,
        8.3334519073e-3,
        4.1665795894e-2,
        1.6666665459e-1,
        5.0000001201e-1,
    )
)


@kernel
def run(program: Array, weights: Array32, nu: Array, work: Array32, scratch: Array) -> None:
    """Run the program of a network on a workspace whose first values are the inputs.

    Args:
        program: Operations, one per row, (operations, COLUMNS), from `core.residual.lowering`.
        weights: All weights in one vector.
        nu: Velocity in body axes, (6,) [m/s, rad/s].
        work: Workspace; its last six values are the wrench afterwards.
        scratch: Memory for sums in float64, (`mirrors.SCRATCH`,).
    """
    for step in range(program.shape[0]):
        row = program[step]
        operation, width = int(row[OPERATION]), int(row[WIDTH])
        source, at = int(row[SOURCE]), int(row[WEIGHTS])
        out = work[int(row[TO]) : int(row[TO]) + int(row[LENGTH])]
        if operation == DENSE:
            _affine(weights, at, width, work[source : source + width], out)
        elif operation == ACTIVATE:
            _activate(int(row[ARGUMENT]), out)
        elif operation == NORM:
            _norm(weights, at, work[source : source + width], out)
        elif operation == ADD:
            for j in range(out.size):
                out[j] += work[source + j]
        elif operation == MIX:
            shares = int(row[ARGUMENT])
            _mix(work[shares : shares + width], work[source : source + width * out.size], out)
        elif operation == DIRECTION:
            _direction(weights, at, nu, out)
        elif operation == PASSIVE:
            _passive(weights, at, work[source : source + 36], nu, out)
        elif operation == MIRRORED:
            mirrored_wrench(weights, at, int(row[ARGUMENT]), nu, scratch, out)


@kernel
def _affine(weights: Array32, start: int, wide: int, x: Array32, out: Array32) -> None:
    """Write W x + b to `out`; W^T, then b, are stored from `start` on.  Four inputs per pass over `out`."""
    length = out.size
    bias = weights[start + wide * length : start + (wide + 1) * length]
    for j in range(length):
        out[j] = bias[j]
    fours = wide - wide % 4
    for i in range(0, fours, 4):
        at = start + i * length
        a, b, c, d = x[i], x[i + 1], x[i + 2], x[i + 3]
        first, second = weights[at : at + length], weights[at + length : at + 2 * length]
        third, fourth = weights[at + 2 * length : at + 3 * length], weights[at + 3 * length : at + 4 * length]
        for j in range(length):
            out[j] += (a * first[j] + b * second[j]) + (c * third[j] + d * fourth[j])
    for i in range(fours, wide):
        row = weights[start + i * length : start + (i + 1) * length]
        for j in range(length):
            out[j] += x[i] * row[j]


@within
def exponential(x: np.float32) -> np.float32:
    """Return exp(x) in single precision, accurate to 1e-7, between 1e-38 and 1e38; NaN stays NaN.

    The function uses arithmetic alone, so that loops over it are vectorised.  With x = n ln 2 + r, it
    evaluates a polynomial of r (Cephes) and writes n into the exponent bits.
    """
    if x < _LOWEST:
        x = _LOWEST
    if x > _HIGHEST:
        x = _HIGHEST
    shifted = x * _LOG2_E + _ROUNDER
    n = shifted - _ROUNDER
    r = (x - n * _LN_2) - n * _LN_2_REST
    y = _C0 * r + _C1
    y = y * r + _C2
    y = y * r + _C3
    y = y * r + _C4
    y = y * r + _C5
    y = y * r * r + r + _ONE
    power = np.int32((np.float32(shifted).view(np.int32) - _ROUNDER_BITS + 127) << 23)
    result: np.float32 = y * power.view(np.float32)
    return result


@kernel
def _activate(function: int, x: Array32) -> None:
    """Apply an activation function in place; `function` is its number in `FUNCTIONS`."""
    one, two = np.float32(1.0), np.float32(2.0)
    if function == 0:
        for j in range(x.size):
            x[j] = max(x[j], np.float32(0.0))
    elif function == 1:
        for j in range(x.size):
            x[j] = x[j] / (one + exponential(-x[j]))
    elif function == 2:
        for j in range(x.size):
            x[j] = one - two / (exponential(two * x[j]) + one)
    else:
        largest = x[0]
        for j in range(1, x.size):
            largest = max(largest, x[j])
        total = np.float32(0.0)
        for j in range(x.size):
            x[j] = exponential(x[j] - largest)
            total += x[j]
        for j in range(x.size):
            x[j] /= total


@kernel
def _norm(weights: Array32, start: int, x: Array32, out: Array32) -> None:
    """Write scale (x - mean) / sqrt(variance + EPSILON) + shift to `out`; scale, shift start at `start`."""
    length = x.size
    mean, variance = 0.0, 0.0
    for j in range(length):
        mean += x[j]
    mean /= length
    for j in range(length):
        variance += (x[j] - mean) ** 2
    root = math.sqrt(variance / length + EPSILON)
    for j in range(length):
        value = weights[start + j] * ((x[j] - mean) / root) + weights[start + length + j]
        out[j] = np.float32(value)


@kernel
def _mix(shares: Array32, vectors: Array32, out: Array32) -> None:
    """Write the sum of shares[k] vectors[k] to `out`."""
    for j in range(out.size):
        out[j] = shares[0] * vectors[j]
    for k in range(1, shares.size):
        for j in range(out.size):
            out[j] += shares[k] * vectors[k * out.size + j]


@kernel
def _direction(weights: Array32, start: int, nu: Array, out: Array32) -> None:
    """Write (nu / v) / (SLOW + |nu|) and 1 / (1 + |nu|) to `out` (7,).

    v are the velocity scales (6,), stored from `start` on, and |nu| is the root mean square of nu / v.
    """
    square = 0.0
    for i in range(6):
        square += (nu[i] / weights[start + i]) ** 2 / 6.0
    speed = math.sqrt(square)
    for i in range(6):
        out[i] = np.float32(nu[i] / weights[start + i] / (SLOW + speed))
    out[6] = np.float32(1.0 / (1.0 + speed))


@kernel
def _passive(weights: Array32, start: int, A: Array32, nu: Array, out: Array32) -> None:
    """Write C(nu) nu + D nu to `out` (6,), with the damping matrix D of `damping`.

    The weights from `start` on are an inertia matrix (36), row by row, which defines the Coriolis matrix C
    (Fossen theorem 3.2); the scales r (6); and 1 / (6 v^2) of the velocity scales v.
    """
    factor = _growth(weights, start, nu)
    for i in range(6):
        out[i] = np.float32(0.0)
    for j in range(6):
        projected = 0.0
        for i in range(6):
            projected += A[6 * i + j] * (weights[start + 36 + i] * nu[i])
        projected *= factor
        for i in range(6):
            out[i] += np.float32(weights[start + 36 + i] * A[6 * i + j] * projected)
    for k in range(3):
        one, two = (k + 1) % 3, (k + 2) % 3
        a, b = _row(weights, start + 6 * one, nu), _row(weights, start + 6 * two, nu)
        c, d = _row(weights, start + 6 * (3 + one), nu), _row(weights, start + 6 * (3 + two), nu)
        out[k] += np.float32(nu[3 + one] * b - nu[3 + two] * a)
        out[3 + k] += np.float32(nu[one] * b - nu[two] * a + nu[3 + one] * d - nu[3 + two] * c)


@kernel
def damping(weights: Array32, start: int, A: Array32, nu: Array, D: Array) -> None:
    """Write the damping matrix (1 + |nu|) R A A^T R of a passive network to `D` (36,), row by row.

    R = diag(r), and |nu| is the root mean square of nu / v.

    Args:
        weights: All weights of the network.
        start: Offset of the layer's weights: inertia (36), r (6), 1 / (6 v^2) with the velocity scales v (6).
        A: Output of the layers, (36,).
        nu: Velocity in body axes, (6,) [m/s, rad/s].
        D: Output: damping matrix, (36,).
    """
    factor = _growth(weights, start, nu)
    for i in range(6):
        for k in range(6):
            total = 0.0
            for j in range(6):
                total += float(A[6 * i + j]) * A[6 * k + j]
            D[6 * i + k] = factor * weights[start + 36 + i] * total * weights[start + 36 + k]


@kernel
def _growth(weights: Array32, start: int, nu: Array) -> float:
    """Return 1 + |nu|, with the root mean square |nu| of nu / v, v the velocity scales."""
    square = 0.0
    for i in range(6):
        square += weights[start + 42 + i] * nu[i] ** 2
    return 1.0 + math.sqrt(square)


@kernel
def _row(weights: Array32, at: int, nu: Array) -> float:
    """Return the product of a matrix row, stored from `at` on, with nu."""
    total = 0.0
    for j in range(6):
        total += weights[at + j] * nu[j]
    return total
