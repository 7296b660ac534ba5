"""Byte offsets of the fields of MuJoCo's C structs, for compiled code that reads bare pointers.

The offsets follow from the declarations in `mujoco.introspect` and the C layout rules of the platform.  They
are checked once per process against the addresses of the Python bindings.  If the structs of the installed
MuJoCo differ, hydro refuses to start.
"""

from __future__ import annotations

import ctypes
import functools
from functools import cache
from typing import Any, cast

import mujoco
import numpy as np
from mujoco.introspect import ast_nodes, enums, structs

from hydro.core.errors import HydroError

# C types of mjModel and mjData that occur by value and are neither structs nor enums.
_SCALARS: dict[str, Any] = {
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtByte": ctypes.c_uint8,
    "mjtBool": ctypes.c_bool,
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "char": ctypes.c_char,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_void_p,
    "int64_t": ctypes.c_int64,
    "uint64_t": ctypes.c_uint64,
    "uint32_t": ctypes.c_uint32,
    "unsigned int": ctypes.c_uint,
}

_PROBE = """
<mujoco>
  <size nuserdata="3"/>
  <custom><numeric name="probe" data="1 2 3"/></custom>
  <worldbody>
    <body name="probe"><freejoint/><geom size="1"/><site name="probe"/></body>
  </worldbody>
  <actuator>
    <general name="probe" site="probe" dyntype="filter" delay="0.01" nsample="5"/>
  </actuator>
</mujoco>
"""


def _c_type(declared: Any) -> Any:
    """Return the ctypes type of a declaration."""
    if isinstance(declared, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(declared, ast_nodes.ArrayType):
        inner = _c_type(declared.inner_type)
        for extent in reversed(declared.extents):
            inner = inner * extent
        return inner
    if isinstance(declared, ast_nodes.AnonymousStructDecl | ast_nodes.AnonymousUnionDecl):
        base = ctypes.Union if isinstance(declared, ast_nodes.AnonymousUnionDecl) else ctypes.Structure
        return type("anonymous", (base,), {"_fields_": [(f.name, _c_type(f.type)) for f in declared.fields]})
    if declared.name in structs.STRUCTS:
        return _c_struct(declared.name)
    if declared.name in enums.ENUMS:
        return ctypes.c_int
    if declared.name in _SCALARS:
        return _SCALARS[declared.name]
    raise HydroError(
        f"MuJoCo {mujoco.__version__} declares a field of unknown type {declared.name!r}: install mujoco 4.0"
    )


@cache
def _c_struct(name: str) -> type[ctypes.Structure]:
    """Return the ctypes struct of a MuJoCo struct, from its declaration."""
    declaration = structs.STRUCTS.get(name) or structs.STRUCTS[f"{name}_"]
    return type(
        name, (ctypes.Structure,), {"_fields_": [(f.name, _c_type(f.type)) for f in declaration.fields]}
    )


def offset(struct: str, field: str) -> int:
    """Return the byte offset of a field in one of MuJoCo's C structs.

    Args:
        struct: `"mjModel"` or `"mjData"`.
        field: Name of the field in C, or `opt.timestep` for a field of an inner struct.

    Raises:
        HydroError: The installed MuJoCo has no such field.
    """
    return _find(struct, field)[0]


def _find(struct: str, field: str) -> tuple[int, Any]:
    """Return the byte offset and ctypes type of a field."""
    found, kind = 0, cast(Any, _c_struct(struct))
    for name in field.split("."):
        descriptor = getattr(kind, name, None)
        if descriptor is None:
            raise HydroError(f"MuJoCo {mujoco.__version__} has no field {struct}.{field}: install mujoco 4.0")
        found += int(descriptor.offset)
        kind = dict(kind._fields_)[name]
    return found, kind


def _mismatch(struct: str, field: str, owner: Any) -> str | None:
    """Return the field's name if its offset is wrong according to the bindings, else None."""
    at, kind = _find(struct, field)
    value = functools.reduce(getattr, field.split("."), owner)
    if isinstance(value, np.ndarray):
        kind, value = ctypes.c_void_p, value.ctypes.data
    return None if kind.from_address(owner._address + at).value == value else f"{struct}.{field}"


def verify(used: dict[str, tuple[str, ...]]) -> None:
    """Check the computed offsets against the addresses that MuJoCo's Python bindings use, on a small model.

    Args:
        used: Fields that compiled code reads, for `"mjModel"` and `"mjData"`.

    Raises:
        HydroError: A field is not where its declaration says.
    """
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    data.time = 0.125
    found = [
        _mismatch(struct, field, owner)
        for struct, owner in (("mjModel", model), ("mjData", data))
        for field in used.get(struct, ())
    ]
    wrong = [name for name in found if name]
    if wrong:
        raise HydroError(
            f"the structs of MuJoCo {mujoco.__version__} are not laid out as declared ({', '.join(wrong)}): "
            "hydro would read wrong numbers and stops here; install mujoco 4.0"
        )
