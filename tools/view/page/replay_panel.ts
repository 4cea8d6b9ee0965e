// SPDX-License-Identifier: Apache-2.0
import {STATES} from './data';
import type {Theme} from './layers';
import {byId, durationText, element, modeName, oddsText, percent, row, table, timeText} from './markup';
import {located, type Shift} from './replay';
import {SeriesChart} from './series_chart';

/** Scans that the mean of the innovations is over. */
const WINDOW = 24;

/** What the vehicle of a recorded shift believed, step by step. */
export class ReplayPanel {
  private readonly place = byId<HTMLElement>('replay');
  private readonly now = element('dl', {class: 'facts'});
  private readonly hypotheses = element('div', {class: 'scroll'});
  private readonly states = element('canvas', {class: 'band', role: 'img'});
  private readonly charts: SeriesChart[] = [];
  private rows: [HTMLTableRowElement, number][] = [];
  onTime: (time: number) => void = () => {};
  onPick: (signature: number) => void = () => {};

  constructor(private readonly shift: Shift, public theme: Theme) {
    const source = shift.source;
    const replay = shift.replay;
    const other = replay.version !== source.shown;
    const [nis, leaves] = [element('div', {class: 'chart'}), element('div', {class: 'chart'})];
    this.place.replaceChildren(
        element('h2', {}, `Shift of ${replay.vehicle || 'a vehicle'}`),
        element('p', {class: 'muted'},
            `${replay.run || 'stream'} · ${timeText(shift.begin)} UTC · ` +
            `${durationText(shift.end - shift.begin)} · on version ${replay.version}` +
            (other ? `; the map is that of version ${source.shown}` : '')),
        this.now,
        element('h3', {}, 'State'), this.states, this.legend(),
        element('h3', {}, 'Innovations: mean NIS per update, expected 2'), nis,
        element('h3', {}, 'Hypotheses kept'), leaves,
        element('h3', {}, 'Heaviest hypotheses now'), this.hypotheses,
        element('h3', {}, `Decisions (${replay.decisions.length})`), this.decisionTable());
    this.charts = [new SeriesChart(nis, theme), new SeriesChart(leaves, theme)];
    this.states.setAttribute('aria-label', 'States of the localizer over time');
    new ResizeObserver(() => this.drawStates()).observe(this.states);
    this.fill();
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    this.drawStates();
  }

  setTime(time: number): void {
    for (const chart of this.charts) chart.setTime(time);
    const index = this.shift.indexAt(time);
    const step = this.shift.steps[index];
    const facts: [string, string][] = step && located(step) ? [
      ['State', STATES[step.state] ?? ''],
      ['Pose', `${step.x.toFixed(2)} m, ${step.y.toFixed(2)} m, ${(step.yaw * 180 / Math.PI).toFixed(1)}°`],
      ['1σ', `${(1000 * step.major).toFixed(0)} × ${(1000 * step.minor).toFixed(0)} mm`],
      ['NIS of the scan', step.updates > 0 ? `${step.nis.toFixed(1)} of ${2 * step.updates} expected` : 'nothing seen'],
    ] : [['State', step ? STATES[step.state] ?? '' : 'not begun']];
    this.now.replaceChildren(...facts.flatMap(([term, value]) =>
        [element('dt', {}, term), element('dd', {}, value)]));
    this.hypotheses.replaceChildren(table(
        ['Probability', 'x, y / m', 'Heading'],
        this.shift.hypothesesAt(index).map((h) => row([
          percent(h.weight), `${h.x.toFixed(2)}, ${h.y.toFixed(2)}`, `${(h.yaw * 180 / Math.PI).toFixed(1)}°`,
        ])), 'Hypotheses'));
    for (const [line, at] of this.rows) line.classList.toggle('later', at > time);
    this.drawStates(time);
  }

  private legend(): HTMLElement {
    return element('p', {class: 'legend'}, ...STATES.map((state, i) =>
        element('span', {class: `state-${i}`}, state)));
  }

  private decisionTable(): HTMLElement {
    const {source, replay} = this.shift;
    this.rows = replay.decisions.map(([ms, signature, mode, logOdds]) => {
      const time = source.origin_s + ms / 1e3;
      const jump = element('button', {type: 'button', class: 'link'}, timeText(time).slice(11));
      jump.addEventListener('click', () => this.onTime(time));
      const pick = element('button', {type: 'button', class: 'link'}, source.signatures[signature] ?? '');
      pick.addEventListener('click', () => this.onPick(signature));
      return [row([jump, pick, modeName(mode), oddsText(logOdds)]), time];
    });
    return element('div', {class: 'scroll'}, table(
        ['Time (UTC)', 'Landmark', 'Decided', 'Odds'], this.rows.map(([line]) => line), 'Decisions'));
  }

  private fill(): void {
    const {steps} = this.shift;
    const times = steps.map((step) => step.time);
    let [sum, updates] = [0, 0];
    const means = steps.map((step, i) => {
      sum += step.nis;
      updates += step.updates;
      const old = steps[i - WINDOW];
      if (old) {
        sum -= old.nis;
        updates -= old.updates;
      }
      return updates > 0 ? sum / updates : null;
    });
    this.charts[0]!.setData(
        times, [{name: 'NIS', color: this.theme.series[0]!, values: means}],
        {label: 'Mean normalized innovation squared over time', height: 130, lines: [2]});
    this.charts[1]!.setData(
        times, [{name: 'hypotheses', color: this.theme.series[2]!, values: steps.map((s) => s.leaves)}],
        {label: 'Number of hypotheses over time', height: 100});
  }

  private drawStates(time = NaN): void {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.states.clientWidth, this.states.clientHeight];
    if (width === 0) return;
    this.states.width = width * ratio;
    this.states.height = height * ratio;
    const context = this.states.getContext('2d')!;
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const colors = STATES.map((_, i) => style.getPropertyValue(`--state-${i}`).trim());
    const {steps, begin, end} = this.shift;
    const x = (t: number) => width * (t - begin) / Math.max(1e-9, end - begin);
    steps.forEach((step, i) => {
      context.fillStyle = colors[step.state] ?? this.theme.muted;
      // A state of higher rank is less good, and higher.
      const top = height * (0.55 - 0.13 * step.state);
      const to = steps[i + 1]?.time ?? end;
      context.fillRect(x(step.time), top, Math.max(1, x(to) - x(step.time) + 0.5), height - top);
    });
    context.fillStyle = this.theme.ink;
    if (time >= begin && time <= end) context.fillRect(x(time) - 0.75, 0, 1.5, height);
  }
}
