import proj4 from 'proj4';

// Map projections on WGS84, by proj4: the nav frame (transverse Mercator about the dive's origin, scale 1), UTM zones and what
// else proj4 knows by its EPSG code.

export interface Geodetic {
  latitude: number; // [deg]
  longitude: number; // [deg]
}
export interface NorthEast {
  north: number; // [m]
  east: number; // [m]
}

export class Projection {
  private readonly converter: proj4.Converter;
  constructor(definition: string) {
    this.converter = proj4('EPSG:4326', definition);
  }
  toLocal({ latitude, longitude }: Geodetic): NorthEast {
    const [east, north] = this.converter.forward([longitude, latitude]);
    return { north, east };
  }
  toGeodetic({ north, east }: NorthEast): Geodetic {
    const [longitude, latitude] = this.converter.inverse([east, north]);
    return { latitude, longitude };
  }
}

export const transverseMercator = (origin: Geodetic, scale = 1, falseNorth = 0, falseEast = 0): Projection =>
  new Projection(`+proj=tmerc +lat_0=${origin.latitude} +lon_0=${origin.longitude} +k=${scale} +x_0=${falseEast} +y_0=${falseNorth} +datum=WGS84`);

export const utm = (zone: number, south: boolean): Projection => new Projection(`EPSG:${(south ? 32700 : 32600) + zone}`);
export const utmZone = (longitude: number): number => Math.min(60, Math.floor((longitude + 180) / 6) + 1);

// The projection of an EPSG code, or null where neither proj4 nor learnProjection() knows it.
export const projectionOf = (code: number): Projection | null => (proj4.defs(`EPSG:${code}`) ? new Projection(`EPSG:${code}`) : null);

// Asks the server that brought the page, which has PROJ's database, for a code that proj4 does not know.
export async function learnProjection(code: number): Promise<Projection | null> {
  if (!projectionOf(code)) {
    const answer = await fetch(`crs/${code}`).catch(() => null);
    const definition = answer?.ok ? await answer.text() : '';
    if (definition.startsWith('+proj=')) proj4.defs(`EPSG:${code}`, definition);
  }
  return projectionOf(code);
}
