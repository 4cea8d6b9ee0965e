// SPDX-License-Identifier: Apache-2.0
//
// What a map view draws, back to front, onto a canvas in CSS pixels.
import type {Ellipse, LandmarkMap, Mode, Run} from './data';

/** The colours of style.css, for canvases. Those of marks are Okabe and Ito's. */
export interface Theme {
  ground: string;
  grid: string;
  ink: string;
  muted: string;
  mode: string;
  absent: string;
  fresh: string;
  gone: string;
  moved: string;
  run: string;
  series: string[];
}

export function readTheme(): Theme {
  const style = getComputedStyle(document.documentElement);
  const color = (name: string) => style.getPropertyValue(`--${name}`).trim();
  return {
    ground: color('ground'), grid: color('grid'), ink: color('ink'), muted: color('muted'),
    mode: color('mode'), absent: color('absent'), fresh: color('fresh'), gone: color('gone'),
    moved: color('moved'), run: color('run'),
    series: [1, 2, 3, 4, 5, 6].map((i) => color(`series-${i}`)),
  };
}

/** Map to canvas: px = k x + tx, py = -k y + ty, of a canvas of this size. */
export interface Frame {
  k: number;
  tx: number;
  ty: number;
  width: number;
  height: number;
}

export type Context = CanvasRenderingContext2D;
export const FONT = '12px system-ui, sans-serif';
export const toX = (frame: Frame, x: number) => frame.k * x + frame.tx;
export const toY = (frame: Frame, y: number) => -frame.k * y + frame.ty;

/** 1, 2 or 5 times a power of ten, at least `value`. */
export function niceStep(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([1, 2, 5].find((factor) => factor * power >= value) ?? 10);
}

function metreText(value: number, step: number): string {
  return value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9))).replace('-', '−');
}

/** Grid lines; drawn below everything. */
export function drawGrid(context: Context, frame: Frame, theme: Theme): void {
  const step = niceStep(90 / frame.k);
  context.strokeStyle = theme.grid;
  context.lineWidth = 1;
  context.beginPath();
  for (let x = Math.ceil(-frame.tx / frame.k / step) * step; toX(frame, x) < frame.width; x += step) {
    context.moveTo(Math.round(toX(frame, x)) + 0.5, 0);
    context.lineTo(Math.round(toX(frame, x)) + 0.5, frame.height);
  }
  const lowest = (frame.ty - frame.height) / frame.k;
  for (let y = Math.ceil(lowest / step) * step; toY(frame, y) > 0; y += step) {
    context.moveTo(0, Math.round(toY(frame, y)) + 0.5);
    context.lineTo(frame.width, Math.round(toY(frame, y)) + 0.5);
  }
  context.stroke();
}

function plate(context: Context, theme: Theme, x: number, y: number, w: number, h: number): void {
  context.globalAlpha = 0.85;
  context.fillStyle = theme.ground;
  context.fillRect(x, y, w, h);
  context.globalAlpha = 1;
}

/** Coordinates along two edges, the scale bar and the directions of the axes; above everything. */
export function drawRulers(context: Context, frame: Frame, theme: Theme): void {
  const step = niceStep(90 / frame.k);
  context.font = '11px system-ui, sans-serif';
  plate(context, theme, 0, frame.height - 18, frame.width, 18);
  plate(context, theme, 0, 0, 44, frame.height);
  context.fillStyle = theme.muted;
  context.textAlign = 'center';
  context.textBaseline = 'middle';
  for (let x = Math.ceil((50 - frame.tx) / frame.k / step) * step;
       toX(frame, x) < frame.width - 20; x += step) {
    context.fillText(metreText(x, step), toX(frame, x), frame.height - 9);
  }
  context.textAlign = 'right';
  const lowest = (frame.ty - frame.height + 24) / frame.k;
  for (let y = Math.ceil(lowest / step) * step; toY(frame, y) > 8; y += step) {
    context.fillText(metreText(y, step), 40, toY(frame, y));
  }
  drawScale(context, frame, theme);
  drawAxes(context, frame, theme);
}

/** Keeps labels clear of what drawRulers draws. */
export function reserveRulers(frame: Frame, labels: LabelPlacer): void {
  labels.reserve(0, 0, 44, frame.height);
  labels.reserve(0, frame.height - 18, frame.width, 18);
  labels.reserve(50, frame.height - 66, 80, 48);
  const scale = niceStep(70 / frame.k) * frame.k;
  labels.reserve(frame.width - 20 - scale, frame.height - 48, scale + 20, 30);
}

function drawScale(context: Context, frame: Frame, theme: Theme): void {
  const length = niceStep(70 / frame.k);
  const x = frame.width - 14 - length * frame.k;
  const y = frame.height - 28;
  plate(context, theme, x - 6, y - 20, length * frame.k + 12, 26);
  context.strokeStyle = theme.ink;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, y - 4);
  context.lineTo(x, y);
  context.lineTo(x + length * frame.k, y);
  context.lineTo(x + length * frame.k, y - 4);
  context.stroke();
  context.fillStyle = theme.ink;
  context.textAlign = 'center';
  const text = length < 1 ? `${+(length * 100).toPrecision(1)} cm`
      : length < 1000 ? `${length} m` : `${length / 1000} km`;
  context.fillText(text, x + length * frame.k / 2, y - 11);
}

function drawAxes(context: Context, frame: Frame, theme: Theme): void {
  const [x, y, length] = [58, frame.height - 32, 26];
  context.strokeStyle = context.fillStyle = theme.ink;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, y - length);
  context.lineTo(x, y);
  context.lineTo(x + length, y);
  context.moveTo(x - 3, y - length + 5);
  context.lineTo(x, y - length);
  context.lineTo(x + 3, y - length + 5);
  context.moveTo(x + length - 5, y - 3);
  context.lineTo(x + length, y);
  context.lineTo(x + length - 5, y + 3);
  context.stroke();
  context.textAlign = 'left';
  context.fillText('x / m', x + length + 4, y);
  context.fillText('y / m', x + 7, y - length + 2);
}

export function drawRuns(context: Context, frame: Frame, theme: Theme, runs: Run[], time: number): void {
  context.strokeStyle = theme.run;
  context.lineWidth = 1;
  context.lineJoin = 'round';
  for (const run of runs) {
    // Those of the future are fainter.
    context.globalAlpha = run.begin <= time ? 0.6 : 0.2;
    context.beginPath();
    for (let i = 0; i + 1 < run.path.length; i += 2) {
      context.lineTo(toX(frame, run.path[i]!), toY(frame, run.path[i + 1]!));
    }
    context.stroke();
  }
  context.globalAlpha = 1;
}

/** Levels of opacity: what has the same is one path. */
export const LEVELS = 16;
const alphaOf = (level: number) => 0.12 + 0.88 * level / (LEVELS - 1);

/** All modes of a map in flat arrays, ordered by level of probability. */
export class ModeMarks {
  readonly modes: Mode[] = [];
  /** Index of the group of each mode. */
  readonly groupOf: Int32Array;
  readonly probability: Float32Array;
  /** Per group. */
  readonly absent: Float32Array;
  private readonly xs: Float64Array;
  private readonly ys: Float64Array;
  private readonly order: Int32Array;
  private ellipses: Ellipse[] = [];
  private longest = 0;
  private readonly levelBegin = new Int32Array(LEVELS + 1);

  constructor(readonly map: LandmarkMap) {
    const groups: number[] = [];
    for (const group of map.groups) {
      for (const mode of group.modes) {
        this.modes.push(mode);
        groups.push(group.index);
      }
    }
    this.groupOf = Int32Array.from(groups);
    this.xs = Float64Array.from(this.modes, (mode) => mode.x);
    this.ys = Float64Array.from(this.modes, (mode) => mode.y);
    this.chooseEllipses(true);
    this.probability = new Float32Array(this.modes.length);
    this.absent = new Float32Array(map.groups.length);
    this.order = new Int32Array(this.modes.length);
  }

  /** Those of positions to each other, where there are such, or those in the map frame. */
  chooseEllipses(relative: boolean): void {
    this.ellipses = this.modes.map((mode) => (relative && mode.relative) || mode);
    this.longest = this.ellipses.reduce((longest, ellipse) => Math.max(longest, ellipse.major), 0);
  }

  /** @param probabilities Of the states of a group, `absent` first. */
  update(probabilities: (group: number) => number[]): void {
    let mode = 0;
    for (const group of this.map.groups) {
      const p = probabilities(group.index);
      this.absent[group.index] = p[0] ?? 0;
      for (let i = 0; i < group.modes.length; ++i) this.probability[mode++] = p[i + 1] ?? 0;
    }
    const level = (i: number) =>
      Math.min(LEVELS - 1, Math.max(0, Math.round(this.probability[i]! * (LEVELS - 1))));
    const counts = new Int32Array(LEVELS + 1);
    for (let i = 0; i < this.modes.length; ++i) ++counts[level(i) + 1]!;
    for (let l = 0; l < LEVELS; ++l) counts[l + 1]! += counts[l]!;
    this.levelBegin.set(counts);
    for (let i = 0; i < this.modes.length; ++i) this.order[counts[level(i)]!++] = i;
  }

  draw(context: Context, frame: Frame, theme: Theme, sigmas: number): void {
    // Many marks are squares, which are drawn fast.
    const small = this.countVisible(frame) > 1500;
    for (let level = 0; level < LEVELS; ++level) {
      const [begin, end] = [this.levelBegin[level]!, this.levelBegin[level + 1]!];
      if (begin === end) continue;
      context.globalAlpha = alphaOf(level);
      this.drawEllipses(context, frame, theme, sigmas, begin, end);
      context.fillStyle = theme.mode;
      if (small) {
        this.forVisible(frame, begin, end, 0, (_, x, y) => context.fillRect(x - 1.5, y - 1.5, 3, 3));
        continue;
      }
      const radius = frame.k < 8 ? 3 : 4;
      context.beginPath();
      this.forVisible(frame, begin, end, 0, (_, x, y) => {
        context.moveTo(x + radius, y);
        context.arc(x, y, radius, 0, 2 * Math.PI);
      });
      context.fill();
    }
    context.globalAlpha = 1;
    this.drawAbsent(context, frame, theme);
  }

  countVisible(frame: Frame): number {
    let count = 0;
    this.forVisible(frame, 0, this.modes.length, 0, () => { ++count; });
    return count;
  }

  private forVisible(
      frame: Frame, begin: number, end: number, margin: number,
      visit: (mode: number, x: number, y: number) => void): void {
    for (let i = begin; i < end; ++i) {
      const mode = this.order[i]!;
      const x = toX(frame, this.xs[mode]!);
      const y = toY(frame, this.ys[mode]!);
      if (x < -margin || y < -margin || x > frame.width + margin || y > frame.height + margin) continue;
      visit(mode, x, y);
    }
  }

  private drawEllipses(
      context: Context, frame: Frame, theme: Theme, sigmas: number, begin: number, end: number): void {
    if (this.longest * sigmas * frame.k < 3) return;
    context.strokeStyle = theme.mode;
    context.lineWidth = 1;
    context.beginPath();
    this.forVisible(frame, begin, end, 200, (index, x, y) => {
      const ellipse = this.ellipses[index]!;
      const major = ellipse.major * sigmas * frame.k;
      if (major < 3) return;
      const minor = ellipse.minor * sigmas * frame.k;
      context.moveTo(x + major * Math.cos(ellipse.angle), y - major * Math.sin(ellipse.angle));
      context.ellipse(x, y, major, minor, -ellipse.angle, 0, 2 * Math.PI);
    });
    context.stroke();
  }

  /** A landmark that is most probably at none of its positions has a cross over each of them. */
  private drawAbsent(context: Context, frame: Frame, theme: Theme): void {
    context.strokeStyle = theme.absent;
    context.lineWidth = 1.75;
    context.beginPath();
    this.forVisible(frame, 0, this.modes.length, 8, (mode, x, y) => {
      if (this.absent[this.groupOf[mode]!]! <= 0.5) return;
      context.moveTo(x - 5, y - 5);
      context.lineTo(x + 5, y + 5);
      context.moveTo(x - 5, y + 5);
      context.lineTo(x + 5, y - 5);
    });
    context.stroke();
  }
}

/** Lines that join the modes of one landmark. */
export function drawLinks(context: Context, frame: Frame, color: string, modes: Mode[]): void {
  if (modes.length < 2) return;
  context.strokeStyle = color;
  context.lineWidth = 1;
  context.setLineDash([4, 3]);
  context.beginPath();
  for (const mode of modes) context.lineTo(toX(frame, mode.x), toY(frame, mode.y));
  context.stroke();
  context.setLineDash([]);
}

/** Static landmarks without a signature. */
export function drawAnonymous(context: Context, frame: Frame, theme: Theme, modes: Mode[]): void {
  context.strokeStyle = theme.muted;
  context.lineWidth = 1.25;
  context.beginPath();
  for (const mode of modes) {
    const [x, y] = [toX(frame, mode.x), toY(frame, mode.y)];
    context.moveTo(x, y - 4);
    context.lineTo(x + 4, y);
    context.lineTo(x, y + 4);
    context.lineTo(x - 4, y);
    context.closePath();
  }
  context.stroke();
}

export interface Label {
  x: number;
  y: number;
  text: string;
  /** From the mark to the text. [px] */
  gap: number;
  /** Bold, and drawn whatever it covers: above or below its place if there is room. */
  strong?: boolean;
}

/** Labels beside their marks, in order, each unless it would cover what has its place before. */
export class LabelPlacer {
  private static readonly widths = new Map<string, number>();
  private readonly cells = new Set<number>();

  draw(context: Context, theme: Theme, label: Label): boolean {
    context.font = label.strong ? `600 ${FONT}` : FONT;
    const text = label.text.length > 28 ? `${label.text.slice(0, 27)}…` : label.text;
    const width = this.widthOf(context, text);
    const places = (label.strong ? [0, 17, -17, 34, -34] : [0]).flatMap((down) =>
        [label.x + label.gap, label.x - label.gap - width].map((left) => [left, label.y + down] as const));
    const place = places.find(([x, y]) => this.isFree(x, y - 8, width, 15)) ?? (label.strong && places[0]);
    if (!place) return false;
    const [left, y] = place;
    this.reserve(left, y - 8, width, 15);
    context.textAlign = 'left';
    context.textBaseline = 'middle';
    context.lineWidth = 3;
    context.lineJoin = 'round';
    context.strokeStyle = theme.ground;
    context.strokeText(text, left, y);
    context.fillStyle = theme.ink;
    context.fillText(text, left, y);
    return true;
  }

  /** Keeps labels out of a rectangle. */
  reserve(x: number, y: number, width: number, height: number): void {
    for (const cell of this.cellsOf(x, y, width, height)) this.cells.add(cell);
  }

  private isFree(x: number, y: number, width: number, height: number): boolean {
    return this.cellsOf(x, y, width, height).every((cell) => !this.cells.has(cell));
  }

  private widthOf(context: Context, text: string): number {
    const key = context.font + text;
    let width = LabelPlacer.widths.get(key);
    if (width === undefined) {
      width = context.measureText(text).width;
      if (LabelPlacer.widths.size > 20000) LabelPlacer.widths.clear();
      LabelPlacer.widths.set(key, width);
    }
    return width;
  }

  // The page is cut into cells of 8 by 8 pixels.
  private cellsOf(x: number, y: number, width: number, height: number): number[] {
    const cells: number[] = [];
    for (let row = Math.floor(y / 8); row <= Math.floor((y + height) / 8); ++row) {
      for (let column = Math.floor(x / 8); column <= Math.floor((x + width) / 8); ++column) {
        cells.push((row + 512) * 4096 + column + 512);
      }
    }
    return cells;
  }
}
