// Transverse Mercator on WGS84, forward and back: the nav frame (centred on the dive's origin, scale 1) and UTM zones.
// Krueger's series in the third flattening, to the fourth order (Karney 2011, "Transverse Mercator with an accuracy of a
// few nanometers", eq. 35 and 36): far below a millimetre within a thousand kilometres of the central meridian.

const A = 6378137;
const F = 1 / 298.257223563;
const N = F / (2 - F);
const E2 = F * (2 - F);
const E1 = Math.sqrt(E2);
const RECTIFYING = (A / (1 + N)) * (1 + N ** 2 / 4 + N ** 4 / 64);
const ALPHA = [
  N / 2 - (2 * N ** 2) / 3 + (5 * N ** 3) / 16 + (41 * N ** 4) / 180,
  (13 * N ** 2) / 48 - (3 * N ** 3) / 5 + (557 * N ** 4) / 1440,
  (61 * N ** 3) / 240 - (103 * N ** 4) / 140,
  (49561 * N ** 4) / 161280,
];
const BETA = [
  N / 2 - (2 * N ** 2) / 3 + (37 * N ** 3) / 96 - N ** 4 / 360,
  N ** 2 / 48 + N ** 3 / 15 - (437 * N ** 4) / 1440,
  (17 * N ** 3) / 480 - (37 * N ** 4) / 840,
  (4397 * N ** 4) / 161280,
];
const RAD = Math.PI / 180;

export interface Geodetic {
  latitude: number; // [deg]
  longitude: number; // [deg]
}
export interface NorthEast {
  north: number; // [m]
  east: number; // [m]
}

const conformal = (sine: number): number => Math.sinh(Math.atanh(sine) - E1 * Math.atanh(E1 * sine));

export class TransverseMercator {
  private readonly meridian: number; // distance of the origin's latitude from the equator [m]
  constructor(
    readonly origin: Geodetic,
    readonly scale = 1,
    readonly falseNorth = 0,
    readonly falseEast = 0,
  ) {
    this.meridian = this.project(origin.latitude, origin.longitude)[0];
  }

  private project(latitude: number, longitude: number): [north: number, east: number] {
    const lambda = (longitude - this.origin.longitude) * RAD;
    const t = conformal(Math.sin(latitude * RAD));
    const xi0 = Math.atan2(t, Math.cos(lambda));
    const eta0 = Math.asinh(Math.sin(lambda) / Math.hypot(t, Math.cos(lambda)));
    let xi = xi0;
    let eta = eta0;
    ALPHA.forEach((a, i) => {
      const k = 2 * (i + 1);
      xi += a * Math.sin(k * xi0) * Math.cosh(k * eta0);
      eta += a * Math.cos(k * xi0) * Math.sinh(k * eta0);
    });
    return [RECTIFYING * xi, RECTIFYING * eta];
  }

  toLocal({ latitude, longitude }: Geodetic): NorthEast {
    const [north, east] = this.project(latitude, longitude);
    return {
      north: (north - this.meridian) * this.scale + this.falseNorth,
      east: east * this.scale + this.falseEast,
    };
  }

  toGeodetic({ north, east }: NorthEast): Geodetic {
    const xi0 = ((north - this.falseNorth) / this.scale + this.meridian) / RECTIFYING;
    const eta0 = (east - this.falseEast) / this.scale / RECTIFYING;
    let xi = xi0;
    let eta = eta0;
    BETA.forEach((b, i) => {
      const k = 2 * (i + 1);
      xi -= b * Math.sin(k * xi0) * Math.cosh(k * eta0);
      eta -= b * Math.cos(k * xi0) * Math.sinh(k * eta0);
    });
    const target = Math.sin(xi) / Math.hypot(Math.sinh(eta), Math.cos(xi));
    // Newton on the conformal latitude's tangent (Karney, eq. 19 to 21); three rounds reach double precision.
    let tan = target / (1 - E2);
    for (let round = 0; round < 4; ++round) {
      const sine = tan / Math.hypot(1, tan);
      const here = conformal(sine);
      tan += ((target - here) / Math.hypot(1, here)) * ((1 + (1 - E2) * tan ** 2) / ((1 - E2) * Math.hypot(1, tan)));
    }
    return {
      latitude: Math.atan(tan) / RAD,
      longitude: this.origin.longitude + Math.atan2(Math.sinh(eta), Math.cos(xi)) / RAD,
    };
  }
}

const UTM_SCALE = 0.9996;
const UTM_FALSE_EAST = 500_000;
const UTM_FALSE_NORTH_SOUTH = 10_000_000;

export function utm(zone: number, south: boolean): TransverseMercator {
  return new TransverseMercator({ latitude: 0, longitude: zone * 6 - 183 }, UTM_SCALE, south ? UTM_FALSE_NORTH_SOUTH : 0, UTM_FALSE_EAST);
}
export const utmZone = (longitude: number): number => Math.min(60, Math.floor((longitude + 180) / 6) + 1);
