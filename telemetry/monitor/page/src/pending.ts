import * as THREE from 'three';
import type { Place } from '#kit/place';
import type { Square } from './chunks';
import { COVERAGE_COLOURS } from './material';

// Squares that the vehicle has seen and the ship has not received: flat tiles at the depth that follows from the altitude.

const EDGE = 0.9; // of a square of one metre, so that single squares can be distinguished

export class Pending {
  readonly group = new THREE.Group();
  private material = new THREE.MeshBasicMaterial({
    color: new THREE.Color().setRGB(...(COVERAGE_COLOURS.pending.map((c) => c / 255) as [number, number, number]), THREE.SRGBColorSpace),
    transparent: true, opacity: 0.55, side: THREE.DoubleSide,
  });
  private mesh: THREE.Mesh | null = null;
  count = 0;

  set(squares: Square[], origin: Place): void {
    this.clear();
    this.count = squares.length;
    if (squares.length === 0) return;
    const positions = new Float32Array(squares.length * 12);
    const indices = new Uint32Array(squares.length * 6);
    squares.forEach(({ north, east, depth }, s) => {
      const x = east - origin.east + (1 - EDGE) / 2;
      const z = origin.north - north - (1 - EDGE) / 2;
      const y = origin.depth - depth;
      positions.set([x, y, z, x + EDGE, y, z, x + EDGE, y, z - EDGE, x, y, z - EDGE], 12 * s);
      indices.set([0, 1, 2, 0, 2, 3].map((i) => i + 4 * s), 6 * s);
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    geometry.setIndex(new THREE.BufferAttribute(indices, 1));
    this.mesh = new THREE.Mesh(geometry, this.material);
    this.group.add(this.mesh);
  }

  clear(): void {
    this.mesh?.geometry.dispose();
    this.group.clear();
    this.mesh = null;
    this.count = 0;
  }
}
