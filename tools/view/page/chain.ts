// SPDX-License-Identifier: Apache-2.0
//
// The continuous-time chain by which a landmark changes its mode, as mapstore/map/mode_chain.h has it.
import type {Group} from './data';

/** exp(Q s) by scaling and squaring; rows are from, columns are to. */
export function transition(rates: number[], states: number, seconds: number): Float64Array {
  const scaled = rates.map((rate) => rate * seconds);
  const norm = Math.max(...scaled.map(Math.abs), 1e-300);
  const squarings = Math.max(0, Math.ceil(Math.log2(norm * states)) + 4);
  const step = scaled.map((value) => value / 2 ** squarings);
  let result = new Float64Array(states * states);
  for (let i = 0; i < states; ++i) result[i * states + i] = 1;
  let term = result;
  for (let order = 1; order <= 10; ++order) {
    term = product(term, step, states).map((value) => value / order);
    result = result.map((value, i) => value + term[i]!);
  }
  for (let i = 0; i < squarings; ++i) result = product(result, result, states);
  return result;
}

export function product(a: ArrayLike<number>, b: ArrayLike<number>, n: number): Float64Array<ArrayBuffer> {
  const c = new Float64Array(n * n);
  for (let i = 0; i < n; ++i) {
    for (let k = 0; k < n; ++k) {
      const value = a[i * n + k]!;
      for (let j = 0; j < n; ++j) c[i * n + j]! += value * b[k * n + j]!;
    }
  }
  return c;
}

/** p(to) from p(from); the same if `to` is earlier: a chain is not run backwards. [s since the epoch] */
export function propagate(group: Group, p: number[], from: number, to: number): number[] {
  const states = p.length;
  const seconds = to - from;
  if (!(seconds > 0) || states < 2) return p;
  if (group.rhythm?.known) return group.rhythm.propagate(p, from, to);
  if (typeof group.rates === 'number') {
    const kept = Math.exp(-group.rates * seconds * states / (states - 1));
    return p.map((value) => value * kept + (1 - kept) / states);
  }
  const matrix = transition(group.rates, states, seconds);
  return p.map((_, to) => p.reduce((sum, value, from) => sum + value * matrix[from * states + to]!, 0));
}

/**
 * How the probabilities of a landmark go: known at points of time, run by the chain in between.
 * A point is begin and end [ms after the origin], then the probabilities [1/10000] from end on.
 */
export class Track {
  private readonly columns: number;
  constructor(
      private readonly group: Group,
      private readonly points: number[],
      private readonly originS: number) {
    this.columns = group.modes.length + 3;
  }

  get size(): number { return Math.floor(this.points.length / this.columns); }
  begin(i: number): number { return this.originS + this.points[i * this.columns]! / 1e3; }
  end(i: number): number { return this.originS + this.points[i * this.columns + 1]! / 1e3; }

  /** The probabilities at a time; before the first point, those of that point. */
  at(time: number): number[] {
    if (this.size === 0) return this.group.probabilities;
    let low = 0;
    let high = this.size;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.begin(middle) <= time) low = middle;
      else high = middle;
    }
    const first = low * this.columns + 2;
    const p = this.points.slice(first, first + this.columns - 2).map((value) => value / 1e4);
    return propagate(this.group, p, this.end(low), time);
  }
}
