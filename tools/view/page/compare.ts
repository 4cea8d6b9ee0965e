// SPDX-License-Identifier: Apache-2.0
//
// The difference of two maps: modes are the same if signature and number are (mapstore/map/map_diff.h).
import type {LandmarkMap, Mode} from './data';
import {toX, toY, type Context, type Frame, type LabelPlacer, type Theme} from './layers';

export interface ModeChange {
  signature: number;
  name: string;
  from: Mode | null;
  to: Mode | null;
  /** To minus from. [m] */
  distance: number;
  /** Of at least that distance by chance, against the sum of both covariances; chi-square, 2 dof. */
  pValue: number;
}

export interface MapChanges {
  moved: ModeChange[];
  fresh: ModeChange[];
  gone: ModeChange[];
  /** Modes of both that moved by no more than chance explains. */
  same: number;
}

/** Less than this is taken for a move. */
const SIGNIFICANT = 0.01;

function covariance(mode: Mode): [number, number, number] {
  const [c, s] = [Math.cos(mode.angle), Math.sin(mode.angle)];
  const [a, b] = [mode.major ** 2, mode.minor ** 2];
  return [a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c];
}

function movedBy(from: Mode, to: Mode): {distance: number; pValue: number} {
  const [dx, dy] = [to.x - from.x, to.y - from.y];
  const [p, q] = [covariance(from), covariance(to)];
  const [xx, xy, yy] = [p[0] + q[0], p[1] + q[1], p[2] + q[2]];
  const determinant = Math.max(xx * yy - xy * xy, 1e-18);
  const squared = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant;
  return {distance: Math.hypot(dx, dy), pValue: Math.exp(-squared / 2)};
}

export function compareMaps(from: LandmarkMap, to: LandmarkMap): MapChanges {
  const changes: MapChanges = {moved: [], fresh: [], gone: [], same: 0};
  for (const group of from.groups) {
    const other = to.bySignature.get(group.signature);
    for (const mode of group.modes) {
      const base = {signature: group.signature, name: group.name, from: mode};
      const now = other?.modes.find((m) => m.number === mode.number);
      if (!now) {
        changes.gone.push({...base, to: null, distance: 0, pValue: 0});
        continue;
      }
      const moved = movedBy(mode, now);
      if (moved.pValue < SIGNIFICANT) changes.moved.push({...base, to: now, ...moved});
      else ++changes.same;
    }
  }
  for (const group of to.groups) {
    const other = from.bySignature.get(group.signature);
    for (const mode of group.modes) {
      if (other?.modes.some((m) => m.number === mode.number)) continue;
      changes.fresh.push(
          {signature: group.signature, name: group.name, from: null, to: mode, distance: 0, pValue: 0});
    }
  }
  changes.moved.sort((a, b) => b.distance - a.distance);
  return changes;
}

/** Rings, and an arrow for what moved; shapes differ, not only colours. */
export function drawChanges(
    context: Context, frame: Frame, theme: Theme, labels: LabelPlacer, changes: MapChanges): void {
  context.lineWidth = 2.25;
  const ring = (mode: Mode, color: string, sign: string) => {
    const [x, y] = [toX(frame, mode.x), toY(frame, mode.y)];
    if (x < -20 || y < -20 || x > frame.width + 20 || y > frame.height + 20) return;
    context.strokeStyle = context.fillStyle = color;
    context.beginPath();
    context.arc(x, y, 9, 0, 2 * Math.PI);
    context.stroke();
    context.font = '700 14px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    context.fillText(sign, x, y - 16);
    labels.reserve(x - 9, y - 9, 18, 18);
    labels.reserve(x - 5, y - 22, 10, 12);
  };
  for (const change of changes.fresh) ring(change.to!, theme.fresh, '+');
  context.setLineDash([3, 3]);
  for (const change of changes.gone) ring(change.from!, theme.gone, '−');
  context.setLineDash([]);
  for (const change of changes.moved) drawArrow(context, frame, theme.moved, change.from!, change.to!);
}

function drawArrow(context: Context, frame: Frame, color: string, from: Mode, to: Mode): void {
  const [x0, y0, x1, y1] = [toX(frame, from.x), toY(frame, from.y), toX(frame, to.x), toY(frame, to.y)];
  context.strokeStyle = color;
  context.beginPath();
  context.arc(x1, y1, 9, 0, 2 * Math.PI);
  const length = Math.hypot(x1 - x0, y1 - y0);
  if (length > 12) {
    const [ux, uy] = [(x1 - x0) / length, (y1 - y0) / length];
    const [tipX, tipY] = [x1 - 9 * ux, y1 - 9 * uy];
    context.moveTo(x0, y0);
    context.lineTo(tipX, tipY);
    context.moveTo(tipX - 7 * ux + 4 * uy, tipY - 7 * uy - 4 * ux);
    context.lineTo(tipX, tipY);
    context.lineTo(tipX - 7 * ux - 4 * uy, tipY - 7 * uy + 4 * ux);
  }
  context.stroke();
}
