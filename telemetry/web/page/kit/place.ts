import * as THREE from 'three';

// Places in nav (north, east, depth [m]), and the scene's axes, which are glTF's: x east, y up, z south. The scene's origin is
// nav's unless one is given.

export interface Place {
  north: number;
  east: number;
  depth: number;
}
export interface Bounds {
  north0: number;
  east0: number;
  north1: number;
  east1: number;
}
// The box about two places, and what it covers [m2].
export const boundsAbout = (a: Place, b: Place): Bounds => ({
  north0: Math.min(a.north, b.north), east0: Math.min(a.east, b.east), north1: Math.max(a.north, b.north), east1: Math.max(a.east, b.east),
});
export const areaOf = (b: Bounds): number => (b.north1 - b.north0) * (b.east1 - b.east0);

export const NAV_ORIGIN: Place = { north: 0, east: 0, depth: 0 };

export const toScene = (p: Place, origin = NAV_ORIGIN): THREE.Vector3 =>
  new THREE.Vector3(p.east - origin.east, origin.depth - p.depth, origin.north - p.north);
export const toNav = (v: THREE.Vector3, origin = NAV_ORIGIN): Place => ({ north: origin.north - v.z, east: origin.east + v.x, depth: origin.depth - v.y });

// A turn in nav (w, x, y, z) as it looks in the scene's axes.
export function turnToScene([w, x, y, z]: readonly [number, number, number, number]): THREE.Quaternion {
  return new THREE.Quaternion(y, -z, -x, w);
}
