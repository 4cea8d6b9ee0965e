// SPDX-License-Identifier: Apache-2.0
//
// A map whose landmarks have every kind of chain, as `shiftmap-mapper import` reads it.

const STAMP_S = 1767606421; // A Monday, between two hours.

// Rates by rows, off the diagonal, from a function of the two states; rows add up to zero.
function matrix(states, rate) {
  const rows = [];
  for (let from = 0; from < states; ++from) {
    const out = Array.from({length: states}, (_, to) => (to === from ? 0 : rate(from, to)));
    out[from] = -out.reduce((sum, value) => sum + value, 0);
    rows.push(...out);
  }
  return rows;
}

// Busy in the morning, quiet at night; at the weekend nothing but a return to mode 1.
function phase(states, hour) {
  const busy = 2e-6 + 1.5e-4 * Math.exp(-(((hour % 24) - 8) ** 2) / 8);
  const weekend = hour >= 120;
  return matrix(states, (from, to) => (weekend ? (to === 1 ? 3e-5 : 1e-7) : busy * (1 + ((from + 2 * to) % 3))));
}

function group(signature, modes, chain) {
  const states = modes + 1;
  const weights = Array.from({length: states}, (_, state) => 1 / (1 + state * state));
  const sum = weights.reduce((a, b) => a + b);
  return {
    signature,
    mode: Array.from({length: modes}, (_, i) => ({
      mode: String(i + 1), x_m: i, y_m: signature.length, cov_xx_m2: 0.01, cov_xy_m2: 0, cov_yy_m2: 0.01,
    })),
    probability: weights.map((weight) => weight / sum),
    ...chain(states),
  };
}

const uniform = () => ({leave_rate_per_s: 3e-6});
const general = (states) => ({rate_per_s: matrix(states, (from, to) => 1e-6 * (1 + from + 3 * to))});
const rhythm = (period_s, hours) => (states) => ({
  ...general(states),
  rhythm: {
    period_s: String(period_s),
    phase: Array.from({length: hours}, (_, hour) => ({rate_per_s: phase(states, hour)})),
  },
});

export function rhythmicMap() {
  return {
    stamp_ns: String(BigInt(STAMP_S) * 1000000000n),
    group: [
      group('always', 2, uniform),
      group('apart', 3, general),
      group('day', 2, rhythm(86400, 24)),
      group('door', 1, rhythm(86400, 24)),
      group('quarters', 2, rhythm(86400, 4)),
      group('week', 3, rhythm(604800, 168)),
    ],
  };
}
