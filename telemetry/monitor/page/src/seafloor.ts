import * as THREE from 'three';
import type { Place } from '#kit/place';
import { robustRange } from '#kit/ramps';
import { HAS_COLOUR, positionsOf, type Chunk } from './chunks';
import { SeafloorMaterial, type ColourMode } from './material';

// The map as one mesh a chunk, relative to the scene's origin. Only chunks that changed are rebuilt.

export interface Ranges {
  depth: [number, number]; // [m]
  sigma: [number, number]; // [m]
  age: [number, number]; // [s]
}

const LEAST_DEPTH_RANGE = 1; // a flat floor must not turn centimetres of noise into a rainbow [m]
const LEAST_SIGMA_RANGE = 0.01; // [m]
const LEAST_AGE_RANGE = 60; // [s]
const SAMPLES_PER_CHUNK = 128; // for the ranges

interface Shown {
  chunk: Chunk;
  mesh: THREE.Mesh;
  depths: number[]; // samples
  sigmas: number[];
  oldest: number; // received [s since base]
  hasColour: boolean;
  finest: number; // spacing code
}

export class Seafloor {
  readonly group = new THREE.Group();
  readonly material = new SeafloorMaterial();
  ranges: Ranges = { depth: [0, 1], sigma: [0, 0.01], age: [0, 60] };
  baseUtc = 0; // [s]
  private shown = new Map<string, Shown>();

  constructor(private origin: () => Place) {}

  get size(): number {
    return this.shown.size;
  }
  get triangles(): number {
    return this.sum((s) => s.chunk.triangles);
  }
  get vertices(): number {
    return this.sum((s) => s.chunk.vertices);
  }
  get hasColour(): boolean {
    return [...this.shown.values()].some((s) => s.hasColour);
  }
  // What the page keeps for the map, on its side and on the graphics card.
  get bytes(): number {
    return this.sum((s) => s.chunk.vertices * (28 + 2 * (12 + 4 + 4 + 4 + 8)) + s.chunk.indices.byteLength * 2);
  }
  private sum(of: (shown: Shown) => number): number {
    let total = 0;
    for (const shown of this.shown.values()) total += of(shown);
    return total;
  }

  put(chunks: Chunk[]): void {
    for (const chunk of chunks) this.putOne(chunk);
    if (chunks.length > 0) this.updateRanges();
  }

  clear(): void {
    for (const { mesh } of this.shown.values()) mesh.geometry.dispose();
    this.shown.clear();
    this.group.clear();
  }

  bounds(): THREE.Box3 {
    const box = new THREE.Box3();
    for (const { mesh } of this.shown.values())
      if (!mesh.geometry.boundingBox!.isEmpty())
        box.union(mesh.geometry.boundingBox!.clone().translate(mesh.position));
    return box;
  }

  setMode(mode: ColourMode, now: number): void {
    this.setNow(now);
    this.material.set('fineCode', Math.min(...[...this.shown.values()].map((s) => s.finest), 5));
    this.material.setMode(mode, mode === 'photo' || mode === 'coverage' ? [0, 1] : this.ranges[mode]);
  }

  setNow(now: number): void {
    let oldest = Infinity;
    for (const shown of this.shown.values()) oldest = Math.min(oldest, shown.oldest);
    const age = now - this.baseUtc - oldest;
    this.ranges.age = [0, Math.max(LEAST_AGE_RANGE, Number.isFinite(age) ? age : 0)];
    this.material.set('now', now - this.baseUtc);
  }

  private putOne(chunk: Chunk): void {
    const old = this.shown.get(chunk.key);
    if (old) {
      old.mesh.geometry.dispose();
      this.group.remove(old.mesh);
    }
    const origin = this.origin();
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positionsOf(chunk, origin.depth), 3));
    geometry.setAttribute('aNormal', new THREE.BufferAttribute(chunk.normals, 4, true));
    geometry.setAttribute('aColour', new THREE.BufferAttribute(chunk.colours, 4, true));
    geometry.setAttribute('aBounds', new THREE.BufferAttribute(chunk.bounds, 2));
    geometry.setAttribute('aTimes', new THREE.BufferAttribute(chunk.times, 2));
    geometry.setIndex(new THREE.BufferAttribute(chunk.indices, 1));
    const mesh = new THREE.Mesh(geometry, this.material);
    mesh.position.set(chunk.east - origin.east, 0, -(chunk.north - origin.north));
    this.material.set('originDepth', origin.depth);

    const shown: Shown = { chunk, mesh, depths: [], sigmas: [], oldest: Infinity, hasColour: false, finest: 7 };
    const box = new THREE.Box3();
    const positions = geometry.getAttribute('position');
    const step = Math.max(1, Math.floor(chunk.vertices / SAMPLES_PER_CHUNK));
    for (let v = 0; v < chunk.vertices; ++v) {
      const depth = chunk.depths[v]!;
      shown.oldest = Math.min(shown.oldest, chunk.times[2 * v]!);
      shown.finest = Math.min(shown.finest, chunk.normals[4 * v + 3]!);
      shown.hasColour ||= (chunk.colours[4 * v + 3]! & HAS_COLOUR) !== 0;
      if (v % step === 0) {
        shown.depths.push(depth);
        shown.sigmas.push(chunk.bounds[2 * v]! * 1e-3);
      }
    }
    if (chunk.vertices > 0) box.setFromArray(positions.array);
    geometry.boundingBox = box;
    geometry.boundingSphere = box.getBoundingSphere(new THREE.Sphere());
    this.shown.set(chunk.key, shown);
    this.group.add(mesh);
  }

  private updateRanges(): void {
    const depths = [...this.shown.values()].flatMap((s) => s.depths);
    const sigmas = [...this.shown.values()].flatMap((s) => s.sigmas);
    this.ranges.depth = robustRange(depths, LEAST_DEPTH_RANGE);
    this.ranges.sigma = [0, Math.max(LEAST_SIGMA_RANGE, robustRange(sigmas, 0)[1])];
  }
}
