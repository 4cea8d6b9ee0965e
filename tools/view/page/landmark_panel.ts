// SPDX-License-Identifier: Apache-2.0
import type {Track} from './chain';
import type {Group, Visit} from './data';
import type {Theme} from './layers';
import {
  byId, durationText, element, fill, modeName, oddsText, percent, row, table, timeText,
} from './markup';
import {SeriesChart} from './series_chart';
import type {TimeScale} from './timeline';

const SAMPLES = 160;

/** Dashes tell the lines of modes apart without colours. */
const DASHES: number[][] = [[], [7, 3], [2, 2], [9, 3, 2, 3], [12, 4], [4, 4]];

export function seriesStyle(theme: Theme, state: number): {color: string; dash: number[]} {
  if (state === 0) return {color: theme.absent, dash: [3, 3]};
  const i = state - 1;
  return {
    color: theme.series[i % theme.series.length]!,
    dash: DASHES[Math.floor(i / theme.series.length + i) % DASHES.length]!,
  };
}

/** What the page knows of the selected landmark, at the present time. */
export class LandmarkPanel {
  private readonly place = byId<HTMLElement>('landmark');
  private chart: SeriesChart | null = null;
  private group: Group | null = null;
  private bars: HTMLElement[] = [];
  private values: HTMLElement[] = [];
  private rows: [HTMLTableRowElement, number][] = [];
  /** Whether errors are those of positions to each other, where there are such. */
  relative = true;
  onTime: (time: number) => void = () => {};

  constructor(public theme: Theme) {}

  show(group: Group, track: Track, visits: Visit[], leftOut: boolean, scale: TimeScale, time: number): void {
    this.chart?.destroy();
    this.group = group;
    const chartPlace = element('div', {class: 'chart'});
    fill(
        this.place,
        element('h2', {}, group.name),
        element('p', {class: 'muted'}, describeRates(group)),
        this.modeTable(group),
        element('h3', {}, 'Probability over time'),
        chartPlace,
        element('h3', {}, `Visits (${visits.length})`),
        visits.length > 0 && element('p', {class: 'muted'},
            '✓: the localizer decided. Odds are those of the visit alone.'),
        this.visitTable(visits),
        leftOut && element('p', {class: 'muted'}, 'Earlier visits are not in this page: ' +
            'shiftmap-inspect history lists all.'));
    this.chart = new SeriesChart(chartPlace, this.theme);
    this.fillChart(group, track, scale);
    this.setTime(time, track.at(time));
  }

  clear(): void {
    this.chart?.destroy();
    this.chart = null;
    this.group = null;
    this.place.replaceChildren();
  }

  setTime(time: number, probabilities: number[]): void {
    if (!this.group) return;
    this.chart?.setTime(time);
    probabilities.forEach((p, state) => {
      this.bars[state]!.style.width = `${100 * p}%`;
      this.values[state]!.textContent = percent(p);
    });
    for (const [line, begin] of this.rows) line.classList.toggle('later', begin > time);
  }

  private modeTable(group: Group): HTMLElement {
    this.bars = [];
    this.values = [];
    const relative = this.relative && group.modes.some((mode) => mode.relative);
    const rows = [0, ...group.modes.map((_, i) => i + 1)].map((state) => {
      const mode = group.modes[state - 1];
      const ellipse = mode && relative ? mode.relative ?? mode : mode;
      const bar = element('span', {class: 'bar'});
      const value = element('span', {class: 'number'});
      const style = seriesStyle(this.theme, state);
      bar.style.background = style.color;
      this.bars.push(bar);
      this.values.push(value);
      const line = row([
        element('span', {}, swatch(style), modeName(mode?.number ?? 0)),
        element('span', {class: 'meter'}, bar), value,
        mode ? `${mode.x.toFixed(2)}, ${mode.y.toFixed(2)}` : '–',
        ellipse ? `${(100 * ellipse.major).toFixed(1)} × ${(100 * ellipse.minor).toFixed(1)}` : '–',
      ]);
      if (mode && mode.lastSeen > 0) line.title = `last seen ${timeText(mode.lastSeen)} UTC`;
      return line;
    });
    return element(
        'div', {class: 'scroll'},
        table(['Mode', 'Probability', '', 'x, y / m', `${relative ? 'rel.' : 'map'} 1σ / cm`], rows, `Modes of ${group.name}`));
  }

  private visitTable(visits: Visit[]): HTMLElement {
    if (visits.length === 0) return element('p', {class: 'muted'}, 'No vehicle has visited it yet.');
    this.rows = [];
    const rows: HTMLTableRowElement[] = [];
    let day = '';
    for (const visit of [...visits].reverse()) {
      const [date, hour] = timeText(visit.begin).split(' ') as [string, string];
      if (date !== day) rows.push(element('tr', {}, element('th', {colspan: '6', class: 'day'}, date)));
      day = date;
      rows.push(this.visitRow(visit, hour));
    }
    return element('div', {class: 'scroll'}, table(
        ['Begin', 'Vehicle', 'Says', 'Odds', 'Seen', 'From'], rows, 'Visits, newest first'));
  }

  private visitRow(visit: Visit, hour: string): HTMLTableRowElement {
    const jump = element('button', {type: 'button', class: 'link'}, hour);
    jump.addEventListener('click', () => this.onTime(visit.end));
    const after = visit.after.map((p, state) =>
        `${modeName(state === 0 ? 0 : this.group!.modes[state - 1]!.number)} ${percent(p)}`);
    const line = row([
      jump, visit.vehicle || '–', verdict(visit), oddsText(visit.logRatio), String(visit.seen),
      visit.mapped ? 'build' : 'shift',
    ], {class: visit.setAside ? 'aside' : ''});
    line.title = [
      `${timeText(visit.begin)} UTC, ${durationText(visit.end - visit.begin)}, run ${visit.run}`,
      visit.mapped ? `mapped by version ${visit.version}` : `shift on version ${visit.version}`,
      visit.setAside ? `does not count: ${visit.setAside}` : `after it: ${after.join(', ')}`,
      ...(visit.decided >= 0
          ? [`decided ${modeName(visit.decided)} at odds of ${oddsText(visit.logOdds)}`] : []),
    ].join('\n');
    this.rows.push([line, visit.begin]);
    return line;
  }

  private fillChart(group: Group, track: Track, scale: TimeScale): void {
    const times: number[] = [];
    for (let i = 0; i < track.size; ++i) {
      // Both sides of the step that a visit makes.
      times.push(track.begin(i) - 1e-3, track.begin(i));
    }
    for (let i = 0; i <= SAMPLES; ++i) {
      times.push(scale.begin + (scale.end - scale.begin) * i / SAMPLES, scale.time(i / SAMPLES));
    }
    const unique = [...new Set(times)].filter((t) => t >= scale.begin && t <= scale.end)
        .sort((a, b) => a - b);
    const states = [0, ...group.modes.map((_, i) => i + 1)];
    const values = unique.map((t) => track.at(t));
    this.chart!.setData(unique, states.map((state) => ({
      name: modeName(state === 0 ? 0 : group.modes[state - 1]!.number),
      ...seriesStyle(this.theme, state),
      values: values.map((p) => p[state] ?? null),
    })), {
      label: `Probability of each mode of ${group.name} over time`, height: 170, range: [0, 1], percent: true,
    });
  }
}

function swatch(style: {color: string; dash: number[]}): HTMLElement {
  const line = element('span', {class: style.dash.length > 0 ? 'swatch dashed' : 'swatch'});
  line.style.borderColor = style.color;
  return line;
}

function describeRates(group: Group): string {
  const count = `${group.modes.length} ${group.modes.length === 1 ? 'mode' : 'modes'}`;
  const states = group.modes.length + 1;
  const rate = typeof group.rates === 'number' ? group.rates
      : -group.rates.reduce((sum, q, i) => sum + (i % (states + 1) === 0 ? q : 0), 0) / states;
  if (!(rate > 0)) return `${count}; never leaves its position`;
  const leaves = `${count}; leaves its position after ${durationText(1 / rate)} on average`;
  if (!group.rhythm) return leaves;
  const rhythm = `${leaves}, by a rate for each ${group.rhythm.name}`;
  return group.rhythm.known ? rhythm
      : `${rhythm}. These rates are not in this page, which uses their mean: shiftmap-inspect show --at is exact.`;
}

function verdict(visit: Visit): string {
  if (visit.setAside) return `${modeName(visit.favoured)}, not counted`;
  return visit.decided >= 0 ? `${modeName(visit.decided)} ✓` : modeName(visit.favoured);
}
