import type { CameraModel, DiveImage } from './cameras';
import { transverseMercator, type Projection } from '#kit/geodesy';
import type { Bounds } from '#kit/place';
import { Missing, fileName, type Source } from './source';

// What scene.json, track.json and images.json say of a dive. Files come from outside: what is absent or wrong is named
// in one line, and the rest of the dive still opens.

export interface LayerFile {
  name: string;
  title: string;
  unit: string;
  file: string;
  min?: number;
  max?: number;
  ramp?: string;
}
export interface Level {
  level: number;
  tile_edge_m: number;
  triangles_per_m2?: number;
  texel_m?: number;
  error_m?: number;
}
export interface Scene {
  name: string;
  vehicle: string;
  dive_id: string;
  software: string;
  origin: { latitude: number; longitude: number } | null;
  tileset: string;
  textures: string[];
  levels: Level[];
  layers: LayerFile[];
  track: string | null;
  images: string | null;
  image_folder: string | null;
  imageFormat: string; // 'mono', 'rgb', or a mosaic: 'bayer-rggb', 'bayer-bggr', 'bayer-grbg', 'bayer-gbrg'
  id: string; // of the dive's images: the same for every model of them
  bounds: Bounds | null;
  depth: [number, number] | null;
}

// Under which this browser keeps what people make of the dive.
export const keptAs = (scene: Scene, what: string): string => `fathom ${what} ${scene.id || `${scene.vehicle}/${scene.dive_id || scene.name}`}`;

export interface Series {
  key: string;
  title: string;
  unit: string;
  values: (number | null)[];
}
export interface Track {
  timed: boolean; // false: `utc` counts from the first image
  utc: number[]; // [s]
  north: (number | null)[];
  east: (number | null)[];
  depth: (number | null)[];
  heading: (number | null)[];
  stage: (string | null)[];
  series: Series[]; // depth, altitude, then what else was recorded
}

export interface Dive {
  source: Source;
  scene: Scene;
  projection: Projection | null;
  track: Track | null;
  camera: CameraModel | null;
  images: DiveImage[];
  originals: boolean; // whether the images themselves can be had
  imageAddress(name: string): string;
  address(file: string): string;
}

type Json = Record<string, unknown>;
const isObject = (value: unknown): value is Json => typeof value === 'object' && value !== null && !Array.isArray(value);
const text = (value: unknown): string => (typeof value === 'string' ? value : typeof value === 'number' ? String(value) : '');
const numbers = (value: unknown, count: number): number[] | null =>
  Array.isArray(value) && value.length >= count && value.slice(0, count).every(Number.isFinite) ? (value as number[]) : null;
// A file in a folder or below it, by a name with slashes.
const isInside = (name: unknown): name is string => typeof name === 'string' && name !== '' && !/\\/.test(name) && name.split('/').every((part) => part !== '' && part !== '..' && part !== '.');
const column = (value: unknown, rows: number): (number | null)[] | null =>
  Array.isArray(value) && value.length === rows ? value.map((v) => (typeof v === 'number' && Number.isFinite(v) ? v : null)) : null;

export class BadFile extends Error {}

async function json(source: Source, address: string): Promise<Json> {
  const answer = await source.fetch(address).catch(() => null);
  if (!answer) throw new Missing(`${fileName(address)} cannot be reached`);
  if (!answer.ok) throw new Missing(`${fileName(address)} is missing (${answer.status})`);
  let value: unknown;
  try {
    value = JSON.parse(await answer.text());
  } catch {
    throw new BadFile(`${fileName(address)} is not whole: no JSON`);
  }
  if (!isObject(value)) throw new BadFile(`${fileName(address)} holds no object`);
  return value;
}

export function parseScene(value: Json): Scene {
  if (value.format !== 1) throw new BadFile(`scene.json has format ${text(value.format) || 'none'}; this page reads format 1`);
  const tileset = text(value.tileset);
  if (!tileset) throw new BadFile('scene.json names no tileset');
  const origin = isObject(value.origin) ? numbers([value.origin.latitude, value.origin.longitude], 2) : null;
  const bounds = numbers(value.bounds, 4);
  const depth = numbers(value.depth, 2);
  const layers = (Array.isArray(value.layers) ? value.layers : []).filter(isObject).filter((l) => text(l.file) !== '');
  return {
    name: text(value.name), vehicle: text(value.vehicle), dive_id: text(value.dive_id), software: text(value.software), tileset,
    origin: origin ? { latitude: origin[0]!, longitude: origin[1]! } : null,
    textures: Array.isArray(value.textures) ? value.textures.map(text) : [],
    levels: (Array.isArray(value.levels) ? value.levels : []).filter(isObject).map((l) => l as unknown as Level),
    layers: layers.map((l) => ({
      name: text(l.name) || text(l.file), title: text(l.title) || text(l.name) || text(l.file), unit: text(l.unit), file: text(l.file),
      ...(Number.isFinite(l.min) && Number.isFinite(l.max) ? { min: l.min as number, max: l.max as number } : {}), ramp: text(l.ramp),
    })),
    track: text(value.track) || null, images: text(value.images) || null, image_folder: text(value.image_folder) || null, id: text(value.id),
    // Of a run that named none: the ACFR's.
    imageFormat: text(value.image_format) || 'bayer-rggb',
    bounds: bounds ? { north0: bounds[0]!, east0: bounds[1]!, north1: bounds[2]!, east1: bounds[3]! } : null,
    depth: depth ? [depth[0]!, depth[1]!] : null,
  };
}

const TITLES: Record<string, [title: string, unit: string]> = {
  depth: ['Depth', 'm'], altitude: ['Altitude', 'm'], heading_deg: ['Heading', '°'], temperature_c: ['Temperature', '°C'],
  salinity_psu: ['Salinity', 'PSU'], salinity: ['Salinity', 'PSU'], conductivity_s_m: ['Conductivity', 'S/m'], roll_deg: ['Roll', '°'], pitch_deg: ['Pitch', '°'],
};
const NO_SERIES = new Set(['utc_ns', 'north', 'east', 'stage']);

export function parseTrack(value: Json): Track {
  const times = value.utc_ns;
  if (!Array.isArray(times) || times.length === 0) throw new BadFile('track.json holds no times');
  const rows = times.length;
  const utc = times.map((t) => Number(t) / 1e9);
  const [north, east] = [column(value.north, rows), column(value.east, rows)];
  if (!north || !east || utc.some((t) => !Number.isFinite(t))) throw new BadFile('track.json: north, east and utc_ns differ in length or are no numbers');
  const none = new Array<null>(rows).fill(null);
  const series: Series[] = [];
  for (const key of ['altitude', 'depth', ...Object.keys(value).filter((k) => k !== 'altitude' && k !== 'depth')]) {
    const values = NO_SERIES.has(key) ? null : column(value[key], rows);
    if (!values || values.every((v) => v === null)) continue;
    const [title, unit] = TITLES[key] ?? [key.replaceAll('_', ' '), ''];
    series.push({ key, title, unit, values });
  }
  const stage = Array.isArray(value.stage) && value.stage.length === rows ? value.stage.map((s) => (s === null ? null : text(s))) : none;
  return { timed: value.timed !== false, utc, north, east, depth: column(value.depth, rows) ?? none, heading: column(value.heading_deg, rows) ?? none, stage, series };
}

export function parseImages(value: Json): { camera: CameraModel | null; images: DiveImage[]; dropped: number } {
  if (!Array.isArray(value.images)) throw new BadFile('images.json holds no images');
  const c = isObject(value.camera) ? value.camera : null;
  const camera = c && ['width', 'height', 'fx', 'fy', 'cx', 'cy'].every((k) => Number.isFinite(c[k]))
    ? ({ k1: 0, k2: 0, p1: 0, p2: 0, k3: 0, ...c } as unknown as CameraModel) : null;
  const images: DiveImage[] = [];
  for (const i of value.images as unknown[]) {
    if (!isObject(i) || !isInside(i.left) || !numbers([i.north, i.east, i.depth], 3) || !numbers(i.q, 4)) continue;
    const footprint = Array.isArray(i.footprint) ? i.footprint.filter((p) => numbers(p, 3)) : [];
    images.push({ ...(i as unknown as DiveImage), utc_ns: text(i.utc_ns), altitude: Number.isFinite(i.altitude) ? (i.altitude as number) : null, footprint });
  }
  return { camera, images, dropped: value.images.length - images.length };
}

// Throws where there is no dive at all. Track and images are read later, by readRecords: the first picture needs neither.
// The original images are in `imageFolder`, null: nowhere, or where scene.json says.
export async function openDive(source: Source, complain: (what: string) => void, imageFolder?: string | null): Promise<Dive> {
  const address = (file: string): string => new URL(file, source.base).href;
  const scene = parseScene(await json(source, address('scene.json')));
  const folder = imageFolder !== undefined ? imageFolder : (scene.image_folder === null ? null : address(scene.image_folder.replace(/\/*$/, '/')));
  const dive: Dive = {
    source, scene, projection: scene.origin ? transverseMercator(scene.origin) : null, track: null, camera: null, images: [], address, originals: imageFolder !== null,
    imageAddress: (name) => new URL(name.split('/').map(encodeURIComponent).join('/'), folder ?? source.base).href,
  };
  if (!dive.originals) complain('the original images are not there: the model is shown without them');
  if (!scene.origin) complain('nobody says where on the Earth this dive was: positions are in metres of its own');
  return dive;
}

// What fails is passed to `complain`.
export async function readRecords(dive: Dive, complain: (what: string) => void): Promise<void> {
  const { source, scene, address } = dive;
  const read = async (file: string | null, take: (value: Json) => void): Promise<void> => {
    if (file === null) return;
    try {
      take(await json(source, address(file)));
    } catch (error) {
      complain(error instanceof Error ? error.message : String(error));
    }
  };
  await Promise.all([
    read(scene.track, (value) => { dive.track = parseTrack(value); }),
    read(scene.images, (value) => {
      const { camera, images, dropped } = parseImages(value);
      Object.assign(dive, { camera, images });
      if (dropped > 0) complain(`images.json: ${dropped} entries without a name, place or attitude are left out`);
      if (!camera) complain('images.json tells no camera: which images saw a place is unknown');
    }),
  ]);
}
