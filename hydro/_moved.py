"""Names of version 0.1 that have moved, importable for one more version with a `DeprecationWarning`.

A finder at the end of `sys.meta_path` is asked only for modules that nobody else has found: it imports the
module under its new name and hands out that same object, so that classes stay identical.  Delete this file,
its call in `hydro/__init__.py` and the `__getattr__` of `core.vehicle` and `core.recording` once version
0.2 is out.
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

_PACKAGES = {  # new package: old name of a module, and its new one where that is another
    "hydro.core.diagnosis": "diagnose search naming:confidence "
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
"""Old dotted name of a module: its new one."""

PACKAGES = {
    "hydro.core.vehicle": "hydro.core.vehicle.description",
    "hydro.core.recording": "hydro.core.recording.arrays",
}
"""Modules that are packages now: the module that holds what they held."""


class Finder:
    """Finds modules by their old names."""

    @staticmethod
    def find_spec(
        fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """A spec for an old name, None for any other."""
        return ModuleSpec(fullname, _Loader()) if fullname in MODULES else None


class _Loader(Loader):
    """Gives the module of the new name out under the old one."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        new = MODULES[spec.name]
        _warn(spec.name, new)
        module = import_module(new)
        self._spec = module.__spec__  # the import system overwrites it with the spec of the old name
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._spec


def attribute(package: str, name: str) -> Any:
    """A name that was in a module whose place a package has taken.

    Raises:
        AttributeError: it was not.
    """
    home = PACKAGES[package]
    # a submodule is left to the import system, which asks here before it looks for one
    if name.startswith("_") or find_spec(f"{package}.{name}") or not hasattr(import_module(home), name):
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    if sys._getframe(2).f_globals["__name__"] != "importlib._bootstrap":  # `from` asks twice: warn once
        _warn(f"{package}.{name}", f"{home}.{name}", level=4)
    return getattr(import_module(home), name)


def install() -> None:
    """Let old names be found, once."""
    if Finder not in sys.meta_path:
        sys.meta_path.append(Finder)


def _warn(old: str, new: str, level: int = 3) -> None:
    """Warn in the name of the line that imports; frames of the import system do not count."""
    warnings.warn(
        f"{old} has moved to {new}; the old name goes with the next version",
        DeprecationWarning,
        stacklevel=level,
    )
