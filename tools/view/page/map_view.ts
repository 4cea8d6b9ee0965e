// SPDX-License-Identifier: Apache-2.0
import {quadtree, type Quadtree} from 'd3-quadtree';
import {select, type Selection} from 'd3-selection';
import {zoom, zoomIdentity, zoomTransform, type ZoomBehavior, type ZoomTransform} from 'd3-zoom';
import type {Group, LandmarkMap, Run} from './data';
import {
  drawAnonymous, drawGrid, drawLinks, drawRulers, drawRuns, LabelPlacer, ModeMarks, reserveRulers, toX, toY,
  type Context, type Frame, type Theme,
} from './layers';
import {modeName, percent} from './markup';

export interface ViewSettings {
  sigmas: number;
  /** Ellipses of positions to each other, not of those in the map frame. */
  relative: boolean;
  runs: boolean;
  labels: boolean;
}

/** More that is drawn over the marks, e.g. differences or a vehicle, and what labels are to keep clear of. */
export type Overlay = (context: Context, frame: Frame, theme: Theme, labels: LabelPlacer) => void;

/** From a mark to its label, past the ring of a change. [px] */
const LABEL_GAP = 9;
const LABEL_GAP_OF_RINGS = 20;

/** Where more modes than this are in view, nobody could tell whose a label is. */
const MOST_LABELLED = 400;

interface Bounds { x0: number; y0: number; x1: number; y1: number; }

export function boundsOf(map: LandmarkMap, runs: Run[]): Bounds {
  const bounds = {x0: Infinity, y0: Infinity, x1: -Infinity, y1: -Infinity};
  const add = (x: number, y: number) => {
    bounds.x0 = Math.min(bounds.x0, x);
    bounds.x1 = Math.max(bounds.x1, x);
    bounds.y0 = Math.min(bounds.y0, y);
    bounds.y1 = Math.max(bounds.y1, y);
  };
  for (const group of map.groups) for (const mode of group.modes) add(mode.x, mode.y);
  for (const mode of map.anonymous) add(mode.x, mode.y);
  for (const run of runs) for (let i = 0; i + 1 < run.path.length; i += 2) add(run.path[i]!, run.path[i + 1]!);
  return bounds.x0 <= bounds.x1 ? bounds : {x0: -5, y0: -5, x1: 5, y1: 5};
}

/** One map on a canvas: pan, zoom, pick; draws itself at most once a frame. */
export class MapView {
  readonly marks: ModeMarks;
  selected: Group | null = null;
  overlay: Overlay | null = null;
  runs: Run[] = [];
  /** Whether the overlay draws rings around marks. */
  ringed = false;
  time = 0;
  onPick: (group: Group | null) => void = () => {};
  onMove: (transform: ZoomTransform) => void = () => {};

  private readonly context: Context;
  private readonly zoomed: ZoomBehavior<HTMLCanvasElement, unknown>;
  private readonly selection: Selection<HTMLCanvasElement, unknown, null, undefined>;
  private readonly tree: Quadtree<number>;
  private probabilities: (group: number) => number[];
  private width = 0;
  private height = 0;
  private requested = false;
  private fitted = false;

  constructor(
      readonly canvas: HTMLCanvasElement, readonly map: LandmarkMap, private readonly bounds: Bounds,
      public theme: Theme, readonly settings: ViewSettings) {
    this.context = canvas.getContext('2d', {alpha: false})!;
    this.marks = new ModeMarks(map);
    this.marks.chooseEllipses(settings.relative);
    this.probabilities = (group) => map.groups[group]!.probabilities;
    this.tree = quadtree(
        this.marks.modes.map((_, i) => i),
        (i) => this.marks.modes[i]!.x, (i) => this.marks.modes[i]!.y);
    this.zoomed = zoom<HTMLCanvasElement, unknown>().on('zoom', (event: {sourceEvent?: unknown}) => {
      this.draw();
      if (event.sourceEvent) this.onMove(zoomTransform(this.canvas));
    });
    this.selection = select(canvas);
    this.selection.call(this.zoomed).on('dblclick.zoom', null);
    canvas.addEventListener('click', (event) => this.onPick(this.pick(event.offsetX, event.offsetY)));
    canvas.addEventListener('keydown', (event) => this.onKey(event));
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.setProbabilities(this.probabilities);
  }

  setProbabilities(probabilities: (group: number) => number[]): void {
    this.probabilities = probabilities;
    this.marks.update(probabilities);
    this.draw();
  }

  /** The whole map. */
  fit(): void {
    const {x0, y0, x1, y1} = this.bounds;
    const k = Math.min(
        (this.width - 110) / Math.max(x1 - x0, 1), (this.height - 80) / Math.max(y1 - y0, 1));
    this.zoomed.scaleExtent([k / 4, Math.max(k * 8, 4000)]);
    this.moveTo((x0 + x1) / 2, (y0 + y1) / 2, k);
  }

  /** Puts a landmark in the middle; comes nearer if it is a dot. */
  show(group: Group): void {
    const best = group.modes[this.mostProbable(group)] ?? group.modes[0];
    if (best) this.moveTo(best.x, best.y, Math.max(zoomTransform(this.canvas).k, 20));
  }

  follow(transform: ZoomTransform): void {
    this.selection.call(this.zoomed.transform, transform);
  }

  draw(): void {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame(() => {
      this.requested = false;
      this.drawNow();
    });
  }

  frame(): Frame {
    const t = zoomTransform(this.canvas);
    return {k: t.k, tx: t.x, ty: t.y, width: this.width, height: this.height};
  }

  /** The most probable mode, counted from 0; -1 if that is `absent`. */
  private mostProbable(group: Group): number {
    const p = this.probabilities(group.index);
    return p.indexOf(Math.max(...p)) - 1;
  }

  private moveTo(x: number, y: number, k: number): void {
    // Plus 14 pixels: the rulers are to the left and below.
    const t = zoomIdentity.translate(this.width / 2 + 14 - k * x, this.height / 2 - 10 + k * y).scale(k);
    this.selection.call(this.zoomed.transform, t);
    this.onMove(t);
  }

  private pick(px: number, py: number): Group | null {
    const frame = this.frame();
    const mode = this.tree.find(
        (px - frame.tx) / frame.k, (frame.ty - py) / frame.k, 14 / frame.k);
    return mode === undefined ? null : this.map.groups[this.marks.groupOf[mode]!]!;
  }

  private onKey(event: KeyboardEvent): void {
    const step = 60 / zoomTransform(this.canvas).k;
    const pans: Record<string, [number, number]> = {
      ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step],
    };
    const pan = pans[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (pan) this.zoomed.translateBy(this.selection, ...pan);
    else if (event.key === '+' || event.key === '=') this.zoomed.scaleBy(this.selection, 1.4);
    else if (event.key === '-') this.zoomed.scaleBy(this.selection, 1 / 1.4);
    else if (event.key === '0') this.fit();
    else return;
    event.preventDefault();
    this.onMove(zoomTransform(this.canvas));
  }

  private resize(): void {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (width === 0 || height === 0) return;
    const [dx, dy] = [(width - this.width) / 2, (height - this.height) / 2];
    this.width = width;
    this.height = height;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    if (this.fitted) this.zoomed.translateBy(this.selection, dx / this.frame().k, dy / this.frame().k);
    else this.fit();
    this.fitted = true;
    this.drawNow();
  }

  private drawNow(): void {
    const {context, theme} = this;
    const frame = this.frame();
    const ratio = this.canvas.width / Math.max(1, this.width);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.globalAlpha = 1;
    context.fillStyle = theme.ground;
    context.fillRect(0, 0, frame.width, frame.height);
    drawGrid(context, frame, theme);
    if (this.settings.runs) drawRuns(context, frame, theme, this.runs, this.time);
    drawAnonymous(context, frame, theme, this.map.anonymous);
    this.marks.draw(context, frame, theme, this.settings.sigmas);
    if (this.selected) this.drawSelected(this.selected, frame);
    const labels = new LabelPlacer();
    reserveRulers(frame, labels);
    this.overlay?.(context, frame, theme, labels);
    if (this.selected) this.labelSelected(this.selected, frame, labels);
    const crowded = this.marks.countVisible(frame) > MOST_LABELLED;
    if (this.settings.labels && !crowded) this.drawLabels(frame, labels);
    drawRulers(context, frame, theme);
  }

  private drawSelected(group: Group, frame: Frame): void {
    const {context, theme} = this;
    drawLinks(context, frame, theme.ink, group.modes);
    context.strokeStyle = theme.ink;
    context.lineWidth = 2;
    for (const mode of group.modes) {
      context.beginPath();
      context.arc(toX(frame, mode.x), toY(frame, mode.y), 8, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  private labelSelected(group: Group, frame: Frame, labels: LabelPlacer): void {
    const p = this.probabilities(group.index);
    group.modes.forEach((mode, i) => {
      labels.draw(this.context, this.theme, {
        x: toX(frame, mode.x), y: toY(frame, mode.y), gap: LABEL_GAP + 3, strong: true,
        text: `${group.name} ${modeName(mode.number)}: ${percent(p[i + 1] ?? 0)}`,
      });
    });
  }

  // Of the landmarks in view, at their most probable position.
  private drawLabels(frame: Frame, labels: LabelPlacer): void {
    const gap = this.ringed ? LABEL_GAP_OF_RINGS : LABEL_GAP;
    for (const group of this.map.groups) {
      const mode = group.modes[Math.max(0, this.mostProbable(group))];
      if (group === this.selected || !mode) continue;
      const [x, y] = [toX(frame, mode.x), toY(frame, mode.y)];
      if (x < 0 || y < 0 || x > frame.width || y > frame.height) continue;
      labels.draw(this.context, this.theme, {x, y, gap, text: group.name});
    }
  }
}
