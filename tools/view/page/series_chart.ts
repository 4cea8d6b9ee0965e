// SPDX-License-Identifier: Apache-2.0
import uPlot from 'uplot';
import type {Theme} from './layers';
import {timeText} from './markup';

export interface ChartSeries {
  name: string;
  color: string;
  dash?: number[];
  values: (number | null)[];
  width?: number;
}

export interface ChartOptions {
  label: string;
  height: number;
  range?: [number, number];
  /** What the range holds at least. */
  top?: number;
  /** Marks across the plot, e.g. bounds. */
  lines?: number[];
  percent?: boolean;
}

/** Values over time with a line at the present time; dragging zooms, a double click goes back. */
export class SeriesChart {
  private plot: uPlot | null = null;
  private time = 0;
  private readonly observer: ResizeObserver;

  constructor(private readonly place: HTMLElement, public theme: Theme) {
    this.observer = new ResizeObserver(() => {
      if (this.plot && place.clientWidth > 0) {
        this.plot.setSize({width: place.clientWidth, height: this.plot.height});
      }
    });
    this.observer.observe(place);
  }

  setData(times: number[], series: ChartSeries[], options: ChartOptions): void {
    this.plot?.destroy();
    this.place.setAttribute('role', 'img');
    this.place.setAttribute('aria-label', options.label);
    const axis: uPlot.Axis = {
      stroke: this.theme.muted, font: '11px system-ui, sans-serif', ticks: {show: false},
      grid: {stroke: this.theme.grid, width: 1},
    };
    this.plot = new uPlot({
      width: Math.max(120, this.place.clientWidth),
      height: options.height,
      tzDate: (seconds) => uPlot.tzDate(new Date(seconds * 1e3), 'Etc/UTC'),
      legend: {show: false},
      padding: [8, 26, 0, 0],
      cursor: {points: {show: false}, y: false},
      scales: {y: {range: options.range ?? ((_, low, high) => [Math.min(0, low), Math.max(options.top ?? 1, high * 1.05)])}},
      axes: [
        {...axis, space: 80, size: 22, values: (_, ticks, _axis, _space, step) =>
            ticks.map((t) => (step >= 86400 ? timeText(t).slice(0, 10) : timeText(t).slice(11, step < 60 ? 19 : 16)))},
        {...axis, size: 42,
          ...(options.percent ? {values: (_: uPlot, ticks: number[]) => ticks.map((t) => `${(100 * t).toFixed(0)} %`)} : {})},
      ],
      series: [
        {value: (_, t) => timeText(t)},
        ...series.map((s): uPlot.Series => ({
          label: s.name, stroke: s.color, width: s.width ?? 1.75, dash: s.dash ?? [],
          points: {show: false},
        })),
      ],
      hooks: {draw: [(plot) => this.drawLines(plot, options.lines ?? [])]},
    }, [times, ...series.map((s) => s.values)], this.place);
  }

  setTime(time: number): void {
    this.time = time;
    this.plot?.redraw(false);
  }

  destroy(): void {
    this.observer.disconnect();
    this.plot?.destroy();
  }

  private drawLines(plot: uPlot, lines: number[]): void {
    const {ctx, bbox} = plot;
    ctx.save();
    ctx.lineWidth = uPlot.pxRatio;
    ctx.beginPath();
    ctx.strokeStyle = this.theme.muted;
    ctx.setLineDash([4 * uPlot.pxRatio, 4 * uPlot.pxRatio]);
    for (const value of lines) {
      const y = plot.valToPos(value, 'y', true);
      if (y < bbox.top || y > bbox.top + bbox.height) continue;
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
    }
    ctx.stroke();
    const x = plot.valToPos(this.time, 'x', true);
    if (x >= bbox.left && x <= bbox.left + bbox.width) {
      ctx.beginPath();
      ctx.setLineDash([]);
      ctx.strokeStyle = this.theme.ink;
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }
}
