// SPDX-License-Identifier: Apache-2.0
// The power law of greatest likelihood through whole numbers 1..most, P(A) ~ A^-tau; the cumulative
// N(>=A) then falls as A^-b with b = tau - 1. Clauset, Shalizi and Newman, SIAM Rev. 51 (2009) 661: the
// lower end is the one of least Kolmogorov-Smirnov distance (3.3); the upper end is known, for no cascade has
// more blocks than there are. The same estimator as eol_ros/core/science/powerlaw.py, which judges it in the tests.

export const FEWEST = 30; // with fewer, a slope would be invented
const [FLATTEST, STEEPEST] = [-4, 12];

// `counts[A]` is how many had area A. Answers {b, error, from, count} or {few: count}.
export function fitLaw(counts, most = 25) {
  let best = null;
  for (let from = 1; 4 * from <= most; from++) {
    const found = fitFrom(counts, from, most);
    if (!found) break;
    if (!best || found.distance < best.distance) best = found;
  }
  return best ?? { few: counts.reduce((sum, n) => sum + n, 0) };
}

// Expected share of N(>=A) among N(>=from), for drawing.
export function exceedance(law, area, most = 25) {
  const sum = (low) => {
    let total = 0;
    for (let a = low; a <= most; a++) total += a ** -(law.b + 1);
    return total;
  };
  return sum(area) / sum(law.from);
}

function fitFrom(counts, from, most) {
  let [total, logs, sizes] = [0, 0, 0];
  for (let a = from; a <= most; a++) {
    total += counts[a];
    logs += counts[a] * Math.log(a);
    sizes += counts[a] > 0;
  }
  if (total < FEWEST || sizes < 2) return null;
  const mean = logs / total; // the mean of log A falls as tau grows
  let [low, high] = [FLATTEST, STEEPEST];
  if (moments(low, from, most).mean < mean || moments(high, from, most).mean > mean) return null;
  while (high - low > 1e-10) {
    const middle = (low + high) / 2;
    if (moments(middle, from, most).mean > mean) low = middle;
    else high = middle;
  }
  const tau = (low + high) / 2;
  const { norm, variance } = moments(tau, from, most);
  let [seen, expected, distance] = [0, 0, 0];
  for (let a = from; a <= most; a++) {
    seen += counts[a] / total;
    expected += a ** -tau / norm;
    distance = Math.max(distance, Math.abs(seen - expected));
  }
  return { b: tau - 1, error: 1 / Math.sqrt(total * variance), from, count: total, distance };
}

function moments(tau, from, most) {
  let [norm, first, second] = [0, 0, 0];
  for (let a = from; a <= most; a++) {
    const [weight, log] = [a ** -tau, Math.log(a)];
    norm += weight;
    first += weight * log;
    second += weight * log * log;
  }
  const mean = first / norm;
  return { norm, mean, variance: second / norm - mean * mean };
}
