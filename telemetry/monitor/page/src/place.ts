// Places in nav (north, east, depth [m]) and what can be measured between them.

export interface Place {
  north: number;
  east: number;
  depth: number;
}
export type Origin = Place; // of the scene

export interface Measured {
  slope: number; // 3D distance [m]
  horizontal: number; // [m]
  drop: number; // depth of the second minus the first [m]
  bearing: number; // from the first to the second, from true north [deg]
}

export function measure(a: Place, b: Place): Measured {
  const north = b.north - a.north;
  const east = b.east - a.east;
  const drop = b.depth - a.depth;
  const horizontal = Math.hypot(north, east);
  const bearing = ((Math.atan2(east, north) * 180) / Math.PI + 360) % 360;
  return { slope: Math.hypot(horizontal, drop), horizontal, drop, bearing };
}

export interface Rectangle {
  northMin: number;
  northMax: number;
  eastMin: number;
  eastMax: number;
}

export function rectangle(a: Place, b: Place): Rectangle {
  return {
    northMin: Math.min(a.north, b.north),
    northMax: Math.max(a.north, b.north),
    eastMin: Math.min(a.east, b.east),
    eastMax: Math.max(a.east, b.east),
  };
}

export const areaOf = (r: Rectangle): number => (r.northMax - r.northMin) * (r.eastMax - r.eastMin);

// Latitude and longitude [deg] of a place near the mission's origin, for reading: from the radii of curvature of WGS84
// at the origin and the meridian's convergence; 2 cm off at 1 km. The exports carry exact positions.
export function geodetic(latitude: number, longitude: number, north: number, east: number): [number, number] {
  const a = 6378137;
  const e2 = 0.00669437999014;
  const phi = (latitude * Math.PI) / 180;
  const w = Math.sqrt(1 - e2 * Math.sin(phi) ** 2);
  const meridian = (a * (1 - e2)) / w ** 3;
  const normal = a / w;
  const dPhi = north / meridian - (Math.tan(phi) * east * east) / (2 * meridian * normal);
  const dLambda = east / (normal * Math.cos(phi + dPhi));
  return [latitude + (dPhi * 180) / Math.PI, longitude + (dLambda * 180) / Math.PI];
}
