// SPDX-License-Identifier: Apache-2.0
import {STATES, type Document} from './data';
import type {Theme} from './layers';
import {
  byId, durationText, element, fill, modeName, oddsText, percent, row, table, timeText,
} from './markup';
import type {Shift} from './replay';
import {SeriesChart} from './series_chart';

/** Poses that the mean of the innovations is over. */
const WINDOW = 24;

const poseText = (pose: {x: number; y: number}) => `${pose.x.toFixed(2)}, ${pose.y.toFixed(2)}`;
const degrees = (yaw: number) => `${(yaw * 180 / Math.PI).toFixed(1)}°`;

/** What the vehicle of a recorded shift believed, step by step. */
export class ReplayPanel {
  private readonly now = element('dl', {class: 'facts'});
  private readonly hypotheses = element('div', {class: 'scroll'});
  private readonly states = element('canvas', {class: 'band', role: 'img'});
  private readonly nis: SeriesChart;
  private readonly kept: SeriesChart;
  private rows: [HTMLTableRowElement, number][] = [];
  private time = 0;
  onTime: (time: number) => void = () => {};
  onPick: (signature: number) => void = () => {};

  constructor(private readonly shift: Shift, private readonly source: Document, private theme: Theme) {
    const {replay} = shift;
    const [nis, kept] = [element('div', {class: 'chart'}), element('div', {class: 'chart'})];
    const other = replay.version === source.shown ? '' : `; the map is that of version ${source.shown}`;
    fill(
        byId('replay'),
        element('h2', {}, `Shift of ${replay.vehicle || 'a vehicle'}`),
        element('p', {class: 'muted'},
            `${timeText(shift.begin)} UTC, ${durationText(shift.end - shift.begin)}, ` +
            `on version ${replay.version}${other}`),
        replay.truncation !== '' && element('p', {}, `The recording ends early: ${replay.truncation}`),
        this.now,
        element('h3', {}, 'State'), this.states, this.legend(),
        element('h3', {}, 'Innovations: mean NIS of an update, 2 expected'), nis,
        element('h3', {}, 'Hypotheses kept'), kept,
        element('h3', {}, 'Heaviest hypotheses now'), this.hypotheses,
        element('h3', {}, `Decisions (${shift.decisions.length})`), this.decisionTable());
    this.nis = new SeriesChart(nis, theme);
    this.kept = new SeriesChart(kept, theme);
    this.states.setAttribute('aria-label', 'States of the localizer over time');
    new ResizeObserver(() => this.drawStates()).observe(this.states);
    this.fillCharts();
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    this.nis.theme = this.kept.theme = theme;
    this.fillCharts();
    this.drawStates();
  }

  setTime(time: number): void {
    this.time = time;
    this.nis.setTime(time);
    this.kept.setTime(time);
    const step = this.shift.stepAt(time);
    const sample = this.shift.sampleAt(time);
    const facts: [string, string][] = [['State', STATES[this.shift.stateAt(time)] ?? '']];
    if (step) {
      facts.push(
          ['Pose', `${poseText(step)} m, ${degrees(step.yaw)}`],
          ['1σ', `${(1000 * step.major).toFixed(0)} × ${(1000 * step.minor).toFixed(0)} mm`],
          ['NIS', step.updates > 0 ? `${step.nis.toFixed(1)}, ${2 * step.updates} expected` : 'nothing seen']);
    }
    fill(this.now, ...facts.flatMap(([term, value]) =>
        [element('dt', {}, term), element('dd', {}, value)]));
    fill(this.hypotheses, table(
        ['Probability', 'x, y / m', 'Heading'],
        (sample?.heaviest ?? []).map((h) => row([percent(h.weight), poseText(h), degrees(h.yaw)])),
        'Hypotheses'));
    for (const [line, at] of this.rows) line.classList.toggle('later', at > time);
    this.drawStates();
  }

  private legend(): HTMLElement {
    return element('p', {class: 'legend'}, ...STATES.map((state, i) =>
        element('span', {}, element('i', {class: `state-${i}`}), state)));
  }

  private decisionTable(): HTMLElement {
    this.rows = this.shift.decisions.map((decision) => {
      const jump = element('button', {type: 'button', class: 'link'}, timeText(decision.time).slice(11));
      jump.addEventListener('click', () => this.onTime(decision.time));
      const name = this.source.signatures[decision.signature] ?? '';
      const pick = element('button', {type: 'button', class: 'link'}, name);
      pick.addEventListener('click', () => this.onPick(decision.signature));
      const mode = modeName(decision.mode);
      return [
        row([jump, pick, decision.withdrawn ? `${mode}, withdrawn` : mode, oddsText(decision.logOdds)]),
        decision.time,
      ];
    });
    return element('div', {class: 'scroll'}, table(
        ['Time (UTC)', 'Landmark', 'Decided', 'Odds'], this.rows.map(([line]) => line), 'Decisions'));
  }

  private fillCharts(): void {
    const {steps, samples} = this.shift;
    let [sum, updates] = [0, 0];
    const means = steps.map((step, i) => {
      const old = steps[i - WINDOW];
      sum += step.nis - (old?.nis ?? 0);
      updates += step.updates - (old?.updates ?? 0);
      return updates > 0 ? Math.max(0, sum / updates) : null;
    });
    this.nis.setData(
        steps.map((step) => step.time),
        [{name: 'NIS', color: this.theme.series[0]!, values: means}],
        {label: 'Mean normalized innovation squared over time', height: 120, lines: [2], top: 2.5});
    this.kept.setData(
        samples.map((sample) => sample.time),
        [{name: 'hypotheses', color: this.theme.series[2]!, values: samples.map((s) => s.kept)}],
        {label: 'Number of hypotheses over time', height: 100});
  }

  private drawStates(): void {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.states.clientWidth, this.states.clientHeight];
    if (width === 0) return;
    this.states.width = width * ratio;
    this.states.height = height * ratio;
    const context = this.states.getContext('2d')!;
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const {states, begin, end} = this.shift;
    const x = (t: number) => width * (t - begin) / Math.max(1e-9, end - begin);
    states.forEach(({time, state}, i) => {
      context.fillStyle = style.getPropertyValue(`--state-${state}`).trim();
      // The heights tell the states apart, too.
      const top = height * (0.7 - 0.16 * state);
      const to = Math.min(states[i + 1]?.time ?? end, end);
      context.fillRect(x(time), top, Math.max(1, x(to) - x(time)), height - top);
    });
    context.fillStyle = this.theme.ink;
    if (this.time >= begin && this.time <= end) context.fillRect(x(this.time) - 0.75, 0, 1.5, height);
  }
}
