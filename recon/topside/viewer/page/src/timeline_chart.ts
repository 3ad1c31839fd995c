import type uPlot from 'uplot';
import { Chart, FONT, GRID, INK, around, axis, downwards } from '#kit/charts';
import { clock } from '#kit/format';
import type { Series, Track } from './dive';

// The vehicle's series over time, on the ground of the dive's stages.

const STAGE_COLOURS = ['rgb(111 183 201 / 20%)', 'rgb(240 185 94 / 20%)', 'rgb(116 192 143 / 20%)', 'rgb(197 139 224 / 20%)', 'rgb(240 112 92 / 20%)'];
const SERIES_COLOURS = ['#6fb7c9', '#f0b95e'];
const HEIGHT = 110; // [px]

function drawStages(u: uPlot, track: Track): void {
  const stages = [...new Set(track.stage.filter((s): s is string => s !== null))];
  const { left, top, height, width } = u.bbox;
  let from = 0;
  for (let i = 1; i <= track.stage.length; ++i) {
    if (i < track.stage.length && track.stage[i] === track.stage[from]) continue;
    const name = track.stage[from];
    const x0 = Math.max(u.valToPos(track.utc[from]!, 'x', true), left);
    const x1 = Math.min(u.valToPos(track.utc[Math.min(i, track.utc.length - 1)]!, 'x', true), left + width);
    if (name !== null && name !== undefined && x1 > x0) {
      u.ctx.fillStyle = STAGE_COLOURS[stages.indexOf(name) % STAGE_COLOURS.length]!;
      u.ctx.fillRect(x0, top, x1 - x0, height);
      u.ctx.fillStyle = INK;
      u.ctx.font = `${10 * devicePixelRatio}px ${FONT}`;
      u.ctx.textBaseline = 'top';
      if (u.ctx.measureText(name).width < x1 - x0 - 8) u.ctx.fillText(name, x0 + 4 * devicePixelRatio, top + 3 * devicePixelRatio);
    }
    from = i;
  }
}

export class TimelineChart {
  private chart: Chart;
  private marker: number | null = null;
  onScrub: (index: number) => void = () => undefined;
  constructor(box: HTMLElement) {
    this.chart = new Chart(box, HEIGHT);
  }

  set(track: Track, shown: Series[]): void {
    let scrubbing = false;
    const scrub = (u: uPlot): void => { if (u.cursor.idx !== null && u.cursor.idx !== undefined) this.onScrub(u.cursor.idx); };
    this.chart.show({
      padding: [8, 8, 0, 0], cursor: { y: false },
      scales: { x: { time: false }, ...Object.fromEntries(shown.map((s) => [s.key, s.key === 'depth' ? downwards(0.1) : around()])) },
      axes: [axis({ size: 22, values: (_, ticks) => ticks.map(clock), space: 90 }),
        ...shown.map((s, i) => axis({ scale: s.key, side: i === 0 ? 3 : 1, size: 44, stroke: SERIES_COLOURS[i], grid: { show: i === 0, stroke: GRID, width: 1 }, space: 26 }))],
      series: [{}, ...shown.map((s, i) => ({ label: s.title, scale: s.key, stroke: SERIES_COLOURS[i], width: 1.4, points: { show: false } }))],
      hooks: {
        drawClear: [(u) => drawStages(u, track)],
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
    }, [track.utc, ...shown.map((s) => s.values)] as uPlot.AlignedData);
  }

  setMarker(utc: number | null): void {
    this.marker = utc;
    this.chart.plot?.redraw(false);
  }
}
