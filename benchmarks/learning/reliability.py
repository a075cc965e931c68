"""Whether predicted probabilities are honest: calibration error, Brier score, bins with a band for clustered throws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BINS = 10
RESAMPLES = 400  # of whole cells, for the band
BAND = (0.5, 99.5)  # [%] of the resamples


@dataclass(frozen=True, eq=False)
class Bin:
    """Throws whose predicted probability lies in one tenth: means of prediction and hits, number, and the band."""

    predicted: float
    hit: float
    count: int
    band: tuple[float, float]

    @property
    def is_inside(self) -> bool:
        """Whether a perfect forecast can have given these hits."""
        return self.band[0] <= self.hit <= self.band[1]


def calibration_error(predicted: np.ndarray, hit: np.ndarray) -> float:
    """Expected calibration error over `BINS` bins of equal width (Naeini et al., AAAI 2015)."""
    index = bin_index(predicted)
    gaps = [abs(float(np.sum(predicted[index == i] - hit[index == i]))) for i in range(BINS)]
    return sum(gaps) / len(predicted)


def brier_share(predicted: np.ndarray, hit: np.ndarray) -> float:
    """Brier score over that of the base rate [-]."""
    rate = float(np.mean(hit))
    return float(np.mean((predicted - hit) ** 2)) / max(rate * (1.0 - rate), 1e-12)


def bin_index(predicted: np.ndarray) -> np.ndarray:
    """The bin of each prediction."""
    return np.minimum((predicted * BINS).astype(int), BINS - 1)


def reliability_bins(predicted: np.ndarray, hit: np.ndarray, cell: np.ndarray, seed: int = 0) -> list[Bin]:
    """The bins with at least one throw.

    Throws of one cell share its posterior's error. The band is that of a perfect forecast with the deviations of whole
    cells from their predictions resampled: mean prediction plus the resampled, centred deviation of the bin.
    """
    rng = np.random.default_rng(seed)
    index = bin_index(predicted)
    names, of = np.unique(cell, return_inverse=True)
    found = []
    for i in range(BINS):
        inside = index == i
        count = int(inside.sum())
        if not count:
            continue
        gap = np.bincount(of[inside], weights=(hit - predicted)[inside], minlength=len(names))
        number = np.bincount(of[inside], minlength=len(names))
        mean = gap.sum() / count
        drawn = rng.integers(0, len(names), (RESAMPLES, len(names)))
        total = number[drawn].sum(axis=1)
        spread = (gap - mean * number)[drawn].sum(axis=1) / np.maximum(total, 1)
        middle = float(predicted[inside].mean())
        # With few misses no cell may deviate at all: then the binomial scatter of independent throws is the least.
        least = 2.6 * np.sqrt(max(middle * (1.0 - middle), 1.0 / count) / count)
        low, high = np.percentile(spread, BAND)
        band = middle + min(low, -least), middle + max(high, least)
        found.append(Bin(middle, float(hit[inside].mean()), count, (float(band[0]), float(band[1]))))
    return found
