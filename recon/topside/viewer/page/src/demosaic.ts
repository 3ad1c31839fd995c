import type { Raw } from './image_samples';

// Original images hold what the sensor counted, linear in light, as a mosaic, grey or in colours, or, of eight bits, a
// picture already. Here they become something to look at.

export interface Picture {
  width: number;
  height: number;
  rgba: Uint8ClampedArray;
}
export type Samples = { length: number; [index: number]: number };

const LOW = 0.005; // share of samples that may become black, and
const HIGH = 0.995; // from where white begins: a scattering fish must not darken the rest
const GAMMA = 1 / 2.2;

// Black and white of each channel: under water red is weak, so each is stretched by itself.
export function stretch(samples: Samples, width: number, height: number, red: FirstRed | null): [low: number, high: number][] {
  const channels: number[][] = [[], [], []];
  const step = 2 * Math.max(1, Math.round(Math.sqrt((width * height) / 4 / 40000)));
  const [column, row] = red ?? [0, 0];
  for (let y = row; y + 1 < height; y += step)
    for (let x = column; x + 1 < width; x += step) {
      const i = y * width + x;
      channels[0]!.push(samples[i]!);
      if (!red) continue;
      channels[1]!.push((samples[i + 1]! + samples[i + width]!) / 2);
      channels[2]!.push(samples[i + width + 1]!);
    }
  const first = rangeOf(channels[0]!);
  return red ? [first, rangeOf(channels[1]!), rangeOf(channels[2]!)] : [first, first, first];
}

function rangeOf(values: number[]): [low: number, high: number] {
  values.sort((a, b) => a - b);
  const low = values[Math.floor(LOW * (values.length - 1))] ?? 0;
  return [low, Math.max(values[Math.floor(HIGH * (values.length - 1))] ?? 1, low + 1)];
}

function toneTable(low: number, high: number): (value: number) => number {
  const table = new Uint8Array(1025);
  for (let i = 0; i <= 1024; ++i) table[i] = Math.round(255 * (i / 1024) ** GAMMA);
  return (value) => table[Math.max(0, Math.min(1024, Math.round(((value - low) / (high - low)) * 1024)))]!;
}

// Where a mosaic has its first red sample.
export type FirstRed = readonly [column: number, row: number];
const FIRST_RED: Record<string, FirstRed> = { 'bayer-rggb': [0, 0], 'bayer-grbg': [1, 0], 'bayer-gbrg': [0, 1], 'bayer-bggr': [1, 1] };

// Mosaics and samples of more than 8 bits count light and are developed; others are a picture already.
export function pictureOf(raw: Raw, format: string, shrink: number): Picture {
  const { width, height, bands, samples, bits } = raw;
  const pixels = width * height;
  const red = FIRST_RED[format] ?? null;
  if (bands < 3 && (red || bits > 8))
    return develop(bands === 1 ? samples : Array.from({ length: pixels }, (_, i) => samples[bands * i]!), width, height, red, shrink);
  const channels = bands < 3 ? [0, 0, 0] : [0, 1, 2];
  const tones = bits > 8 ? channels.map((c) => toneTable(...rangeOf(spread(samples, pixels, bands, c)))) : null;
  const rgba = new Uint8ClampedArray(pixels * 4);
  for (let i = 0; i < pixels; ++i) {
    channels.forEach((c, k) => {
      const value = samples[bands * i + c]!;
      rgba[4 * i + k] = tones ? tones[k]!(value) : value;
    });
    rgba[4 * i + 3] = 255;
  }
  return { width, height, rgba };
}

// One band of pixels evenly spread over the image.
function spread(samples: Samples, pixels: number, bands: number, band: number): number[] {
  const step = Math.max(1, Math.round(pixels / 40000));
  return Array.from({ length: Math.floor((pixels - 1) / step) + 1 }, (_, i) => samples[bands * i * step + band]!);
}

// `shrink` 1: all pixels, colours between their samples by the mean of the nearest; n: blocks of 2n x 2n samples are one
// pixel (n counts the mosaic's cells).
export function develop(samples: Samples, width: number, height: number, red: FirstRed | null, shrink: number): Picture {
  const [column, row] = red ?? [0, 0];
  const range = stretch(samples, width, height, red);
  const tone = range.map(([low, high]) => toneTable(low, high));
  if (shrink > 1) {
    const cell = 2 * Math.floor(shrink / 2);
    const [w, h] = [Math.floor((width - column) / cell), Math.floor((height - row) / cell)];
    const rgba = new Uint8ClampedArray(w * h * 4);
    const cells = (cell / 2) ** 2;
    for (let y = 0; y < h; ++y)
      for (let x = 0; x < w; ++x) {
        let [r, g, b] = [0, 0, 0];
        for (let cy = 0; cy < cell; cy += 2)
          for (let cx = 0; cx < cell; cx += 2) {
            const i = (y * cell + cy + row) * width + x * cell + cx + column;
            r += samples[i]!;
            g += (samples[i + 1]! + samples[i + width]!) / 2;
            b += samples[i + width + 1]!;
          }
        const o = 4 * (y * w + x);
        if (!red) r = g = b = (r + 2 * g + b) / 4;
        rgba[o] = tone[0]!(r / cells);
        rgba[o + 1] = tone[1]!(g / cells);
        rgba[o + 2] = tone[2]!(b / cells);
        rgba[o + 3] = 255;
      }
    return { width: w, height: h, rgba };
  }
  const rgba = new Uint8ClampedArray(width * height * 4);
  const at = (x: number, y: number): number => {
    // Mirrored at the border, which keeps the mosaic's phase.
    const cx = x < 0 ? -x : x >= width ? 2 * width - 2 - x : x;
    const cy = y < 0 ? -y : y >= height ? 2 * height - 2 - y : y;
    return samples[cy * width + cx]!;
  };
  for (let y = 0; y < height; ++y)
    for (let x = 0; x < width; ++x) {
      const o = 4 * (y * width + x);
      const own = at(x, y);
      let [r, g, b] = [own, own, own];
      if (red) {
        const [redColumn, redRow] = [x % 2 === column, y % 2 === row];
        const cross = (): number => (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1)) / 4;
        const corners = (): number => (at(x - 1, y - 1) + at(x + 1, y - 1) + at(x - 1, y + 1) + at(x + 1, y + 1)) / 4;
        const beside = (at(x - 1, y) + at(x + 1, y)) / 2;
        const above = (at(x, y - 1) + at(x, y + 1)) / 2;
        if (redColumn && redRow) [r, g, b] = [own, cross(), corners()];
        else if (!redColumn && !redRow) [r, g, b] = [corners(), cross(), own];
        else if (redRow) [r, g, b] = [beside, own, above];
        else [r, g, b] = [above, own, beside];
      }
      rgba[o] = tone[0]!(r);
      rgba[o + 1] = tone[1]!(g);
      rgba[o + 2] = tone[2]!(b);
      rgba[o + 3] = 255;
    }
  return { width, height, rgba };
}
