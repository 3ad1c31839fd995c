// Numbers as people on a ship read them.
const ABSENT = '–';

export function number(value: number | null | undefined, digits: number, unit = ''): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return ABSENT;
  const text = value.toFixed(digits).replace('-', '−');
  return unit ? `${text} ${unit}` : text;
}

export const count = (value: number): string => Math.round(value).toLocaleString('en-US').replaceAll(',', ' ');

export function bytes(value: number): string {
  if (value < 1e4) return `${count(value)} B`;
  if (value < 1e6) return `${(value / 1e3).toFixed(1)} kB`;
  return value < 1e9 ? `${(value / 1e6).toFixed(0)} MB` : `${(value / 1e9).toFixed(2)} GB`;
}

export function length(metres: number): string {
  if (!Number.isFinite(metres)) return ABSENT;
  if (metres < 0.01) return `${(metres * 1000).toFixed(1)} mm`;
  if (metres < 1) return `${(metres * 100).toFixed(1)} cm`;
  return metres < 2000 ? `${metres.toFixed(2)} m` : `${(metres / 1000).toFixed(3)} km`;
}

export const area = (squareMetres: number): string =>
  squareMetres < 1 ? `${count(squareMetres * 1e4)} cm²` : `${squareMetres.toFixed(squareMetres < 100 ? 2 : 0)} m²`;

export const volume = (cubicMetres: number): string =>
  cubicMetres < 0.1 ? `${number(cubicMetres * 1000, 1)} litres` : `${cubicMetres.toFixed(cubicMetres < 10 ? 3 : 1)} m³`;

// "14:03:27" of a day, UTC.
export const clock = (utcSeconds: number): string => new Date(utcSeconds * 1000).toISOString().slice(11, 19);
export function dateAndClock(utcSeconds: number | null | undefined): string {
  if (utcSeconds === null || utcSeconds === undefined) return ABSENT;
  return `${new Date(utcSeconds * 1000).toISOString().slice(0, 10)} ${clock(utcSeconds)}`;
}

export function duration(seconds: number): string {
  const s = Math.max(0, Math.round(seconds));
  if (s < 120) return `${s} s`;
  if (s < 7200) return `${Math.floor(s / 60)} min ${s % 60} s`;
  return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
}

// The greatest of 1, 2, 5 times a power of ten that is not above `limit`.
export function niceBelow(limit: number): number {
  const power = 10 ** Math.floor(Math.log10(limit));
  const lead = limit / power;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}

// A round length, with no more digits than it has: 2 km, 25 cm, 3.1 cm.
export function spacingText(metres: number): string {
  const short = (value: number): number => Number(value.toFixed(1));
  if (metres >= 1000) return `${metres / 1000} km`;
  return metres >= 1 ? `${metres} m` : metres >= 0.01 ? `${short(metres * 100)} cm` : `${short(metres * 1000)} mm`;
}

// Degrees and decimal minutes, as charts and plotters have them; 0.0001 minute is 18 cm, so one digit more.
export function position({ latitude, longitude }: { latitude: number; longitude: number }): string {
  const one = (value: number, positive: string, negative: string, width: number): string => {
    const parts = Math.round(Math.abs(value) * 60 * 1e5);
    const degrees = Math.floor(parts / 6e6);
    const minutes = ((parts % 6e6) / 1e5).toFixed(5).padStart(8, '0');
    return `${String(degrees).padStart(width, '0')}° ${minutes}′ ${value < 0 ? negative : positive}`;
  };
  return `${one(latitude, 'N', 'S', 2)}  ${one(longitude, 'E', 'W', 3)}`;
}
