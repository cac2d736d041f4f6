"""What two renderings differ by, and how much of that is noise.

Images are arrays (height, width, 3) of linear sRGB. Luminance is Rec. 709. "Left" is the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import UserError, require
from ..scene.render import Rendering

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

# The exposure by itself, from the luminances of the reference that are above zero ("lit"; 1 is white). Their log-average
# comes to EXPOSURE_KEY, where the darkest and the brightest quarter count as the quartiles: neither windows nor fireflies
# nor corners that hardly any light reaches decide. Then it is lowered until no more than EXPOSURE_CLIPPED of the lit
# pixels are clipped at white, so that highlights keep their shape; but their median stays at EXPOSURE_MEDIAN, or a
# room with a window would be black. A larger median clips the highlights of dark scenes, a smaller one darkens rooms.
EXPOSURE_KEY = 0.18
EXPOSURE_CLIPPED = 0.02
EXPOSURE_MEDIAN = 0.04

# Differences are measured in stops against a floor of this part of display white, so that what is black on the
# display on both sides is no difference.
STOPS_FLOOR = 0.01

# A logarithmic view reaches from the brightest pixel of both images down to this quantile of the pixels that are not
# black, in whole decades, but over no more than so many; its lower end is the floor of the differences.
_LOG_QUANTILE = 0.01
_LOG_DECADES = 6

# Two images are equal but for rounding where no channel differs by more than this part of the brightest value. A
# scalar variant alone differs by 1e-8 from one run to the next: its threads add up their blocks in any order.
ROUNDING = 1e-6

# FLIP's default: a display of 0.7 m with 3840 pixels, seen from 0.7 m.
FLIP_PIXELS_PER_DEGREE = 0.7 * 3840 / 0.7 * math.pi / 180


@dataclass(frozen=True)
class Exposure:
    """``stops``, and the rule that they follow, as what it does to the left image; "" where the user has set them."""

    stops: float
    rule: str


@dataclass(frozen=True)
class Comparison:
    """The numbers and maps of one comparison. ``None`` where one pass gave no estimate of the noise.

    ``floor`` is the luminance below which differences in ``stops`` fade out; ``decades`` is the span of a logarithmic
    view above the floor, 0 for sRGB.

    ``rmse`` holds a difference and noise. ``rmse_noise`` is the noise alone, estimated from two halves with disjoint
    samples; ``rmse_beyond_noise`` is the difference alone, as the product of the differences in the two halves, in
    which independent noise averages out. So rmse² is about rmse_noise² + rmse_beyond_noise². ``flip_noise`` is the
    FLIP value between the left image and the left image with that noise added. Both sides use the same seeds, so
    noise that they share (the edge of a light) is in neither number.

    ``bad`` are the pixels that are not finite on the left and on the right. Those of either side are in no number:
    they count as black on both.
    """

    exposure: Exposure
    floor: float
    decades: int
    mean_left: float
    mean_right: float
    rmse: float
    rmse_noise: float | None
    rmse_beyond_noise: float | None
    flip: float
    flip_noise: float | None
    largest_difference: float
    brightest: float
    bad: tuple[np.ndarray, np.ndarray]
    stops: np.ndarray
    stops_noise: float | None
    flip_map: np.ndarray

    @property
    def equal(self) -> bool:
        """The images are equal, or differ by rounding alone."""
        return not self.any_bad and self.largest_difference <= ROUNDING * self.brightest

    @property
    def black(self) -> bool:
        """Both images are black wherever they are finite."""
        return self.brightest == 0.0 and self.largest_difference == 0.0

    @property
    def not_finite(self) -> tuple[int, int]:
        """How many pixels are not finite, left and right."""
        return int(self.bad[0].sum()), int(self.bad[1].sum())

    @property
    def any_bad(self) -> bool:
        return any(self.not_finite)


def luminance(image: np.ndarray) -> np.ndarray:
    """Rec. 709 luminance of linear sRGB."""
    return image @ _LUMINANCE


def exposure_for(reference: np.ndarray) -> Exposure:
    """The exposure, in steps of 1/3 stop, that suits the reference; 0 for a black image."""
    values = luminance(reference).ravel()
    lit = values[values > 0.0]
    if lit.size == 0:
        return Exposure(0.0, "no pixel of it is lit")
    logs = np.log2(lit)
    first, median, third = np.quantile(logs, (0.25, 0.5, 0.75))
    key = math.log2(EXPOSURE_KEY) - float(np.clip(logs, first, third).mean())
    highlights = -float(np.quantile(logs, 1.0 - EXPOSURE_CLIPPED))
    least = math.log2(EXPOSURE_MEDIAN) - float(median)
    pixels = "lit pixels" if lit.size == values.size else f"lit pixels ({100.0 * lit.size / values.size:.2g} % of all)"
    if least > min(key, highlights):
        stops, rule = least, f"the median of its {pixels} is at about {100.0 * EXPOSURE_MEDIAN:.0f} % of white"
    elif highlights < key:
        stops, rule = highlights, f"about {100.0 * EXPOSURE_CLIPPED:.0f} % of its {pixels} are clipped"
    else:
        stops, rule = key, f"the log-average of its {pixels} is at about {100.0 * EXPOSURE_KEY:.0f} % of white"
    return Exposure(round(3.0 * stops) / 3.0, rule)


def to_display(image: np.ndarray, exposure: float) -> np.ndarray:
    """sRGB values in [0, 1] at an exposure in stops; what is brighter than white is clipped."""
    linear = np.clip(image * 2.0**exposure, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1.0 / 2.4) - 0.055)


def floor_for(left: np.ndarray, right: np.ndarray, exposure: float, log: bool) -> tuple[float, int]:
    """The luminance that counts as black, and the decades above it of a logarithmic view (0 if it is none)."""
    values = np.concatenate([luminance(image).ravel() for image in (left, right)])
    values = values[values > 0.0]
    if not log or values.size == 0:
        return STOPS_FLOOR * 2.0**-exposure, 0
    top = float(values.max())
    span = math.log10(top / float(np.quantile(values, _LOG_QUANTILE)))
    decades = min(max(math.ceil(span), 1), _LOG_DECADES)
    return top * 10.0**-decades, decades


def stops_between(left: np.ndarray, right: np.ndarray, floor: float) -> np.ndarray:
    """log2 of the luminance ratio right / left, both raised by the floor: +1 is twice as bright."""
    a, b = (np.maximum(luminance(image), 0.0) + floor for image in (left, right))
    return np.log2(b / a)


def flip(reference: np.ndarray, test: np.ndarray) -> tuple[np.ndarray, float]:
    """The FLIP map of two display images, and its mean."""
    require("compare")
    import flip_evaluator

    images = [np.ascontiguousarray(image, dtype=np.float32) for image in (reference, test)]
    parameters = {"ppd": FLIP_PIXELS_PER_DEGREE}
    error_map, mean, _ = flip_evaluator.evaluate(*images, "LDR", applyMagma=False, parameters=parameters)
    return error_map[..., 0], float(mean)


def compare_images(left: Rendering, right: Rendering, exposure: float | None = None, log: bool = False) -> Comparison:
    """Compares two renderings of the same size; without an exposure, the left one decides."""
    a, b = left.rgb(), right.rgb()
    if a.shape != b.shape:
        raise UserError(f"the two images differ in size: {a.shape[1]}x{a.shape[0]}, {b.shape[1]}x{b.shape[0]}")
    bad = [~np.isfinite(image).all(axis=2) for image in (a, b)]
    good = ~(bad[0] | bad[1])
    a, b = (np.where(good[..., None], image, 0.0) for image in (a, b))
    chosen = exposure_for(a) if exposure is None else Exposure(exposure, "")
    floor, decades = floor_for(a, b, chosen.stops, log)
    shown = to_display(a, chosen.stops)
    flip_map, flip_mean = flip(shown, to_display(b, chosen.stops))
    noise = _noise(left, right, a, shown, good, chosen.stops, floor)
    part = max(float(good.mean()), 1.0 / good.size)  # of the pixels; the others are zero in every mean below
    return Comparison(
        exposure=chosen,
        floor=floor,
        decades=decades,
        mean_left=float(luminance(a).mean()) / part,
        mean_right=float(luminance(b).mean()) / part,
        rmse=_rms(b - a) / math.sqrt(part),
        flip=flip_mean / part,
        largest_difference=float(np.abs(b - a).max()),
        brightest=float(np.abs(a).max()),
        bad=(bad[0], bad[1]),
        stops=stops_between(a, b, floor),
        flip_map=flip_map,
        rmse_noise=None if noise is None else noise.rmse / math.sqrt(part),
        rmse_beyond_noise=None if noise is None else noise.rmse_beyond / math.sqrt(part),
        flip_noise=None if noise is None else noise.flip / part,
        stops_noise=None if noise is None else noise.stops / math.sqrt(part),
    )


@dataclass(frozen=True)
class _Noise:
    """What noise alone does to the numbers of a comparison, and the RMSE without it."""

    rmse: float
    rmse_beyond: float
    flip: float
    stops: float


def _noise(
    left: Rendering, right: Rendering, a: np.ndarray, shown: np.ndarray, good: np.ndarray, exposure: float, floor: float
) -> _Noise | None:
    """None where one pass gave no estimate."""
    if left.halves is None or right.halves is None:
        return None
    (a1, n1), (a2, n2) = left.halves
    (b1, _), (b2, _) = right.halves
    a1, a2, b1, b2 = (np.where(good[..., None], _finite(image), 0.0) for image in (a1, a2, b1, b2))
    # A half of n1 samples has variance v/n1, so the halves differ with v·(1/n1 + 1/n2); the whole has v/(n1 + n2).
    whole = math.sqrt(1.0 / (n1 + n2) / (1.0 / n1 + 1.0 / n2))
    noise = ((b2 - a2) - (b1 - a1)) * whole
    return _Noise(
        rmse=_rms(noise),
        rmse_beyond=math.sqrt(max(0.0, float(np.mean((b1 - a1) * (b2 - a2))))),
        flip=flip(shown, to_display(a + noise, exposure))[1],
        stops=_rms(stops_between(a2, b2, floor) - stops_between(a1, b1, floor)) * whole,
    )


def _finite(image: np.ndarray) -> np.ndarray:
    return np.nan_to_num(image, nan=0.0, posinf=0.0, neginf=0.0)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
