import * as THREE from 'three';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial, type LineMaterialParameters } from 'three/examples/jsm/lines/LineMaterial.js';
import { NAV_ORIGIN, toScene, type Place } from './place';

// A line of some width through places. It cannot be clicked.
export class Polyline {
  readonly object = new THREE.Group();
  private material: LineMaterial;
  private line: Line2 | null = null;
  // `linewidth` in pixels.
  constructor(parameters: LineMaterialParameters, private renderOrder = 0) {
    this.material = new LineMaterial({ transparent: true, ...parameters });
  }
  set(points: Place[], closed = false, origin = NAV_ORIGIN): void {
    this.line?.geometry.dispose();
    this.object.clear();
    const all = closed && points.length > 2 ? [...points, points[0]!] : points;
    if (all.length < 2) return;
    const geometry = new LineGeometry();
    geometry.setPositions(all.flatMap((p) => toScene(p, origin).toArray()));
    this.line = new Line2(geometry, this.material);
    this.line.renderOrder = this.renderOrder;
    this.line.raycast = () => undefined;
    this.line.frustumCulled = false;
    this.object.add(this.line);
  }
}
// Drawn over the ground that it belongs to.
export const OVER = { depthTest: false, depthWrite: false, transparent: true };
