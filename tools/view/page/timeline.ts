// SPDX-License-Identifier: Apache-2.0
import {byId, dayText, durationText, timeText} from './markup';
import type {Theme} from './layers';

export interface Span { begin: number; end: number; }

const STEPS = 10000;

/**
 * Positions of times on the slider: what happens within shifts gets most of its length, and a pause
 * a share by the logarithm of its length.
 */
export class TimeScale {
  private readonly times: number[] = [];
  private readonly positions: number[] = [];

  /** @param spans What happened; @param until The end of the slider. */
  constructor(spans: Span[], until: number) {
    const merged: Span[] = [];
    for (const span of [...spans].sort((a, b) => a.begin - b.begin)) {
      const last = merged[merged.length - 1];
      if (last && span.begin <= last.end + 300) last.end = Math.max(last.end, span.end);
      else merged.push({...span});
    }
    if (merged.length === 0) merged.push({begin: until, end: until});
    const end = Math.max(until, merged.at(-1)!.end);
    const active = merged.reduce((sum, s) => sum + (s.end - s.begin), 0) || 1;
    const pauses = [...merged.slice(1).map((s) => s.begin), end]
        .map((next, i) => Math.log(1 + (next - merged[i]!.end) / 60));
    const paused = pauses.reduce((sum, value) => sum + value, 0);
    const share = merged.every((s) => s.end <= s.begin) ? 0 : paused > 0 ? 0.7 : 1;
    let position = 0;
    merged.forEach((span, i) => {
      this.add(span.begin, position);
      position += share * ((span.end - span.begin) / active);
      this.add(span.end, position);
      if (paused > 0) position += (1 - share) * (pauses[i]! / paused);
    });
    this.add(end, 1);
  }

  private add(time: number, position: number): void {
    this.times.push(time);
    this.positions.push(position);
  }

  get begin(): number { return this.times[0]!; }
  get end(): number { return this.times.at(-1)!; }
  position(time: number): number { return interpolate(this.times, this.positions, time); }
  time(position: number): number { return interpolate(this.positions, this.times, position); }
}

function interpolate(from: number[], to: number[], value: number): number {
  let i = from.findIndex((bound) => bound > value);
  if (i < 0) return to.at(-1)!;
  if (i === 0) return to[0]!;
  const share = (value - from[i - 1]!) / Math.max(1e-12, from[i]! - from[i - 1]!);
  return to[i - 1]! + share * (to[i]! - to[i - 1]!);
}

/** The slider of the time, with a mark for each event, and the time as a text that can be edited. */
export class Timeline {
  private readonly slider = byId<HTMLInputElement>('time');
  private readonly field = byId<HTMLInputElement>('time-text');
  private readonly marks = byId<HTMLCanvasElement>('time-marks');
  private readonly playButton = byId<HTMLButtonElement>('play');
  private scale: TimeScale = new TimeScale([], 1);
  private spans: Span[] = [];
  private events: number[] = [];
  private playing = 0;
  private current = 0;
  onChange: (time: number) => void = () => {};

  constructor(public theme: Theme) {
    this.slider.max = String(STEPS);
    this.slider.addEventListener('input', () => {
      this.change(this.scale.time(Number(this.slider.value) / STEPS), false);
    });
    this.field.addEventListener('change', () => this.takeText());
    byId('time-back').addEventListener('click', () => this.step(-1));
    byId('time-on').addEventListener('click', () => this.step(1));
    this.playButton.addEventListener('click', () => (this.playing ? this.stop() : this.play()));
    new ResizeObserver(() => this.draw()).observe(this.marks);
  }

  get time(): number { return this.current; }

  /** @param events Times that the buttons step through and that have marks. */
  setContent(spans: Span[], events: number[], until: number): void {
    this.stop();
    this.spans = spans;
    this.events = [...new Set(events)].sort((a, b) => a - b);
    this.scale = new TimeScale(spans, until);
    this.draw();
  }

  setTime(time: number): void { this.change(time, true); }

  step(direction: 1 | -1): void {
    const later = this.events.filter((t) => direction * (t - this.current) > 1e-3);
    const next = direction > 0 ? later[0] : later.at(-1);
    if (next !== undefined) this.change(next, true);
  }

  draw(): void {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [this.marks.clientWidth, this.marks.clientHeight];
    if (width === 0) return;
    this.marks.width = width * ratio;
    this.marks.height = height * ratio;
    const context = this.marks.getContext('2d')!;
    context.scale(ratio, ratio);
    // The thumb of a slider is 16 pixels wide.
    const x = (time: number) => 8 + (width - 16) * this.scale.position(time);
    context.fillStyle = this.theme.grid;
    for (const span of this.spans) {
      context.fillRect(x(span.begin), 0, Math.max(2, x(span.end) - x(span.begin)), 12);
    }
    context.fillStyle = this.theme.mode;
    for (const event of this.events) context.fillRect(x(event) - 0.5, 2, 1, 8);
    context.fillStyle = this.theme.muted;
    context.font = '11px system-ui, sans-serif';
    context.textBaseline = 'bottom';
    let free = 0;
    let before = '';
    for (const span of [...this.spans, {begin: this.scale.end, end: this.scale.end}]) {
      const day = dayText(span.begin);
      const left = Math.min(x(span.begin), width - context.measureText(day).width);
      if (left < free || day === before) continue;
      before = day;
      context.fillText(day, left, height);
      free = left + context.measureText(day).width + 10;
    }
  }

  private change(time: number, move: boolean): void {
    this.current = time;
    if (move) this.slider.value = String(Math.round(this.scale.position(time) * STEPS));
    this.field.value = timeText(time);
    this.field.removeAttribute('aria-invalid');
    const since = time - this.scale.begin;
    this.slider.setAttribute(
        'aria-valuetext', `${timeText(time)} UTC, ${durationText(Math.max(0, since))} after the begin`);
    this.onChange(time);
  }

  private takeText(): void {
    const text = this.field.value.trim();
    const seconds = /^\d+(\.\d+)?$/.test(text)
        ? Number(text) : Date.parse(`${text.replace(' ', 'T')}${/[zZ]$/.test(text) ? '' : 'Z'}`) / 1000;
    if (Number.isFinite(seconds)) this.change(seconds, true);
    else this.field.setAttribute('aria-invalid', 'true');
  }

  private play(): void {
    this.playButton.textContent = 'Pause';
    let position = this.scale.position(this.current);
    if (position >= 1) position = 0;
    let before = performance.now();
    const tick = (now: number) => {
      position = Math.min(1, position + (now - before) / 20000);
      before = now;
      this.change(this.scale.time(position), true);
      if (position < 1) this.playing = requestAnimationFrame(tick);
      else this.stop();
    };
    this.playing = requestAnimationFrame(tick);
  }

  private stop(): void {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    this.playButton.textContent = 'Play';
  }
}
