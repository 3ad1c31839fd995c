import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { clock } from './format';
import type { Series, Track } from './dive';

// Depth along a line, and the vehicle's series over time, by uPlot.

const INK = '#8397a3';
const GRID = '#1f2c36';
const FONT = '11px system-ui, DejaVu Sans, sans-serif';
const STAGE_COLOURS = ['rgb(111 183 201 / 20%)', 'rgb(240 185 94 / 20%)', 'rgb(116 192 143 / 20%)', 'rgb(197 139 224 / 20%)', 'rgb(240 112 92 / 20%)'];

const axis = (more: uPlot.Axis = {}): uPlot.Axis => ({ stroke: INK, font: FONT, grid: { stroke: GRID, width: 1 }, ticks: { show: false }, size: 34, gap: 4, ...more });
const downwards = (pad: number): uPlot.Scale => ({
  dir: -1, range: (_, low, high) => { const p = Math.max(pad, (high - low) * 0.08); return [low - p, high + p]; },
});

export interface ProfilePoint {
  along: number; // [m]
  depth: number; // [m], NaN in holes
  sigma: number; // [m], NaN unknown
}

export class ProfileChart {
  private plot: uPlot | null = null;
  private at: number | null = null;
  onHover: (index: number | null) => void = () => undefined;
  constructor(private box: HTMLElement) {
    new ResizeObserver(() => this.plot?.setSize({ width: Math.max(box.clientWidth, 120), height: 150 })).observe(box);
  }
  clear(): void {
    this.plot?.destroy();
    this.plot = null;
    this.box.replaceChildren();
  }
  set(points: ProfilePoint[]): void {
    this.clear();
    const finite = (v: number): number | null => (Number.isFinite(v) ? v : null);
    const data: uPlot.AlignedData = [
      points.map((p) => p.along), points.map((p) => finite(p.depth - p.sigma)), points.map((p) => finite(p.depth + p.sigma)), points.map((p) => finite(p.depth)),
    ];
    this.plot = new uPlot({
      width: Math.max(this.box.clientWidth, 120), height: 150, legend: { show: false }, padding: [10, 14, 0, 0],
      cursor: { drag: { x: false, y: false } },
      scales: { x: { time: false }, y: downwards(0.02) },
      axes: [axis({ values: (_, ticks) => ticks.map((t) => `${t} m`), size: 24 }), axis({ values: (_, ticks) => ticks.map((t) => t.toFixed(2)), size: 48 })],
      series: [{}, { stroke: 'transparent', points: { show: false } }, { stroke: 'transparent', points: { show: false } },
        { label: 'depth', stroke: '#ff8f6b', width: 2, points: { show: false } }],
      bands: [{ series: [2, 1], fill: 'rgb(255 143 107 / 22%)', dir: 1 }, { series: [1, 2], fill: 'rgb(255 143 107 / 22%)', dir: -1 }],
      hooks: { setCursor: [(u) => { const i = u.cursor.idx ?? null; if (i !== this.at) this.onHover((this.at = i)); }] },
    }, data, this.box);
  }
}

export class TimelineChart {
  private plot: uPlot | null = null;
  private marker: number | null = null;
  onScrub: (index: number) => void = () => undefined;
  constructor(private box: HTMLElement) {
    new ResizeObserver(() => this.plot?.setSize({ width: Math.max(box.clientWidth, 120), height: 110 })).observe(box);
  }

  set(track: Track, shown: Series[]): void {
    this.plot?.destroy();
    this.box.replaceChildren();
    const colours = ['#6fb7c9', '#f0b95e'];
    const stages = [...new Set(track.stage.filter((s): s is string => s !== null))];
    let scrubbing = false;
    const scrub = (u: uPlot): void => { if (u.cursor.idx !== null && u.cursor.idx !== undefined) this.onScrub(u.cursor.idx); };
    this.plot = new uPlot({
      width: Math.max(this.box.clientWidth, 120), height: 110, legend: { show: false }, padding: [8, 8, 0, 0], cursor: { drag: { x: false, y: false }, y: false },
      scales: { x: { time: false }, ...Object.fromEntries(shown.map((s) => [s.key, s.key === 'depth' ? downwards(0.1) : { range: (_: uPlot, low: number, high: number): [number, number] => { const p = Math.max(0.02, (high - low) * 0.08); return [low - p, high + p]; } }])) },
      axes: [axis({ size: 22, values: (_, ticks) => ticks.map(clock), space: 90 }),
        ...shown.map((s, i) => axis({ scale: s.key, side: i === 0 ? 3 : 1, size: 44, stroke: colours[i], grid: { show: i === 0, stroke: GRID, width: 1 }, space: 26 }))],
      series: [{}, ...shown.map((s, i) => ({ label: s.title, scale: s.key, stroke: colours[i], width: 1.4, points: { show: false } }))],
      hooks: {
        drawClear: [(u) => {
          // The stage of the dive colours the ground.
          let from = 0;
          const { left, top, height, width } = u.bbox;
          for (let i = 1; i <= track.stage.length; ++i) {
            if (i < track.stage.length && track.stage[i] === track.stage[from]) continue;
            const name = track.stage[from];
            const x0 = Math.max(u.valToPos(track.utc[from]!, 'x', true), left);
            const x1 = Math.min(u.valToPos(track.utc[Math.min(i, track.utc.length - 1)]!, 'x', true), left + width);
            if (name !== null && name !== undefined && x1 > x0) {
              u.ctx.fillStyle = STAGE_COLOURS[stages.indexOf(name) % STAGE_COLOURS.length]!;
              u.ctx.fillRect(x0, top, x1 - x0, height);
              u.ctx.fillStyle = INK;
              u.ctx.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
              u.ctx.textBaseline = 'top';
              if (u.ctx.measureText(name).width < x1 - x0 - 8) u.ctx.fillText(name, x0 + 4 * devicePixelRatio, top + 3 * devicePixelRatio);
            }
            from = i;
          }
        }],
        draw: [(u) => {
          if (this.marker === null) return;
          const x = u.valToPos(this.marker, 'x', true);
          u.ctx.fillStyle = '#ffe08a';
          u.ctx.fillRect(x - devicePixelRatio, u.bbox.top, 2 * devicePixelRatio, u.bbox.height);
        }],
        ready: [(u) => {
          u.over.addEventListener('pointerdown', (e) => { scrubbing = true; u.over.setPointerCapture(e.pointerId); scrub(u); });
          u.over.addEventListener('pointerup', () => { scrubbing = false; });
        }],
        setCursor: [(u) => { if (scrubbing) scrub(u); }],
      },
    }, [track.utc, ...shown.map((s) => s.values)] as uPlot.AlignedData, this.box);
  }

  setMarker(utc: number | null): void {
    this.marker = utc;
    this.plot?.redraw(false);
  }
}
