// SPDX-License-Identifier: Apache-2.0
//
// A recorded shift, and its vehicle on the map.
import {STATES, STEP_COLUMNS, type Document, type Replay} from './data';
import {toX, toY, type Context, type Frame, type Theme} from './layers';

export interface Hypothesis {
  weight: number;
  x: number;
  y: number;
  yaw: number;
}

export interface Step {
  time: number;
  state: number;
  /** [m], [rad] */
  x: number;
  y: number;
  yaw: number;
  major: number;
  minor: number;
  angle: number;
  /** Sum of the normalized innovations squared of the scan, 2 degrees of freedom an update. */
  nis: number;
  updates: number;
  leaves: number;
}

export class Shift {
  readonly steps: Step[] = [];

  constructor(readonly replay: Replay, readonly source: Document) {
    const {steps} = replay;
    for (let i = 0; i + STEP_COLUMNS <= steps.length; i += STEP_COLUMNS) {
      const [ms, state, x, y, yaw, major, minor, angle, nis, updates, leaves] =
          steps.slice(i, i + STEP_COLUMNS) as
          [number, number, number, number, number, number, number, number, number, number, number];
      this.steps.push({
        time: source.origin_s + ms / 1e3, state, nis, updates, leaves,
        x: x / 1e3, y: y / 1e3, yaw: yaw / 1e3,
        major: major / 1e3, minor: minor / 1e3, angle: angle / 1e3,
      });
    }
  }

  get begin(): number { return this.steps[0]?.time ?? 0; }
  get end(): number { return this.steps.at(-1)?.time ?? 0; }

  /** Index of the last step at or before a time; -1 before the first. */
  indexAt(time: number): number {
    let low = -1;
    let high = this.steps.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.steps[middle]!.time <= time) low = middle;
      else high = middle;
    }
    return low;
  }

  hypothesesAt(index: number): Hypothesis[] {
    const row = this.replay.hypotheses[index] ?? [];
    const found: Hypothesis[] = [];
    for (let i = 0; i + 4 <= row.length; i += 4) {
      found.push({
        weight: row[i]! / 1e3, x: row[i + 1]! / 1e3, y: row[i + 2]! / 1e3, yaw: row[i + 3]! / 1e3});
    }
    return found;
  }

  draw(context: Context, frame: Frame, theme: Theme, time: number, sigmas: number): void {
    const last = this.indexAt(time);
    context.lineWidth = 2;
    context.lineJoin = 'round';
    context.strokeStyle = theme.ink;
    context.beginPath();
    for (let i = 0; i <= last; ++i) {
      const step = this.steps[i]!;
      if (!located(step)) continue;
      context.lineTo(toX(frame, step.x), toY(frame, step.y));
    }
    context.stroke();
    const step = this.steps[last];
    if (!step || !located(step)) return;
    for (const hypothesis of this.hypothesesAt(last)) {
      context.globalAlpha = 0.2 + 0.6 * hypothesis.weight;
      drawVehicle(context, frame, hypothesis, theme.moved, 11);
    }
    context.globalAlpha = 1;
    context.strokeStyle = theme.ink;
    context.lineWidth = 1.5;
    context.beginPath();
    context.ellipse(
        toX(frame, step.x), toY(frame, step.y), step.major * sigmas * frame.k,
        step.minor * sigmas * frame.k, -step.angle, 0, 2 * Math.PI);
    context.stroke();
    drawVehicle(context, frame, step, theme.ink, 12);
  }
}

export function located(step: Step): boolean { return STATES[step.state] !== 'INITIALIZING'; }

/** An arrow head along x of the vehicle. */
function drawVehicle(
    context: Context, frame: Frame, pose: {x: number; y: number; yaw: number}, color: string, size: number): void {
  context.save();
  context.translate(toX(frame, pose.x), toY(frame, pose.y));
  context.rotate(-pose.yaw);
  context.fillStyle = color;
  context.beginPath();
  context.moveTo(size, 0);
  context.lineTo(-size * 0.6, size * 0.55);
  context.lineTo(-size * 0.25, 0);
  context.lineTo(-size * 0.6, -size * 0.55);
  context.fill();
  context.restore();
}
