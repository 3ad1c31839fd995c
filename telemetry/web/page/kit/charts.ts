import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';

// Charts by uPlot in the pages' colours, and the depth along a line.

export const INK = '#8397a3';
export const GRID = '#1f2c36';
export const FONT = 'system-ui, DejaVu Sans, sans-serif';
const LEAST_WIDTH = 120; // [px]
const LEAST_RANGE = 0.02; // around the values of a chart

export const axis = (more: uPlot.Axis = {}): uPlot.Axis => ({
  stroke: INK, font: `11px ${FONT}`, labelFont: `12px ${FONT}`, grid: { stroke: GRID, width: 1 }, ticks: { show: false }, size: 34, gap: 4, ...more,
});
export const around = (pad = LEAST_RANGE): uPlot.Scale => ({
  range: (_, low, high) => { const p = Math.max(pad, (high - low) * 0.08); return [low - p, high + p]; },
});
export const downwards = (pad = LEAST_RANGE): uPlot.Scale => ({ dir: -1, ...around(pad) });

// One chart as wide as its box, created again for each set of series.
export class Chart {
  plot: uPlot | null = null;
  constructor(private box: HTMLElement, private height: number) {
    new ResizeObserver(() => this.plot?.setSize(this.size)).observe(box);
  }
  private get size(): { width: number; height: number } {
    return { width: Math.max(this.box.clientWidth, LEAST_WIDTH), height: this.height };
  }
  clear(): void {
    this.plot?.destroy();
    this.plot = null;
    this.box.replaceChildren();
  }
  show(options: Omit<uPlot.Options, 'width' | 'height'>, data: uPlot.AlignedData): void {
    this.clear();
    this.plot = new uPlot({ legend: { show: false }, ...options, cursor: { drag: { x: false, y: false }, ...options.cursor }, ...this.size }, data, this.box);
  }
}

export interface ProfilePoint {
  along: number; // [m]
  depth: number; // [m], NaN in holes
  sigma: number; // [m], NaN unknown
}

export class ProfileChart {
  private chart: Chart;
  private at: number | null = null;
  onHover: (index: number | null) => void = () => undefined;
  constructor(box: HTMLElement) {
    this.chart = new Chart(box, 150);
  }
  clear(): void {
    this.chart.clear();
  }
  set(points: ProfilePoint[]): void {
    const finite = (v: number): number | null => (Number.isFinite(v) ? v : null);
    const bound = { stroke: 'transparent', points: { show: false } };
    const between = 'rgb(255 143 107 / 22%)';
    this.chart.show({
      padding: [10, 14, 0, 0], scales: { x: { time: false }, y: downwards() },
      axes: [axis({ values: (_, ticks) => ticks.map((t) => `${t} m`), size: 24 }), axis({ values: (_, ticks) => ticks.map((t) => t.toFixed(2)), size: 48 })],
      series: [{}, bound, bound, { label: 'depth', stroke: '#ff8f6b', width: 2, points: { show: false } }],
      bands: [{ series: [2, 1], fill: between, dir: 1 }, { series: [1, 2], fill: between, dir: -1 }],
      hooks: { setCursor: [(u) => { const i = u.cursor.idx ?? null; if (i !== this.at) this.onHover((this.at = i)); }] },
    }, [points.map((p) => p.along), points.map((p) => finite(p.depth - p.sigma)), points.map((p) => finite(p.depth + p.sigma)), points.map((p) => finite(p.depth))]);
  }
}
