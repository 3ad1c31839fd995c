// Numbers as people on a ship read them.
const ABSENT = '–';

export function number(value: number | null | undefined, digits: number, unit = ''): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return ABSENT;
  return unit ? `${value.toFixed(digits)} ${unit}` : value.toFixed(digits);
}

export const count = (value: number): string => value.toLocaleString('en-US').replaceAll(',', ' ');

export function utc(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined) return ABSENT;
  const text = new Date(seconds * 1000).toISOString();
  return `${text.slice(0, 10)} ${text.slice(11, 19)}`;
}

export function duration(seconds: number): string {
  const s = Math.max(0, Math.round(seconds));
  if (s < 120) return `${s} s`;
  if (s < 7200) return `${Math.floor(s / 60)} min ${s % 60} s`;
  return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}

export function bytes(value: number): string {
  return value < 10_000 ? `${count(value)} B` : `${(value / 1000).toFixed(1)} kB`;
}

// The greatest of 1, 2, 5 times a power of ten that is not above `limit`.
export function niceBelow(limit: number): number {
  const power = 10 ** Math.floor(Math.log10(limit));
  const lead = limit / power;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

export const spacingText = (metres: number): string =>
  metres >= 1 ? `${metres} m` : `${Number((metres * 100).toFixed(1))} cm`;

// Degrees and decimal minutes, as charts and plotters have them.
export function position(latitude: number, longitude: number): string {
  const one = (value: number, positive: string, negative: string, width: number): string => {
    const thousandths = Math.round(Math.abs(value) * 60 * 10000);
    const degrees = Math.floor(thousandths / 600000);
    const minutes = ((thousandths % 600000) / 10000).toFixed(4).padStart(7, '0');
    return `${String(degrees).padStart(width, '0')}° ${minutes}′ ${value < 0 ? negative : positive}`;
  };
  return `${one(latitude, 'N', 'S', 2)}  ${one(longitude, 'E', 'W', 3)}`;
}
