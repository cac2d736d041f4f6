"""What two renderings differ by, and how much of that is noise.

Images are arrays (height, width, 3) of linear sRGB. Luminance is Rec. 709. "Left" is the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import UserError
from ..scene.render import Rendering

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])

# The exposure makes this the mean display luminance of the reference (1 = white), where whatever is brighter than
# white counts as white. So a light or a highlight, however bright, weighs no more than the pixels that it covers.
EXPOSURE_TARGET = 0.08

# No exposure beyond this, in stops: a scene that is nearly black everywhere stays so.
_EXPOSURE_LIMIT = 30.0

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
class Comparison:
    """The numbers and maps of one comparison. ``None`` where one pass gave no estimate of the noise.

    ``exposure`` is in stops, the user's if it was given; ``floor`` is the luminance below which differences in
    ``stops`` fade out; ``decades`` is the span of a logarithmic view above the floor, 0 for sRGB.

    ``rmse`` holds a difference and noise. ``rmse_noise`` is the noise alone, estimated from two halves with disjoint
    samples; ``rmse_beyond_noise`` is the difference alone, as the product of the differences in the two halves, in
    which independent noise averages out. So rmse² is about rmse_noise² + rmse_beyond_noise². ``flip_noise`` is the
    FLIP value between the left image and the left image with that noise added. Both sides use the same seeds, so
    noise that they share (the edge of a light) is in neither number.
    """

    exposure: float
    exposure_given: bool
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
    not_finite: tuple[int, int]
    stops: np.ndarray
    stops_noise: float | None
    flip_map: np.ndarray

    @property
    def equal(self) -> bool:
        """The images are equal, or differ by rounding alone."""
        return self.largest_difference <= ROUNDING * self.brightest


def luminance(image: np.ndarray) -> np.ndarray:
    """Rec. 709 luminance of linear sRGB."""
    return image @ _LUMINANCE


def exposure_for(reference: np.ndarray) -> float:
    """The exposure in stops, in steps of 1/3, that suits the reference; 0 for a black image."""
    values = np.maximum(luminance(reference), 0.0)
    if float(np.mean(values > 0.0)) <= EXPOSURE_TARGET:
        # So much of the image is black that no exposure reaches the target: the brightest pixel is made white.
        brightest = float(values.max())
        return -math.log2(brightest) if brightest > 0.0 else 0.0
    low, high = -_EXPOSURE_LIMIT, _EXPOSURE_LIMIT
    for _ in range(24):
        middle = 0.5 * (low + high)
        if float(np.minimum(values * 2.0**middle, 1.0).mean()) < EXPOSURE_TARGET:
            low = middle
        else:
            high = middle
    return round(3.0 * high) / 3.0


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
    try:
        import flip_evaluator
    except ImportError as error:
        raise UserError("the package flip-evaluator is missing: pip install flip-evaluator") from error
    images = [np.ascontiguousarray(image, dtype=np.float32) for image in (reference, test)]
    parameters = {"ppd": FLIP_PIXELS_PER_DEGREE}
    error_map, mean, _ = flip_evaluator.evaluate(*images, "LDR", applyMagma=False, parameters=parameters)
    return error_map[..., 0], float(mean)


def compare_images(left: Rendering, right: Rendering, exposure: float | None = None, log: bool = False) -> Comparison:
    """Compares two renderings of the same size; without an exposure, the left one decides."""
    a, b = left.rgb(), right.rgb()
    if a.shape != b.shape:
        raise UserError(f"the two images differ in size: {a.shape[1]}x{a.shape[0]}, {b.shape[1]}x{b.shape[0]}")
    not_finite = tuple(int((~np.isfinite(image)).any(axis=2).sum()) for image in (a, b))
    a, b = _finite(a), _finite(b)
    exposure_given = exposure is not None
    exposure = exposure_for(a) if exposure is None else exposure
    floor, decades = floor_for(a, b, exposure, log)
    shown = to_display(a, exposure)
    flip_map, flip_mean = flip(shown, to_display(b, exposure))
    noise = _noise(left, right, a, shown, exposure, floor)
    return Comparison(
        exposure=exposure,
        exposure_given=exposure_given,
        floor=floor,
        decades=decades,
        mean_left=float(luminance(a).mean()),
        mean_right=float(luminance(b).mean()),
        rmse=_rms(b - a),
        flip=flip_mean,
        largest_difference=float(np.abs(b - a).max()),
        brightest=float(np.abs(a).max()),
        not_finite=(not_finite[0], not_finite[1]),
        stops=stops_between(a, b, floor),
        flip_map=flip_map,
        rmse_noise=noise[0],
        rmse_beyond_noise=noise[1],
        flip_noise=noise[2],
        stops_noise=noise[3],
    )


def _noise(
    left: Rendering, right: Rendering, a: np.ndarray, shown: np.ndarray, exposure: float, floor: float
) -> tuple[float | None, float | None, float | None, float | None]:
    """RMSE of noise alone, RMSE beyond noise, FLIP of noise alone, stops of noise alone (RMS)."""
    if left.halves is None or right.halves is None:
        return None, None, None, None
    (a1, n1), (a2, n2) = left.halves
    (b1, _), (b2, _) = right.halves
    a1, a2, b1, b2 = (_finite(image) for image in (a1, a2, b1, b2))
    # A half of n1 samples has variance v/n1, so the halves differ with v·(1/n1 + 1/n2); the whole has v/(n1 + n2).
    whole = math.sqrt(1.0 / (n1 + n2) / (1.0 / n1 + 1.0 / n2))
    noise = ((b2 - a2) - (b1 - a1)) * whole
    beyond = math.sqrt(max(0.0, float(np.mean((b1 - a1) * (b2 - a2)))))
    flip_noise = flip(shown, to_display(a + noise, exposure))[1]
    stops_noise = _rms(stops_between(a2, b2, floor) - stops_between(a1, b1, floor)) * whole
    return _rms(noise), beyond, flip_noise, stops_noise


def _finite(image: np.ndarray) -> np.ndarray:
    return np.nan_to_num(image, nan=0.0, posinf=0.0, neginf=0.0)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
