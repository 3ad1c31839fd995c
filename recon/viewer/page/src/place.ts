import * as THREE from 'three';

// The scene's axes are the tiles' (glTF): x east, y up, z south; nav is north, east, depth. Metres, same origin.

export interface Place {
  north: number;
  east: number;
  depth: number;
}
export const toScene = (p: Place, into = new THREE.Vector3()): THREE.Vector3 => into.set(p.east, -p.depth, -p.north);
export const toNav = (v: THREE.Vector3): Place => ({ north: -v.z, east: v.x, depth: -v.y });

// A turn in nav (w, x, y, z) as it looks in the scene's axes.
export function turnToScene([w, x, y, z]: readonly [number, number, number, number]): THREE.Quaternion {
  return new THREE.Quaternion(y, -z, -x, w);
}

export interface Bounds {
  north0: number;
  east0: number;
  north1: number;
  east1: number;
}
