"""Reader of the triangles of a Wavefront OBJ file, for the hull of a vehicle."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hydro.core.errors import DataError
from hydro.io.files import read_bytes


def read_obj(path: str | Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the vertices and triangles of an OBJ file.

    Args:
        path: File with `v x y z` and `f a b c …` lines, in metres, body axes FRD about the body origin.
            Faces with more than three corners become fans.  Texture and normal numbers (`a/b/c`) are ignored.
            Negative numbers count from the last vertex.

    Returns:
        Vertices (V, 3) [m] and faces (F, 3), numbered from 0.

    Raises:
        DataError: The file cannot be read, has no faces, or has an invalid line.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DataError(f"{path}: cannot read the hull's mesh: it is not a text file") from None
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        word, *rest = line.split("#", 1)[0].split() or [""]
        try:
            if word == "v":
                x, y, z = (float(value) for value in rest[:3])
                vertices.append([x, y, z])
            elif word == "f":
                first, *others = [_vertex(corner, len(vertices)) for corner in rest]
                if len(others) < 2:
                    raise ValueError("a face needs three corners")
                faces += [(first, a, b) for a, b in itertools.pairwise(others)]
        except ValueError:
            raise DataError(
                f"{path}: line {number} is not a vertex or face of an OBJ file: {line.strip()[:60]!r}"
            ) from None
    if not faces:
        raise DataError(f"{path}: holds no faces ('f a b c' lines); export the hull as a Wavefront OBJ mesh")
    return np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64)


def _vertex(corner: str, count: int) -> int:
    """Return the vertex number, from 0, of a face corner such as `7`, `7/1/3` or `-1`.

    Args:
        corner: Text of the corner.
        count: Number of vertices read so far, from which negative numbers count.
    """
    number = int(corner.split("/", 1)[0])
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"vertex {number} of {count}")
    return index
