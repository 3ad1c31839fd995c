import type { GeoTIFF, GeoTIFFImage } from 'geotiff';
import { learnProjection, projectionOf, transverseMercator, utm, utmZone, type Geodetic, type NorthEast, type Projection } from '#kit/geodesy';
import type { HeightGrid } from '#kit/measure';
import type { Bounds } from '#kit/place';

// Georeferenced pictures on the nav plane: the dive's own layers, and rasters that users bring (GeoTIFF, or a picture
// with a world file) in any transverse Mercator, UTM or geographic coordinates.

// From north and east to (u, v) in 0..1 of the raster, v down from its top: u = n * m[0] + e * m[1] + m[2], v alike.
export type Placement = [number, number, number, number, number, number];

export type Crs = (p: NorthEast) => [x: number, y: number]; // from nav to the raster's own coordinates

export interface Grid {
  // Pixel (column, row) of the raster's coordinates: x = a * column + b * row + c and y = d * column + e * row + f.
  a: number; b: number; c: number; d: number; e: number; f: number;
  width: number;
  height: number;
}

// The placement near `bounds` as an affine map (a dive is small beside the earth), by least squares over a grid of nav
// points, and how far it is off at worst [raster pixels].
export function placementOf(grid: Grid, crs: Crs, bounds: Bounds): { placement: Placement; residual: number } {
  const determinant = grid.a * grid.e - grid.b * grid.d;
  if (!(Math.abs(determinant) > 0)) throw new Error('has no pixel size');
  const n0 = (bounds.north0 + bounds.north1) / 2;
  const e0 = (bounds.east0 + bounds.east1) / 2;
  const half = Math.max(bounds.north1 - bounds.north0, bounds.east1 - bounds.east0, 1) / 2;
  const samples: [s: number, t: number, u: number, v: number][] = [];
  for (let i = -2; i <= 2; ++i)
    for (let j = -2; j <= 2; ++j) {
      const [x, y] = crs({ north: n0 + (half * i) / 2, east: e0 + (half * j) / 2 });
      const column = (grid.e * (x - grid.c) - grid.b * (y - grid.f)) / determinant;
      const row = (grid.a * (y - grid.f) - grid.d * (x - grid.c)) / determinant;
      samples.push([i / 2, j / 2, column / grid.width, row / grid.height]);
    }
  // The samples are symmetric about the middle, so the normal equations are diagonal.
  const fit = (k: 2 | 3): [number, number, number] => {
    let [c0, cn, ce, q] = [0, 0, 0, 0];
    for (const s of samples) {
      c0 += s[k] / samples.length;
      cn += s[k] * s[0];
      ce += s[k] * s[1];
      q += s[0] * s[0];
    }
    return [cn / q, ce / q, c0];
  };
  const u = fit(2);
  const v = fit(3);
  let residual = 0;
  for (const [s, t, su, sv] of samples)
    residual = Math.max(residual, Math.hypot((u[0] * s + u[1] * t + u[2] - su) * grid.width, (v[0] * s + v[1] * t + v[2] - sv) * grid.height));
  const row = ([n, e, c]: [number, number, number]): [number, number, number] => [n / half, e / half, c - (n * n0 + e * e0) / half];
  return { placement: [...row(u), ...row(v)], residual };
}

export const place = (m: Placement, north: number, east: number): [u: number, v: number] => [
  m[0] * north + m[1] * east + m[2], m[3] * north + m[4] * east + m[5],
];

// Where a placement's picture is.
export function boundsOf(m: Placement): Bounds {
  const determinant = m[0] * m[4] - m[1] * m[3];
  const corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(([u, v]) => {
    const [p, q] = [u! - m[2], v! - m[5]];
    return [(m[4] * p - m[1] * q) / determinant, (m[0] * q - m[3] * p) / determinant];
  });
  const norths = corners.map((c) => c[0]!);
  const easts = corners.map((c) => c[1]!);
  return { north0: Math.min(...norths), east0: Math.min(...easts), north1: Math.max(...norths), east1: Math.max(...easts) };
}

type Keys = Record<string, number | undefined>;
const PROJECTED = 1;
const USER_DEFINED = 32767;
const POINT_IS_PIXEL = 2;

const through = (nav: Projection, raster: Projection): Crs => (p) => {
  const { east, north } = raster.toLocal(nav.toGeodetic(p));
  return [east, north];
};

// The raster's coordinates as its GeoTIFF keys tell them; null and why where this page does not know them.
export function crsOfKeys(keys: Keys, projection: Projection | null): { crs: Crs; text: string } | string {
  const nav: Crs = ({ north, east }) => [east, north];
  const code = keys.ProjectedCSTypeGeoKey ?? USER_DEFINED;
  const geodetic = (p: NorthEast): Geodetic => projection!.toGeodetic(p);
  if (keys.GTModelTypeGeoKey === undefined && keys.ProjectedCSTypeGeoKey === undefined && keys.GeographicTypeGeoKey === undefined)
    return { crs: nav, text: 'no coordinate system in the file: taken as nav metres' };
  if (!projection) return { crs: nav, text: 'the dive has no origin: taken as nav metres' };
  if ((keys.GTModelTypeGeoKey ?? PROJECTED) !== PROJECTED)
    return { crs: (p) => { const g = geodetic(p); return [g.longitude, g.latitude]; }, text: 'latitude and longitude' };
  const south = code >= 32701 && code <= 32760;
  const known = code === USER_DEFINED ? null : projectionOf(code);
  if (known) return { crs: through(projection, known), text: south || (code >= 32601 && code <= 32660) ? `UTM ${code % 100}${south ? 'S' : 'N'}` : `EPSG:${code}` };
  const latitude = keys.ProjNatOriginLatGeoKey ?? keys.ProjCenterLatGeoKey;
  const longitude = keys.ProjNatOriginLongGeoKey ?? keys.ProjCenterLongGeoKey;
  if (latitude !== undefined && longitude !== undefined && (keys.ProjCoordTransGeoKey === undefined || keys.ProjCoordTransGeoKey === 1)) {
    const tm = transverseMercator({ latitude, longitude }, keys.ProjScaleAtNatOriginGeoKey ?? 1, keys.ProjFalseNorthingGeoKey ?? 0, keys.ProjFalseEastingGeoKey ?? 0);
    return { crs: through(projection, tm), text: 'local transverse Mercator' };
  }
  return code === USER_DEFINED ? 'its projection is none that this page knows (transverse Mercator, UTM, latitude and longitude)'
    : `EPSG:${code} is none that this page knows: convert it to UTM on WGS84, or latitude and longitude`;
}

export function gridOfTags(image: GeoTIFFImage): Grid {
  const tags = image.fileDirectory as { ModelTransformation?: number[]; ModelPixelScale?: number[]; ModelTiepoint?: number[] };
  const [width, height] = [image.getWidth(), image.getHeight()];
  const shift = (image.getGeoKeys() as Keys | null)?.GTRasterTypeGeoKey === POINT_IS_PIXEL ? 0.5 : 0;
  const m = tags.ModelTransformation;
  if (m) return { a: m[0]!, b: m[1]!, c: m[3]! - shift * (m[0]! + m[1]!), d: m[4]!, e: m[5]!, f: m[7]! - shift * (m[4]! + m[5]!), width, height };
  const scale = tags.ModelPixelScale;
  const tie = tags.ModelTiepoint;
  if (!scale || !tie) throw new Error('has no position: neither pixel scale with tie point nor transformation');
  const [sx, sy] = [scale[0]!, scale[1]!];
  return { a: sx, b: 0, c: tie[3]! - (tie[0]! + shift) * sx, d: 0, e: -sy, f: tie[4]! + (tie[1]! + shift) * sy, width, height };
}

// Six lines of a world file: they speak of pixel centres, the grid of corners.
export function gridOfWorldFile(text: string, width: number, height: number): Grid {
  const v = text.trim().split(/\s+/).map(Number);
  if (v.length < 6 || !v.slice(0, 6).every(Number.isFinite)) throw new Error('the world file does not hold six numbers');
  const [a, d, b, e, c, f] = v as [number, number, number, number, number, number];
  return { a, b, c: c - (a + b) / 2, d, e, f: f - (d + e) / 2, width, height };
}

// A world file tells no coordinate system. Numbers that fit the globe with small pixels are degrees; large ones, UTM of the
// dive's zone; else nav metres.
export function crsOfWorldFile(grid: Grid, projection: Projection | null): { crs: Crs; text: string } {
  const nav = { crs: (({ north, east }) => [east, north]) as Crs, text: 'nav metres' };
  if (!projection) return nav;
  if (Math.abs(grid.c) <= 360 && Math.abs(grid.f) <= 90 && Math.abs(grid.a) < 1e-2)
    return { crs: (p) => { const g = projection.toGeodetic(p); return [g.longitude, g.latitude]; }, text: 'latitude and longitude' };
  if (Math.abs(grid.c) > 100_000) {
    const origin = projection.toGeodetic({ north: 0, east: 0 });
    const [zone, south] = [utmZone(origin.longitude), origin.latitude < 0];
    return { crs: through(projection, utm(zone, south)), text: `UTM ${zone}${south ? 'S' : 'N'}, by the dive's place` };
  }
  return nav;
}

export const NO_DATA = -3e38; // what stands for "no value" in the arrays handed to the graphics card

export interface Patch {
  values: Float32Array | Uint8Array; // one sample a pixel, or four
  scalar: boolean;
  width: number;
  height: number;
  placement: Placement; // of this patch alone
}

// A raster that is read by windows, at the overview that has the resolution wanted.
export class Raster {
  private constructor(private images: GeoTIFFImage[], readonly placement: Placement, readonly about: string, readonly residual: number) {}

  static async open(tiff: GeoTIFF, projection: Projection | null, near: Bounds): Promise<Raster> {
    const first = await tiff.getImage();
    const images = [first];
    for (let i = 1; i < (await tiff.getImageCount()); ++i) {
      const image = await tiff.getImage(i);
      const kind = (image.fileDirectory as { NewSubfileType?: number }).NewSubfileType ?? 0;
      if ((kind & 1) !== 0 && (kind & 4) === 0 && image.getSamplesPerPixel() === first.getSamplesPerPixel()) images.push(image);
    }
    const keys = (first.getGeoKeys() as Keys | null) ?? {};
    if (keys.ProjectedCSTypeGeoKey !== undefined && keys.ProjectedCSTypeGeoKey !== USER_DEFINED) await learnProjection(keys.ProjectedCSTypeGeoKey);
    const known = crsOfKeys(keys, projection);
    if (typeof known === 'string') throw new Error(known);
    const { placement, residual } = placementOf(gridOfTags(first), known.crs, near);
    return new Raster(images.sort((a, b) => b.getWidth() - a.getWidth()), placement, known.text, residual);
  }

  get scalar(): boolean {
    return this.images[0]!.getSamplesPerPixel() < 3;
  }
  get width(): number {
    return this.images[0]!.getWidth();
  }
  get height(): number {
    return this.images[0]!.getHeight();
  }
  // Size of the finest pixel on the ground [m].
  get step(): number {
    return 1 / (this.width * Math.hypot(this.placement[0], this.placement[1]));
  }
  get bounds(): Bounds {
    return boundsOf(this.placement);
  }

  // The part over `bounds` with at most `edge` pixels a side; null where the raster does not reach.
  async read(bounds: Bounds, edge: number): Promise<Patch | null> {
    const corners = [[bounds.north0, bounds.east0], [bounds.north0, bounds.east1], [bounds.north1, bounds.east0], [bounds.north1, bounds.east1]]
      .map(([n, e]) => place(this.placement, n!, e!));
    const cut = (v: number): number => Math.min(Math.max(v, 0), 1);
    const [u0, u1] = [cut(Math.min(...corners.map((c) => c[0]))), cut(Math.max(...corners.map((c) => c[0])))];
    const [v0, v1] = [cut(Math.min(...corners.map((c) => c[1]))), cut(Math.max(...corners.map((c) => c[1])))];
    if (u1 <= u0 || v1 <= v0) return null;
    const fits = (image: GeoTIFFImage): boolean => (u1 - u0) * image.getWidth() <= edge && (v1 - v0) * image.getHeight() <= edge;
    const image = this.images.find(fits) ?? this.images.at(-1)!;
    const [W, H] = [image.getWidth(), image.getHeight()];
    const window = [Math.floor(u0 * W), Math.floor(v0 * H), Math.min(W, Math.ceil(u1 * W)), Math.min(H, Math.ceil(v1 * H))] as [number, number, number, number];
    const full = [window[2] - window[0], window[3] - window[1]] as const;
    // Without overviews the library thins the rows and columns itself.
    const shrink = Math.max(1, full[0] / edge, full[1] / edge);
    const [width, height] = [Math.max(1, Math.round(full[0] / shrink)), Math.max(1, Math.round(full[1] / shrink))];
    const bands = image.getSamplesPerPixel();
    const raw = (await image.readRasters({
      window, width, height, interleave: true, ...(this.scalar ? { samples: [0] } : {}),
    })) as unknown as Float32Array;
    const own: Placement = [
      (this.placement[0] * W) / full[0], (this.placement[1] * W) / full[0], (this.placement[2] * W - window[0]) / full[0],
      (this.placement[3] * H) / full[1], (this.placement[4] * H) / full[1], (this.placement[5] * H - window[1]) / full[1],
    ];
    if (this.scalar) {
      const noData = image.getGDALNoData();
      const values = Float32Array.from(raw, (v) => (Number.isFinite(v) && v !== noData ? v : NO_DATA));
      return { values, scalar: true, width, height, placement: own };
    }
    const values = new Uint8Array(width * height * 4);
    const scale = (raw as unknown) instanceof Uint16Array ? 1 / 257 : 1;
    for (let i = 0; i < width * height; ++i) {
      for (let c = 0; c < 3; ++c) values[4 * i + c] = raw[bands * i + c]! * scale;
      values[4 * i + 3] = bands > 3 ? raw[bands * i + 3]! * scale : 255;
    }
    return { values, scalar: false, width, height, placement: own };
  }

  // The value at a place, at full resolution; NaN without.
  async valueAt(north: number, east: number): Promise<number> {
    const [u, v] = place(this.placement, north, east);
    if (!this.scalar || u < 0 || v < 0 || u >= 1 || v >= 1) return NaN;
    const [x, y] = [Math.floor(u * this.width), Math.floor(v * this.height)];
    const raw = (await this.images[0]!.readRasters({ window: [x, y, x + 1, y + 1], samples: [0], interleave: true })) as unknown as Float32Array;
    return raw[0] === this.images[0]!.getGDALNoData() ? NaN : raw[0]!;
  }

  // Values over `bounds` as a grid along north and east (for profiles and areas).
  async grid(bounds: Bounds, edge: number): Promise<HeightGrid | null> {
    const patch = await this.read(bounds, edge);
    if (!patch || !patch.scalar) return null;
    const b = boundsOf(patch.placement);
    const step = (b.east1 - b.east0) / patch.width;
    const values = Float32Array.from(patch.values, (v) => (v <= NO_DATA / 2 ? NaN : v));
    return { values, width: patch.width, height: patch.height, north: b.north1 - step / 2, east: b.east0 + step / 2, step };
  }
}
