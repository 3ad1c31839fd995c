import * as THREE from 'three';
import type { Standpoint } from '#kit/view';

// A smooth path from one view to another: the height over what is looked at changes in equal ratios a second, and the point
// looked at moves as far as it should at that height, so the goal does not leave the picture (after van Wijk and Nuij 2003,
// "Smooth and efficient zooming and panning", for the case without a detour over the top).

const SECONDS_A_DECADE = 0.9; // of change of distance
const LEAST_SECONDS = 0.7;
const MOST_SECONDS = 3.5;
const FAR_JUMP = 3; // a pan of more than this many heights first climbs

const ease = (t: number): number => t * t * (3 - 2 * t);

export class Flight {
  readonly seconds: number;
  private readonly turn: [THREE.Quaternion, THREE.Quaternion];
  private readonly distance: [number, number];
  private readonly climb: number; // factor on the distance halfway

  constructor(readonly from: Standpoint, readonly to: Standpoint) {
    const facing = (p: Standpoint): THREE.Quaternion => new THREE.Quaternion().setFromRotationMatrix(new THREE.Matrix4().lookAt(p.eye, p.look, p.up));
    this.turn = [facing(from), facing(to)];
    this.distance = [Math.max(from.eye.distanceTo(from.look), 1e-3), Math.max(to.eye.distanceTo(to.look), 1e-3)];
    const apart = from.look.distanceTo(to.look);
    const height = Math.max(...this.distance);
    this.climb = apart > FAR_JUMP * height ? apart / (FAR_JUMP * height) : 1;
    const decades = Math.abs(Math.log10(this.distance[1] / this.distance[0])) + 2 * Math.log10(this.climb) + Math.min(apart / height, 2) / 2;
    this.seconds = Math.min(Math.max(SECONDS_A_DECADE * decades, LEAST_SECONDS), MOST_SECONDS);
  }

  // The view at t in 0..1 of the path.
  at(t: number): { eye: THREE.Vector3; look: THREE.Vector3; turn: THREE.Quaternion } {
    const s = ease(Math.min(Math.max(t, 0), 1));
    const [d0, d1] = this.distance;
    const hill = this.climb ** Math.sin(Math.PI * s);
    const distance = d0 * (d1 / d0) ** s * hill;
    const ratio = d1 / d0;
    const moved = this.climb > 1 || Math.abs(ratio - 1) < 1e-3 ? s : (1 - ratio ** s) / (1 - ratio);
    const look = this.from.look.clone().lerp(this.to.look, moved);
    const turn = this.turn[0].clone().slerp(this.turn[1], s);
    const eye = look.clone().addScaledVector(new THREE.Vector3(0, 0, 1).applyQuaternion(turn), distance);
    return { eye, look, turn };
  }
}
