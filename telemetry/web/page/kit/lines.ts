import * as THREE from 'three';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial, type LineMaterialParameters } from 'three/examples/jsm/lines/LineMaterial.js';
import { NAV_ORIGIN, toScene, type Place } from './place';

// A line of some width through places, broken where one of them is null. It cannot be clicked.
export class Polyline {
  readonly object = new THREE.Group();
  private material: LineMaterial;
  private lines: Line2[] = [];
  // `linewidth` in pixels.
  constructor(parameters: LineMaterialParameters, private renderOrder = 0) {
    this.material = new LineMaterial({ transparent: true, ...parameters });
  }
  set(points: (Place | null)[], closed = false, origin = NAV_ORIGIN): void {
    for (const line of this.lines) line.geometry.dispose();
    this.lines = [];
    this.object.clear();
    const all = closed && points.length > 2 ? [...points, points[0]!] : points;
    let stretch: number[] = [];
    for (const p of [...all, null]) {
      if (p) {
        stretch.push(...toScene(p, origin).toArray());
        continue;
      }
      if (stretch.length >= 6) this.add(stretch);
      stretch = [];
    }
  }
  private add(positions: number[]): void {
    const geometry = new LineGeometry();
    geometry.setPositions(positions);
    const line = new Line2(geometry, this.material);
    line.renderOrder = this.renderOrder;
    line.raycast = () => undefined;
    line.frustumCulled = false;
    this.lines.push(line);
    this.object.add(line);
  }
}
// Numbers of the points of a line that are left where no other is farther from it than `within` (Douglas and Peucker 1973).
export function simplified(points: THREE.Vector3[], within: number): number[] {
  const kept = new Set([0, points.length - 1]);
  const open: [number, number][] = [[0, points.length - 1]];
  const on = new THREE.Vector3();
  while (open.length > 0) {
    const [from, to] = open.pop()!;
    const line = new THREE.Line3(points[from]!, points[to]!);
    let [farthest, most] = [-1, within];
    for (let i = from + 1; i < to; ++i) {
      const off = line.closestPointToPoint(points[i]!, true, on).distanceTo(points[i]!);
      if (off > most) [farthest, most] = [i, off];
    }
    if (farthest < 0) continue;
    kept.add(farthest);
    open.push([from, farthest], [farthest, to]);
  }
  return [...kept].sort((a, b) => a - b);
}

// A line of any length, a pixel wide: pieces of it that are out of sight are not drawn, the others with as many points as the
// picture can show.
export class LongLine {
  readonly object = new THREE.Group();
  private material: THREE.LineBasicMaterial;
  private pieces: { line: THREE.Line; points: THREE.Vector3[]; middle: THREE.Sphere; level: number; levels: (THREE.BufferGeometry | undefined)[] }[] = [];
  private static readonly LENGTH = 400; // points of a piece
  private static readonly LEVELS = [0, 0.04, 0.16, 0.64, 2.56]; // by so much points may be off the line that is drawn [m]

  constructor(parameters: THREE.LineBasicMaterialParameters, private renderOrder = 0) {
    this.material = new THREE.LineBasicMaterial({ transparent: true, ...parameters });
  }
  set(points: (Place | null)[]): void {
    for (const { levels } of this.pieces) for (const level of levels) level?.dispose();
    this.pieces = [];
    this.object.clear();
    let piece: THREE.Vector3[] = [];
    for (const p of [...points, null]) {
      if (p) piece.push(toScene(p));
      if (p && piece.length < LongLine.LENGTH) continue;
      if (piece.length > 1) this.add(piece);
      piece = p ? piece.slice(-1) : [];
    }
  }
  // Before a frame: as the camera sees it, in a picture of that height [px].
  look(camera: THREE.PerspectiveCamera, height: number): void {
    const pixel = (2 * Math.tan(THREE.MathUtils.degToRad(camera.fov / 2))) / height; // of what is a metre away [m]
    for (const piece of this.pieces) {
      const size = pixel * Math.max(camera.position.distanceTo(piece.middle.center) - piece.middle.radius, 0);
      const level = LongLine.LEVELS.filter((within) => within <= size).length - 1;
      if (level !== piece.level) this.show(piece, level);
    }
  }
  private add(points: THREE.Vector3[]): void {
    const line = new THREE.Line(undefined, this.material);
    line.renderOrder = this.renderOrder;
    line.raycast = () => undefined;
    const piece = { line, points, middle: new THREE.Sphere().setFromPoints(points), level: -1, levels: [] };
    this.pieces.push(piece);
    this.show(piece, LongLine.LEVELS.length - 1);
    this.object.add(line);
  }
  private show(piece: (typeof this.pieces)[number], level: number): void {
    piece.level = level;
    const { points, levels } = piece;
    levels[level] ??= new THREE.BufferGeometry().setFromPoints(simplified(points, LongLine.LEVELS[level]!).map((i) => points[i]!));
    piece.line.geometry = levels[level];
  }
}

// Drawn over the ground that it belongs to.
export const OVER = { depthTest: false, depthWrite: false, transparent: true };
