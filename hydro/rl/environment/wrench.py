"""Settings of the wrench of a residual network in a training: lead, filter, low-pass, clipping, dead band."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from hydro.core.errors import UsageError
from hydro.core.recording.smoothing import Design
from hydro.core.vehicle.description import Vehicle
from hydro.sim.residual.conditioning import OFF, Conditioning, clipping, preset
from hydro.sim.residual.control import NOISELESS


@dataclass(frozen=True)
class WrenchSettings:
    """Settings of the wrench that a residual network adds in a training.

    Attributes:
        lead: Time by which the network is evaluated ahead, as a fraction of the control step.  Half a step
            centres the held wrench in the interval in which it acts; Wu et al. state no lead, that is 0.
        ratio: q dt^3 / R of the filter that estimates the body acceleration nu_dot, with the jerk density q,
            the sample time dt and the noise variance R.  Above 1 the filter follows every sample.
        beta: Weight of the old value in the low-pass, 0 for no low-pass; None for the preset's weight.
        clip: Greatest wrench of an axis in multiples of the thrusters' greatest, 0 for no limit; None for the
            preset's limit.
        deadband: Speed below which the wrench fades [m/s, rad/s], 0 for no fading; None for the preset's
            speed.
    """

    lead: float = 0.5
    ratio: float = NOISELESS
    beta: float | None = None
    clip: float | None = None
    deadband: float | None = None

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            UsageError: A number is out of range.
        """
        if not 0.0 <= self.lead <= 1.0:
            raise UsageError(f"wrench.lead is {self.lead:g}; give a share of the control step, 0 to 1")
        if not 0.0 < self.ratio < math.inf:
            raise UsageError(f"wrench.ratio is {self.ratio:g}; give a number above 0")
        if self.beta is not None and not 0.0 <= self.beta < 1.0:
            raise UsageError(f"wrench.beta is {self.beta:g}; give 0 or more, and less than 1")
        for name in ("clip", "deadband"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise UsageError(f"wrench.{name} is {value:g}; give 0 or more")

    def design(self, period: float) -> Design:
        """Return the settings of the filter that estimates accelerations, with steps of `period` [s]."""
        return Design(period, (self.ratio,) * 6, (0.0,) * 6)

    def conditioning(self, name: str, vehicle: Vehicle) -> Conditioning:
        """Return the low-pass and limits of a network's wrench: a preset with the changes of these settings.

        Args:
            name: Name of the preset.
            vehicle: Vehicle whose thrust scales the limits.
        """
        made = preset(name, vehicle)
        if self.beta is not None:
            made = replace(made, beta=self.beta or None, weighs="old")
        if self.clip is not None:
            limits = clipping(vehicle, self.clip) if self.clip else OFF.limits
            made = replace(made, limits=limits)
        if self.deadband is not None:
            made = replace(made, linear_deadband=self.deadband, angular_deadband=self.deadband)
        return made
