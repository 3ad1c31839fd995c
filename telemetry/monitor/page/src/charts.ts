import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import type { History, ProfilePoint } from './api';
import { linkSeries, thinned } from './link_series';

// The link over time and the depth along a line, by uPlot.

const INK = '#8397a3';
const GRID = '#1f2c36';
const FONT = '11px system-ui, DejaVu Sans, sans-serif';

const axis = (more: uPlot.Axis = {}): uPlot.Axis => ({
  stroke: INK, font: FONT, grid: { stroke: GRID, width: 1 }, ticks: { show: false }, size: 34, gap: 4, ...more,
});

const clock = (seconds: number): string => new Date(seconds * 1000).toISOString().slice(11, 16);

const STEPS = uPlot.paths.stepped!({ align: 1 });

export class LinkChart {
  private plot: uPlot;
  constructor(private box: HTMLElement) {
    this.plot = new uPlot(
      {
        width: Math.max(box.clientWidth, 200), height: 132,
        legend: { show: false }, cursor: { drag: { x: false, y: false } }, padding: [8, 4, 0, 0],
        scales: { x: { time: true }, rate: { range: (_, __, max) => [0, Math.max(100, (max || 0) * 1.15)] }, loss: { range: [0, 100] } },
        axes: [
          axis({ size: 22, values: (_, ticks) => ticks.map(clock), space: 60 }),
          axis({ scale: 'rate', space: 28, size: 40, values: (_, ticks) => ticks.map((t) => (t >= 1000 ? `${t / 1000}k` : String(t))) }),
          axis({ scale: 'loss', side: 1, grid: { show: false }, space: 28, size: 38, values: (_, ticks) => ticks.map((t) => `${t}%`) }),
        ],
        series: [
          {},
          { label: 'bit/s', scale: 'rate', stroke: '#6fb7c9', fill: 'rgb(111 183 201 / 22%)', width: 1.5, points: { show: false }, paths: STEPS },
          { label: 'lost', scale: 'loss', stroke: '#e8866a', width: 1.2, points: { show: false }, paths: STEPS },
        ],
      },
      [[], [], []], box,
    );
    new ResizeObserver(() => this.plot.setSize({ width: Math.max(box.clientWidth, 200), height: 132 })).observe(box);
  }
  set(history: History): void {
    this.plot.setData(linkSeries(thinned(history, Math.max(40, Math.floor(this.box.clientWidth / 5)))));
  }
}

export class ProfileChart {
  private plot: uPlot | null = null;
  constructor(private box: HTMLElement) {
    new ResizeObserver(() => this.plot?.setSize({ width: box.clientWidth, height: 150 })).observe(box);
  }
  set(points: (ProfilePoint | null)[], length: number): void {
    const last = points.length - 1;
    const along = points.map((_, i) => (i / last) * length);
    const depth = points.map((p) => (p ? p[1] : null));
    const data: uPlot.AlignedData = [along, points.map((p) => (p ? p[1] - p[2] : null)), points.map((p) => (p ? p[1] + p[2] : null)), depth];
    this.plot?.destroy();
    this.plot = new uPlot(
      {
        width: Math.max(this.box.clientWidth, 200), height: 150, legend: { show: false }, padding: [10, 14, 0, 0],
        cursor: { drag: { x: false, y: false } },
        scales: { x: { time: false }, y: { dir: -1, range: (_, low, high) => { const pad = Math.max(0.05, (high - low) * 0.08); return [low - pad, high + pad]; } } },
        axes: [axis({ values: (_, ticks) => ticks.map((t) => `${t} m`), size: 24 }), axis({ values: (_, ticks) => ticks.map((t) => t.toFixed(1)), size: 44, label: undefined })],
        series: [
          {},
          { stroke: 'transparent', points: { show: false } },
          { stroke: 'transparent', points: { show: false } },
          { label: 'depth', stroke: '#ff8f6b', width: 2, points: { show: false } },
        ],
        bands: [{ series: [2, 1], fill: 'rgb(255 143 107 / 18%)', dir: 1 }, { series: [1, 2], fill: 'rgb(255 143 107 / 18%)', dir: -1 }],
      },
      data, this.box,
    );
  }
}
