"""From measurement to material: fits of the family, of tables and of mixtures to reflectance."""

from __future__ import annotations

from .measurement import Measurement, measurement
from .problem import Model
from .reflectance import Fit, Score, fit, fit_measurement

__all__ = ["Fit", "Measurement", "Model", "Score", "fit", "fit_measurement", "measurement"]
