// SPDX-License-Identifier: Apache-2.0
//
// A recorded shift, and its vehicle on the map.
import {STEP_COLUMNS, type Replay} from './data';
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
  /** Sum of the normalized innovations squared, 2 degrees of freedom an update. */
  nis: number;
  updates: number;
}

export interface Sample {
  time: number;
  kept: number;
  heaviest: Hypothesis[];
}

export interface Decision {
  time: number;
  signature: number;
  mode: number;
  logOdds: number;
  withdrawn: boolean;
}

/** The last item at or before a time. */
function lastBefore<T extends {time: number}>(items: T[], time: number): T | undefined {
  let low = -1;
  let high = items.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (items[middle]!.time <= time) low = middle;
    else high = middle;
  }
  return items[low];
}

export class Shift {
  readonly steps: Step[] = [];
  readonly samples: Sample[];
  readonly states: {time: number; state: number}[];
  readonly decisions: Decision[];

  constructor(readonly replay: Replay) {
    const seconds = (ms: number) => replay.origin_s + ms / 1e3;
    for (let i = 0; i + STEP_COLUMNS <= replay.steps.length; i += STEP_COLUMNS) {
      const [ms, state, x, y, yaw, major, minor, angle, nis, updates] =
          replay.steps.slice(i, i + STEP_COLUMNS) as
          [number, number, number, number, number, number, number, number, number, number];
      this.steps.push({
        time: seconds(ms), state, nis, updates,
        x: x / 1e3, y: y / 1e3, yaw: yaw / 1e3,
        major: major / 1e3, minor: minor / 1e3, angle: angle / 1e3,
      });
    }
    this.samples = replay.hypotheses.map(([ms, kept, ...row]) => {
      const heaviest: Hypothesis[] = [];
      for (let i = 0; i + 4 <= row.length; i += 4) {
        heaviest.push({
          weight: row[i]! / 1e3, x: row[i + 1]! / 1e3, y: row[i + 2]! / 1e3, yaw: row[i + 3]! / 1e3});
      }
      return {time: seconds(ms!), kept: kept!, heaviest};
    });
    this.states = replay.states.map(([ms, state]) => ({time: seconds(ms), state}));
    // A shift begins without a pose.
    if (this.states.length === 0 || this.states[0]!.time > this.begin) {
      this.states.unshift({time: this.begin, state: this.steps[0]?.state ?? 0});
    }
    this.decisions = replay.decisions.map(([ms, signature, mode, logOdds, withdrawn]) =>
        ({time: seconds(ms), signature, mode, logOdds, withdrawn: withdrawn === 1}));
  }

  get begin(): number { return this.replay.origin_s; }
  get end(): number { return this.steps.at(-1)?.time ?? this.begin; }

  stepAt(time: number): Step | undefined { return lastBefore(this.steps, time); }
  sampleAt(time: number): Sample | undefined { return lastBefore(this.samples, time); }
  stateAt(time: number): number { return lastBefore(this.states, time)?.state ?? 0; }

  draw(context: Context, frame: Frame, theme: Theme, time: number, sigmas: number): void {
    context.lineWidth = 2;
    context.lineJoin = 'round';
    context.strokeStyle = theme.ink;
    context.globalAlpha = 0.7;
    context.beginPath();
    for (const step of this.steps) {
      if (step.time > time) break;
      context.lineTo(toX(frame, step.x), toY(frame, step.y));
    }
    context.stroke();
    context.globalAlpha = 1;
    const step = this.stepAt(time);
    if (!step) return;
    for (const hypothesis of this.sampleAt(time)?.heaviest ?? []) {
      context.globalAlpha = 0.25 + 0.6 * hypothesis.weight;
      drawVehicle(context, frame, hypothesis, theme.moved, 17);
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
