import { readCsv, writeCsv } from './csv';
import type { Projection } from '#kit/geodesy';
import type { Place } from '#kit/place';

// Points that people mark to come back to, as GeoJSON and CSV, out and in again.

export interface Annotation extends Place {
  id: string;
  class: string;
  note: string;
  utc: string; // when it was made, ISO 8601
  images: string[]; // that saw it, best first
}

export function toGeoJson(list: Annotation[], projection: Projection | null, dive: string): string {
  const features = list.map((a) => {
    const geodetic = projection?.toGeodetic(a);
    const { id, note, utc, images, north, east, depth } = a;
    return {
      type: 'Feature', id,
      geometry: geodetic ? { type: 'Point', coordinates: [Number(geodetic.longitude.toFixed(9)), Number(geodetic.latitude.toFixed(9)), Number((-depth).toFixed(4))] } : null,
      properties: { class: a.class, note, utc, dive, north_m: Number(north.toFixed(4)), east_m: Number(east.toFixed(4)), depth_m: Number(depth.toFixed(4)), images },
    };
  });
  return `${JSON.stringify({ type: 'FeatureCollection', features }, null, 1)}\n`;
}

const COLUMNS = ['id', 'class', 'note', 'latitude_deg', 'longitude_deg', 'north_m', 'east_m', 'depth_m', 'utc', 'dive', 'images'];

export function toCsv(list: Annotation[], projection: Projection | null, dive: string): string {
  return writeCsv([COLUMNS, ...list.map((a) => {
    const g = projection?.toGeodetic(a);
    return [a.id, a.class, a.note, g ? g.latitude.toFixed(9) : '', g ? g.longitude.toFixed(9) : '', a.north.toFixed(4), a.east.toFixed(4), a.depth.toFixed(4), a.utc, dive, a.images.join(' ')];
  })]);
}

// Annotations by their own nav coordinates, or by latitude and longitude where only those are given (another tool's file).
// Throws an Error whose text says what the file lacks.
export function readAnnotations(text: string, projection: Projection | null): Annotation[] {
  const out: Annotation[] = [];
  const take = (get: (name: string) => unknown, coordinates: unknown, fallbackId: string): void => {
    const value = (name: string): number => {
      const v = get(name);
      return v === '' || v === null || v === undefined ? NaN : Number(v);
    };
    let [north, east, depth] = [value('north_m'), value('east_m'), value('depth_m')];
    const c = Array.isArray(coordinates) ? (coordinates as number[]) : [value('longitude_deg'), value('latitude_deg'), NaN];
    if (!Number.isFinite(north + east) && projection && Number.isFinite(c[0]! + c[1]!))
      ({ north, east } = projection.toLocal({ longitude: c[0]!, latitude: c[1]! }));
    if (!Number.isFinite(depth)) depth = Number.isFinite(c[2]) ? -c[2]! : NaN;
    if (!Number.isFinite(north + east)) return;
    const word = (name: string): string => { const v = get(name); return v === null || v === undefined ? '' : String(v); };
    const images = get('images');
    out.push({
      id: word('id') || fallbackId, class: word('class'), note: word('note'), utc: word('utc'), north, east, depth,
      images: Array.isArray(images) ? images.map(String) : word('images').split(/\s+/).filter((s) => s !== ''),
    });
  };
  if (/^\s*\{/.test(text)) {
    let json: { features?: unknown };
    try {
      json = JSON.parse(text) as { features?: unknown };
    } catch {
      throw new Error('is not whole: no JSON');
    }
    if (!Array.isArray(json.features)) throw new Error('holds no features');
    json.features.forEach((f: { id?: unknown; properties?: Record<string, unknown> | null; geometry?: { type?: string; coordinates?: unknown } | null }, i) => {
      if (typeof f !== 'object' || f === null) return;
      take((name) => (name === 'id' ? f.id ?? f.properties?.id : f.properties?.[name]), f.geometry?.type === 'Point' ? f.geometry.coordinates : null, `read-${i + 1}`);
    });
  } else {
    const { columns, rows } = readCsv(text);
    rows.forEach((row, i) => take((name) => row[columns.indexOf(name)], null, `read-${i + 1}`));
  }
  if (out.length === 0) throw new Error('holds no points with a position');
  return out;
}

// Another reading of the same points replaces them instead of doubling them.
export function merge(have: Annotation[], more: Annotation[]): Annotation[] {
  const byId = new Map(have.map((a) => [a.id, a]));
  for (const a of more) byId.set(a.id, a);
  return [...byId.values()];
}

// Those of which one of these images saw the place.
export function seenBy(images: string[], list: Annotation[]): Annotation[] {
  const names = new Set(images);
  return list.filter((a) => a.images.some((image) => names.has(image)));
}
