// Colour ramps as stops from 0 to 1, sRGB. Viridis and magma (van der Walt, Smith; CC0): even steps to the eye, and
// readable by colour-blind people.
export type Rgb = [number, number, number];

const hex = (stops: string): Rgb[] =>
  stops.split(' ').map((s) => [0, 2, 4].map((i) => parseInt(s.slice(i, i + 2), 16)) as Rgb);

export const VIRIDIS = hex('440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725');
export const MAGMA = hex('1d1147 3b0f70 641a80 8c2981 b73779 de4968 f7705c fe9f6d fecf92 fcfdbf');

export function ramp(stops: Rgb[], t: number): Rgb {
  const x = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
  const i = Math.min(Math.floor(x), stops.length - 2);
  const a = stops[i]!;
  const b = stops[i + 1]!;
  const f = x - i;
  return [0, 1, 2].map((c) => a[c]! + (b[c]! - a[c]!) * f) as Rgb;
}

export const cssGradient = (stops: Rgb[]): string =>
  `linear-gradient(to right, ${stops.map((s) => `rgb(${s.join(',')})`).join(',')})`;

// What is between 2 and 98 percent of the values: a few wild nodes must not flatten the ramp.
export function robustRange(values: number[], least: number): [number, number] {
  if (values.length === 0) return [0, least];
  const sorted = Float64Array.from(values).sort();
  const at = (share: number): number => sorted[Math.round(share * (sorted.length - 1))]!;
  const low = at(0.02);
  const high = at(0.98);
  const pad = Math.max(0, least - (high - low)) / 2;
  return [low - pad, high + pad];
}
