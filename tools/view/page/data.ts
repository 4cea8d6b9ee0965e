// SPDX-License-Identifier: Apache-2.0
//
// The data document of the page, as map_document.cc writes it: arrays whose columns are named here.
import {Rhythm} from './rhythm';

/** Nothing more is ever read from outside: all that the page shows is in here. */
export interface Document {
  format: number;
  area: string;
  tool: string;
  made_s: number;
  at_s: number;
  /** What was known then; null: now. */
  known_s: number | null;
  published: number | null;
  shown: number;
  signatures: string[];
  vehicles: string[];
  /** Of runs: the log's name, or the UUID of a shift without one. */
  names: string[];
  /** Times of tracks and visits are milliseconds after this. [s] */
  origin_s: number;
  versions: VersionRow[];
  runs: RunRow[];
  maps: MapRow[];
  tracks: number[][];
  visits: VisitRow[][];
  /** Versions, and the time before which visits and probabilities are left out. */
  left_out: {versions: number; before_s?: number};
  replay?: Replay;
}

/** number, parent, created_s, stamp_s, content hash, tool */
export type VersionRow = [number, number | null, number, number, string, string];

/** name, vehicle, begin_s, end_s, version that mapped it, x and y in cm, each the change from before */
export type RunRow = [number, number, number, number, number, number[]];

/**
 * version, groups, anonymous landmarks; of the free network the standard deviation of the scale [1], then
 * of each mode in the order of groups: longer sd, shorter sd [0.1 mm], direction of the longer one [mrad]
 */
export type MapRow = [number, GroupRow[], number[], number[]];

/**
 * signature, leave rate or rate matrix by rows [1/s], modes, probabilities at the version's stamp in
 * 1/10000, `absent` first. A mode is MODE_COLUMNS numbers. Of a chain with a rhythm in the version that is
 * shown also: its period [s], then the rates of each phase by rows without the diagonal [1/s], unless they
 * are left out.
 */
export type GroupRow = [number, number | number[], number[], number[], number[]?];

/** number, x, y, longer sd, shorter sd [0.1 mm], direction of the longer one [mrad], last seen [s] */
const MODE_COLUMNS = 7;

/** begin and end [ms], vehicle, name of the run, mapped by a build (1) or reported (0), version, scans
 * that saw it, favoured mode, its log-likelihood ratio to the next [nat], decided mode or -1, log-odds
 * of the decision [nat], why it does not count, probabilities after it in 1/10000 if it does */
export type VisitRow = [
  number, number, number, number, number, number, number, number, number, number, number, string,
  number[],
];

export interface Visit {
  begin: number;
  end: number;
  vehicle: string;
  run: string;
  mapped: boolean;
  version: number;
  seen: number;
  favoured: number;
  logRatio: number;
  decided: number;
  logOdds: number;
  setAside: string;
  after: number[];
}

/** A recorded shift. Times are milliseconds after its own origin. */
export interface Replay {
  run: string;
  vehicle: string;
  version: number;
  /** Why the recording ends early, or empty. */
  truncation: string;
  origin_s: number;
  /** Per pose: ms; state; x, y [mm], yaw [mrad]; longer sd, shorter sd [mm], direction of the longer one
   * [mrad]; sum of NIS since the pose before, updates in it */
  steps: number[];
  /** Per sample: ms, hypotheses kept; then of the heaviest: weight [1/1000], x, y [mm], yaw [mrad] */
  hypotheses: number[][];
  /** ms, state from then on */
  states: [number, number][];
  /** ms, signature, mode, log-odds [nat], withdrawn (1) */
  decisions: [number, number, number, number, number][];
}
export const STEP_COLUMNS = 10;
export const STATES = ['INITIALIZING', 'TRACKING', 'MODE_CHANGED', 'UNKNOWN_CHANGE', 'LOST'];

export interface Ellipse {
  /** Standard deviations along its axes. [m] */
  major: number;
  minor: number;
  /** Of the longer axis, from x towards y. [rad] */
  angle: number;
}

/** Its own ellipse is that in the map frame. */
export interface Mode extends Ellipse {
  number: number;
  x: number;
  y: number;
  /** Of the position to the others, without frame and scale; absent if it has no covariance with them. */
  relative?: Ellipse;
  lastSeen: number;
}

export interface Group {
  index: number;
  signature: number;
  name: string;
  rates: number | number[];
  /** Instead of `rates`, where it is known. */
  rhythm?: Rhythm;
  modes: Mode[];
  /** At the version's stamp; entry 0 is `absent`. */
  probabilities: number[];
}

export interface LandmarkMap {
  version: number;
  stamp: number;
  groups: Group[];
  anonymous: Mode[];
  /** Standard deviation of the scale; null if the modes have no covariance with each other. [1] */
  scaleSd: number | null;
  bySignature: Map<number, Group>;
}

function readModes(row: number[]): Mode[] {
  const modes: Mode[] = [];
  for (let i = 0; i + MODE_COLUMNS <= row.length; i += MODE_COLUMNS) {
    const [number, x, y, major, minor, angle, lastSeen] = row.slice(i, i + MODE_COLUMNS) as
        [number, number, number, number, number, number, number];
    modes.push({
      number, lastSeen,
      x: x / 1e4, y: y / 1e4, major: major / 1e4, minor: minor / 1e4, angle: angle / 1e3,
    });
  }
  return modes;
}

export function readMap(document: Document, row: MapRow): LandmarkMap {
  const [version, groupRows, anonymous, [scaleSd, ...relative]] = row;
  const groups = groupRows.map(([signature, rates, modes, probabilities, rhythm], index): Group => ({
    index, signature, rates,
    rhythm: rhythm && new Rhythm(rhythm[0]!, rhythm.slice(1), probabilities.length),
    name: document.signatures[signature] ?? '',
    modes: readModes(modes),
    probabilities: probabilities.map((p) => p / 1e4),
  }));
  groups.flatMap((group) => group.modes).forEach((mode, i) => {
    const [major, minor, angle] = relative.slice(3 * i, 3 * i + 3);
    if (angle !== undefined) mode.relative = {major: major! / 1e4, minor: minor! / 1e4, angle: angle / 1e3};
  });
  return {
    version, groups, scaleSd: scaleSd ?? null,
    stamp: document.versions.find((v) => v[0] === version)?.[3] ?? document.at_s,
    anonymous: readModes(anonymous),
    bySignature: new Map(groups.map((group) => [group.signature, group])),
  };
}

export function readVisit(document: Document, row: VisitRow): Visit {
  const [begin, end, vehicle, run, mapped, version, seen, favoured, logRatio, decided, logOdds,
    setAside, after] = row;
  return {
    begin: document.origin_s + begin / 1e3, end: document.origin_s + end / 1e3,
    vehicle: document.vehicles[vehicle] ?? '', run: document.names[run] ?? '', mapped: mapped === 1,
    version, seen, favoured, logRatio, decided, logOdds, setAside, after: after.map((p) => p / 1e4),
  };
}

export interface Run {
  name: string;
  vehicle: string;
  begin: number;
  end: number;
  version: number;
  /** x0, y0, x1, y1, … [m] */
  path: Float32Array;
}

export function readRuns(document: Document): Run[] {
  return document.runs.map(([name, vehicle, begin, end, version, steps]) => {
    const path = new Float32Array(steps.length);
    for (let i = 0; i < steps.length; ++i) {
      path[i] = (i < 2 ? 0 : path[i - 2]!) + steps[i]! / 100;
    }
    return {name: document.names[name] ?? '', vehicle: document.vehicles[vehicle] ?? '', begin, end, version, path};
  });
}
