# SPDX-License-Identifier: Apache-2.0
"""Other laws of whole numbers on the same range: does any fit as well as the power law?

Likelihood ratios after Clauset, Shalizi and Newman, SIAM Rev. 51 (2009) 661, section 5. Each law is
a density on x_min .. x_max, normalised by the plain sum. Exponential and stretched exponential are
not nested: Vuong's test (Econometrica 57 (1989) 307), whose variance is taken over blocks of
events, for they hang together. Log-normal and cut-off contain the power law, as their limit: twice
the logarithm of the ratio against chi squared. What dependence of events widens
(`powerlaw.inefficiency`) is divided by.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from eol_ros.core.science.powerlaw import Fit, inefficiency

ALTERNATIVES = ('exponential', 'stretched exponential', 'log-normal', 'cut-off power law')
LEVEL = 0.1
STRETCH = (0.05, 3.0)


@dataclass(frozen=True)
class Alternative:
    """Another law. log_ratio: log likelihood of the power law less that of this one."""

    name: str
    log_ratio: float
    p_value: float

    @property
    def verdict(self) -> str:
        """Whether this law is worse than the power law, as good or better."""
        if self.p_value >= LEVEL:
            return 'as good'
        return 'worse' if self.log_ratio > 0 else 'better'


def compare(numbers: np.ndarray, power: Fit) -> list[Alternative]:
    """Return the four alternatives to `power`, fitted to the `numbers` (n,) in order of time."""
    numbers = np.asarray(numbers)
    top = power.x_max or max(20 * int(numbers.max()), 10_000)
    support = np.arange(power.x_min, top + 1, dtype=float)
    inside = numbers[(numbers >= power.x_min) & (numbers <= top)]
    counts = np.bincount(inside - power.x_min, minlength=len(support)).astype(float)
    logs = np.log(support)
    # a law without an end is normalised to infinity, as it was when it was fitted
    log_norm = -(power.log_likelihood + power.tau * float(counts @ logs)) / power.count
    own = -power.tau * logs - log_norm
    widened = inefficiency(np.log(inside))
    found = []
    for name, density in (
        ('exponential', _family(support[:, None], np.zeros(len(support)), counts)[0]),
        ('stretched exponential', _stretched(support, counts)),
    ):
        gain = own - density
        ratio = float(counts @ gain)
        gains = gain[inside - power.x_min]
        spread = float(gains.std() * math.sqrt(len(gains) * inefficiency(gains)))
        p = math.erfc(abs(ratio) / (math.sqrt(2) * spread)) if spread > 0 else 1.0
        found.append(Alternative(name, ratio, p))
    for name, second in (('log-normal', logs**2), ('cut-off power law', support)):
        density = _bent(logs, second, counts, own)
        ratio = min(float(counts @ (own - density)), 0.0)
        # one-sided: the bend goes one way only
        p = 0.5 * math.erfc(math.sqrt(-ratio / widened)) if ratio < 0 else 1.0
        found.append(Alternative(name, ratio, p))
    return found


def sentence(found: list[Alternative]) -> str:
    """Return what the comparisons say, for people."""
    parts = []
    for verdict in ('better', 'as good', 'worse'):
        names = [a.name for a in found if a.verdict == verdict]
        if names:
            parts.append(f'{verdict}: {", ".join(names)}')
    return f'compared with it, {"; ".join(parts)}' if parts else ''


def _density(log_weight: np.ndarray) -> np.ndarray:
    """Log of the normalised density."""
    top = log_weight.max()
    return log_weight - top - math.log(np.exp(log_weight - top).sum())


def _family(
    features: np.ndarray, base: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Log density (k,) of greatest likelihood of exp(base + features @ theta), and theta."""
    middle, scale = features.mean(axis=0), features.std(axis=0)
    features = (features - middle) / scale
    mean = counts @ features / counts.sum()
    theta = np.zeros(features.shape[1])
    density = _density(base)
    reached = theta @ mean + float(density[0] - base[0])  # density = base + ... - log norm
    for _ in range(200):
        weight = np.exp(density)
        expected = weight @ features
        spread = features.T @ (weight[:, None] * features) - np.outer(expected, expected)
        step = np.linalg.solve(spread + 1e-12 * np.eye(len(theta)), mean - expected)
        size = 1.0
        while size > 1e-9:
            tried = theta + size * step
            log_weight = base + features @ tried
            made = _density(log_weight)
            value = tried @ mean + float(made[0] - log_weight[0])
            if value >= reached - 1e-14:
                break
            size /= 2
        done = abs(value - reached) < 1e-13 and np.abs(size * step).max() < 1e-8
        theta, density, reached = tried, made, value
        if done:
            break
    return density, theta / scale


def _stretched(support: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """x^(k - 1) exp(-lambda x^k)."""
    logs = np.log(support)

    def made(log_k: float) -> np.ndarray:
        k = math.exp(log_k)
        return _family(support[:, None] ** k, (k - 1) * logs, counts)[0]

    bounds = tuple(map(math.log, STRETCH))
    best = optimize.minimize_scalar(
        lambda log_k: -counts @ made(log_k), bounds=bounds, method='bounded',
        options={'xatol': 1e-4},
    )  # fmt: skip
    return made(best.x)


def _bent(logs: np.ndarray, second: np.ndarray, counts: np.ndarray, own: np.ndarray) -> np.ndarray:
    """exp(a log x + b second) with b <= 0; the power law itself where b would be above zero."""
    density, theta = _family(np.stack([logs, second], axis=1), np.zeros(len(logs)), counts)
    return density if theta[1] <= 0 else own
