"""Import names of version 0.1 that have moved; they work for one more version with a `DeprecationWarning`.

A finder at the end of `sys.meta_path` handles only modules that no other finder has found.  It imports the
module under its new name and returns the same object, so classes stay identical.  After version 0.2.0 is
published, delete this file, its call in `hydro/__init__.py`, and the `__getattr__` of `core.vehicle` and
`core.recording`.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import Any

_PACKAGES = {  # new package: old module names, each with its new name after a colon if it differs
    "hydro.core.diagnosis": "diagnose:pipeline search naming:confidence "
    "left_out:confidence undetermined:identifiability unexplained slow:unexplained "
    "log_faults findings extend:findings",
    "hydro.core.explanation": "explain",
    "hydro.core.experiment": "advice manoeuvres",
    "hydro.core.preprocessing": "sensor_tests coloured",
    "hydro.core.evaluation": "evidence:score_test compare misfit metrics "
    "conditions:regimes places:failure_regimes restarts:rolling_prediction",
    "hydro.core.audit": "wiring",
    "hydro.core.identification": "fit descent:levenberg_marquardt suspects passive:passivity "
    "beginnings:initial_guess given:prior",
    "hydro.core.prediction": "parameters shooting:multiple_shooting sensitivity weakform:weak_form "
    "normal:normal_equations candidate",
    "hydro.core.distillation": "labels split features history",
    "hydro.core.simulation": "dynamics integrate simulate excitation handling:steady_motion "
    "noise:sensor_noise variation:variational_equation",
    "hydro.core.guessing": "aliases",
    "hydro.core.logs": "logmap importing resample conventions alternatives agreement "
    "kinematics:convention_check",
    "hydro.core.recording": "segments smoothing readings:sensor_faults dead_reckoning",
    "hydro.core.vehicle": "frames rigid_body allocation:thrusters mixing:control_allocation panels ellipsoid",
    "hydro.sim.bridge": "callbacks native fields structs pointers states water mjcf",
    "hydro.sim.residual": "control",
    "hydro.rl.environment": "action encoding environments fleet geometry guidance judge:step "
    "observation reward sonar torch_env conditions",
    "hydro.rl.world": "config planner",
    "hydro.rl.training": "sac train curriculum divergence evaluate runs policy returns",
}

MODULES = {
    f"{package.rpartition('.')[0]}.{old}": f"{package}.{new or old}"
    for package, names in _PACKAGES.items()
    for old, _, new in (name.partition(":") for name in names.split())
} | {
    "hydro.rl.build": "hydro.rl.training.build",
    "hydro.core.conditioning": "hydro.sim.residual.conditioning",
    "hydro.core.ranking": "hydro.report.ranking",
    **{f"hydro.sim.{name}": f"hydro.core.residual.{name}" for name in ("lowering", "layers", "network")},
}
"""New dotted names of modules by old name."""

PACKAGES = {
    "hydro.core.vehicle": "hydro.core.vehicle.description",
    "hydro.core.recording": "hydro.core.recording.arrays",
}
"""Modules that became packages, with the module that holds their former content."""


class Finder:
    """Import hook (an entry of `sys.meta_path`) that finds modules of version 0.1 by their old names."""

    @staticmethod
    def find_spec(
        fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the import spec that loads a moved module under its old name; None for any other name.

        Args:
            fullname: Dotted name of the module to import.
            path: Not used; part of Python's interface of finders.
            target: Not used; likewise.
        """
        return ModuleSpec(fullname, _Loader()) if fullname in MODULES else None


class _Loader(Loader):
    """Loader that returns the module of the new name under the old one."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        new = MODULES[spec.name]
        _warn(spec.name, new)
        module = import_module(new)
        self._spec = module.__spec__  # the import system overwrites it with the spec of the old name
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec


def attribute(package: str, name: str) -> Any:
    """Return an attribute that a former module had, from the package that took its name, with a warning.

    Args:
        package: Dotted name of the package, a key of PACKAGES.
        name: Name of the attribute.

    Raises:
        AttributeError: The former module had no such attribute.
    """
    home = PACKAGES[package]
    # the import system calls this before it looks for a submodule, so submodules are left to it
    if name.startswith("_") or find_spec(f"{package}.{name}") or not hasattr(import_module(home), name):
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    if sys._getframe(2).f_globals["__name__"] != "importlib._bootstrap":  # `from` asks twice: warn once
        _warn(f"{package}.{name}", f"{home}.{name}", level=4)
    return getattr(import_module(home), name)


def install() -> None:
    """Add `Finder` to `sys.meta_path`, once, so that imports of old module names work."""
    if Finder not in sys.meta_path:
        sys.meta_path.append(Finder)


def _warn(old: str, new: str, level: int = 3) -> None:
    """Warn at the line that imports, skipping frames of the import system."""
    warnings.warn(
        f"{old} has moved to {new}; the old name goes with the next version",
        DeprecationWarning,
        stacklevel=level,
    )
