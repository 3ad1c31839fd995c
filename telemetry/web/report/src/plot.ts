import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { axis } from '#kit/charts';
import type { Plot } from './content';

// Points and lines over two axes. Drag enlarges, a double click shows all again.

const WIDTH = 860; // [px]
const HEIGHT = 380; // [px]
const WIDE = 1.6; // at most so many times its height
const SHAPES: Range = [0.25, 1]; // of a map: least and most height over width
const AXIS = 56; // room beside each axis [px]
const PAD = 0.04; // of the range, around the points
const LINE = 1.2; // width [px]
const DOT = 2; // radius [px]
const DASHES = [6, 4]; // [px]

export type Range = [low: number, high: number];

export function rangeOf(values: (number | null)[]): Range {
  let [low, high] = [Infinity, -Infinity];
  for (const v of values) if (v !== null) [low, high] = [Math.min(low, v), Math.max(high, v)];
  const pad = PAD * (high - low) || 0.5;
  return low <= high ? [low - pad, high + pad] : [0, 1];
}

// The height of a map's drawing for a width [px], and both ranges widened so that a metre has the same length on both.
export function mapFrame(x: Range, y: Range, width: number): { height: number; x: Range; y: Range } {
  const height = Math.round(width * Math.min(Math.max((y[1] - y[0]) / (x[1] - x[0]), SHAPES[0]), SHAPES[1]));
  const metres = Math.max((x[1] - x[0]) / width, (y[1] - y[0]) / height); // a pixel
  const widened = ([low, high]: Range, pixels: number): Range => [(low + high - metres * pixels) / 2, (low + high + metres * pixels) / 2];
  return { height, x: widened(x, width), y: widened(y, height) };
}

function draw(u: uPlot, plot: Plot): void {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const { kind, colour, dashed, size, x, y } of plot.series) {
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.lineWidth = (size ?? LINE) * devicePixelRatio;
    ctx.setLineDash(dashed ? DASHES.map((d) => d * devicePixelRatio) : []);
    const radius = (size ?? DOT) * devicePixelRatio;
    let lifted = true;
    ctx.beginPath();
    x.forEach((value, i) => {
      const other = y[i]!;
      if (value === null || other === null) {
        if (kind === 'areas') ctx.closePath();
        lifted = true;
        return;
      }
      const [px, py] = [u.valToPos(value, 'x', true), u.valToPos(other, 'y', true)];
      if (kind === 'dots') {
        ctx.moveTo(px + radius, py);
        ctx.arc(px, py, radius, 0, 7);
      } else if (lifted) ctx.moveTo(px, py);
      else ctx.lineTo(px, py);
      lifted = false;
    });
    if (kind === 'line') ctx.stroke();
    else ctx.fill();
  }
  ctx.restore();
}

// Of a logarithmic axis: room in proportion.
export function logRangeOf(values: (number | null)[]): Range {
  const [low, high] = rangeOf(values.map((v) => (v === null ? null : Math.log(v))));
  return [Math.exp(low), Math.exp(high)];
}

export function showPlot(box: HTMLElement, plot: Plot): void {
  const ends = (log: boolean | undefined, values: (number | null)[]): Range => (log ? logRangeOf : rangeOf)(values);
  const distr = (log: boolean | undefined): 3 | 1 => (log ? 3 : 1); // uPlot's numbers
  const whole = { x: ends(plot.logX, plot.series.flatMap((s) => s.x)), y: ends(plot.logY, plot.series.flatMap((s) => s.y)) };
  const width = plot.width ?? WIDTH;
  const { x, y, height } = plot.equal
    ? mapFrame(whole.x, whole.y, width - AXIS)
    : { ...whole, height: Math.min(HEIGHT, Math.round(width / WIDE)) - AXIS };
  const asAsked = (_: uPlot, low: number, high: number): Range => [low, high];
  // uPlot makes axes, zoom and cursor for the corners; the series are drawn over them, as a track need not go to the right.
  new uPlot({
    width, height: height + AXIS, legend: { show: false }, padding: [0, 0, 0, 0], cursor: { drag: { x: true, y: true, uni: 20 } },
    scales: { x: { time: false, distr: distr(plot.logX), range: asAsked }, y: { distr: distr(plot.logY), range: asAsked, dir: plot.down ? -1 : 1 } },
    axes: [axis({ label: plot.x, labelSize: 20, size: AXIS - 20 }), axis({ label: plot.y, labelSize: 20, size: AXIS - 20 })],
    series: [{}, { stroke: 'transparent', points: { show: false } }],
    hooks: { draw: [(u) => draw(u, plot)] },
  }, [x, y], box);
}
