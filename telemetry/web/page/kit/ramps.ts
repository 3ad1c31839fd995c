// Colour ramps as stops from 0 to 1, sRGB. Viridis and magma (van der Walt, Smith; CC0): even steps to the eye, and
// readable by colour-blind people; turbo (Mikhailov; Apache 2) where small differences matter more. Twilight (Bechtold; CC0)
// closes, for angles.
export type Rgb = [number, number, number];

const hex = (stops: string): Rgb[] =>
  stops.split(' ').map((s) => [0, 2, 4].map((i) => parseInt(s.slice(i, i + 2), 16)) as Rgb);

export const VIRIDIS = hex('440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725');
export const MAGMA = hex('1d1147 3b0f70 641a80 8c2981 b73779 de4968 f7705c fe9f6d fecf92 fcfdbf');
const RAMPS: Record<string, Rgb[]> = {
  viridis: VIRIDIS, magma: MAGMA,
  turbo: hex('30123b 4662d7 36aaf9 1ae4b6 72fe5e c7ef34 faba39 f66b19 ca2a04 7a0403'),
  grey: hex('101010 f0f0f0'),
  diverging: hex('2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b'),
  twilight: hex('e2d9e2 9ebbc9 6785be 5e43a5 421257 6b1548 a53d4f c47f62 ceb8a6 e2d9e2'),
};
export const rampOf = (name: string | undefined): Rgb[] => RAMPS[name ?? ''] ?? VIRIDIS;

export function ramp(stops: Rgb[], t: number): Rgb {
  const x = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
  const i = Math.min(Math.floor(x), stops.length - 2);
  const f = x - i;
  return [0, 1, 2].map((c) => stops[i]![c]! + (stops[i + 1]![c]! - stops[i]![c]!) * f) as Rgb;
}

export const cssColour = (colour: Rgb): string => `rgb(${colour.join(',')})`;
export const cssGradient = (stops: Rgb[]): string => `linear-gradient(to right, ${stops.map(cssColour).join(',')})`;

// The classes of labels: twelve colours that differ for most eyes (Paul Tol's "muted" and "light", CC0).
const CLASS_COLOURS = hex('88ccee cc6677 ddcc77 117733 332288 aa4499 44aa99 999933 882255 ee8866 bbcc33 77aadd');
export const classColour = (index: number): Rgb => CLASS_COLOURS[index % CLASS_COLOURS.length]!;

// What is between 2 and 98 percent of the values: a few wild ones must not flatten the ramp. At least `least` wide; without
// it, a flat field gets a width of 1.
export function robustRange(values: ArrayLike<number>, least?: number): [number, number] {
  const finite = Float64Array.from(values).filter(Number.isFinite).sort();
  if (finite.length === 0) return [0, least ?? 1];
  const at = (share: number): number => finite[Math.round(share * (finite.length - 1))]!;
  const low = at(0.02);
  const high = at(0.98);
  const pad = Math.max(0, (least ?? (high > low ? 0 : 1)) - (high - low)) / 2;
  return [low - pad, high + pad];
}
