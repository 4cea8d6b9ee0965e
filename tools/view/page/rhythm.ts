// SPDX-License-Identifier: Apache-2.0
//
// Rates that depend on the hour of the day or of the week, as mapstore/map/chain_rhythm.h has them.
import {product, transition} from './chain';

const DAY_S = 86400;
const WEEK_S = 7 * DAY_S;
/** From so many periods on, one of them is raised to a power. */
const MANY_PERIODS = 3;
/** Jumps up to which the terms of the series are few. */
const MOST_JUMPS = 8;
const NEGLIGIBLE = 1e-12;

export class Rhythm {
  /** Of each phase: rows are from, columns are to. */
  private readonly phases: number[][] = [];
  /** Π of 1, 2, 4, … periods from a time into the period on. */
  private powersFrom = NaN;
  private powers: Float64Array[] = [];

  /**
   * @param period A day, or a week from Monday. [s]
   * @param rates Of each phase, by rows, without the diagonal. [1/s]
   */
  constructor(readonly period: number, rates: number[], private readonly states: number) {
    const count = states * (states - 1);
    for (let begin = 0; begin + count <= rates.length; begin += count) {
      this.phases.push(this.matrix(rates.slice(begin, begin + count)));
    }
  }

  /** Whether its rates are in this page. */
  get known(): boolean { return this.phases.length > 0; }

  get name(): string { return this.period === WEEK_S ? 'hour of the week' : 'hour of the day'; }

  /** p(to) from p(from), `to` not earlier. Times are seconds since the epoch. */
  propagate(p: number[], from: number, to: number): number[] {
    const into = this.into(from);
    let elapsed = to - from;
    let moved = Float64Array.from(p);
    let periods = Math.floor(elapsed / this.period);
    if (periods >= MANY_PERIODS) {
      elapsed -= periods * this.period;
      if (into !== this.powersFrom) this.powers = [this.onePeriod(into)];
      this.powersFrom = into;
      for (let i = 0; periods > 0; ++i, periods = Math.floor(periods / 2)) {
        const power = this.powers[i] ??= normalized(product(this.powers[i - 1]!, this.powers[i - 1]!, this.states));
        if (periods % 2 === 1) moved = times(moved, power);
      }
    }
    moved = this.advance(moved, into, elapsed);
    const sum = moved.reduce((a, b) => a + b, 0);
    return Array.from(moved, (value) => value / sum);
  }

  private matrix(others: number[]): number[] {
    const n = this.states;
    const rows: number[] = [];
    for (let from = 0; from < n; ++from) {
      const out = others.slice(from * (n - 1), (from + 1) * (n - 1));
      out.splice(from, 0, -out.reduce((a, b) => a + b, 0));
      rows.push(...out);
    }
    return rows;
  }

  private into(time: number): number {
    // The epoch was a Thursday.
    const shifted = time + (this.period === WEEK_S ? 3 * DAY_S : 0);
    return ((shifted % this.period) + this.period) % this.period;
  }

  private onePeriod(into: number): Float64Array {
    const matrix = new Float64Array(this.states ** 2);
    for (let from = 0; from < this.states; ++from) {
      const row = new Float64Array(this.states);
      row[from] = 1;
      matrix.set(this.advance(row, into, this.period), from * this.states);
    }
    return normalized(matrix);
  }

  private advance(p: Float64Array<ArrayBuffer>, into: number, elapsed: number): Float64Array<ArrayBuffer> {
    const length = this.period / this.phases.length;
    let phase = Math.min(Math.floor(into / length), this.phases.length - 1);
    let left = (phase + 1) * length - into;
    let moved = p;
    for (; elapsed > 0; elapsed -= left, left = length, phase = (phase + 1) % this.phases.length) {
      moved = this.advanceIn(moved, this.phases[phase]!, Math.min(left, elapsed));
    }
    return moved;
  }

  // With P = I + Q / Λ, Λ the fastest rate of leaving, exp(Q t) = Σ_k Poisson(k; Λ t) P^k.
  private advanceIn(p: Float64Array<ArrayBuffer>, rates: number[], seconds: number): Float64Array<ArrayBuffer> {
    const n = this.states;
    let fastest = 0;
    for (let i = 0; i < n; ++i) fastest = Math.max(fastest, -rates[i * (n + 1)]!);
    const jumps = fastest * seconds;
    if (!(jumps > 0)) return p;
    if (jumps > MOST_JUMPS) return times(p, transition(rates, n, seconds));
    let weight = Math.exp(-jumps);
    let term = p;
    const sum = p.map((value) => value * weight);
    for (let k = 1; k < jumps || weight > NEGLIGIBLE; ++k) {
      const step = times(term, rates);
      for (let i = 0; i < n; ++i) step[i] = term[i]! + step[i]! / fastest;
      term = step;
      weight *= jumps / k;
      for (let i = 0; i < n; ++i) sum[i]! += weight * term[i]!;
    }
    return sum;
  }
}

/** A row times a matrix. */
function times(row: Float64Array, matrix: ArrayLike<number>): Float64Array<ArrayBuffer> {
  const n = row.length;
  const result = new Float64Array(n);
  for (let from = 0; from < n; ++from) {
    for (let to = 0; to < n; ++to) result[to]! += row[from]! * matrix[from * n + to]!;
  }
  return result;
}

/** Each row over its sum. */
function normalized(matrix: Float64Array<ArrayBuffer>): Float64Array<ArrayBuffer> {
  const n = Math.sqrt(matrix.length);
  for (let from = 0; from < n; ++from) {
    const row = matrix.subarray(from * n, (from + 1) * n);
    const sum = row.reduce((a, b) => a + b, 0);
    row.forEach((value, to) => { row[to] = value / sum; });
  }
  return matrix;
}
