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
// Drawn over the ground that it belongs to.
export const OVER = { depthTest: false, depthWrite: false, transparent: true };
