import * as THREE from 'three';
import { MAGMA, VIRIDIS, ramp, robustRange, type Rgb } from './ramps';
import { CELLS, tileKey, tileTriangles, type Tile } from './tiles';

// The map as meshes in the scene: x east, y up, z south, relative to an origin near the first tile.

export type ColourMode = 'depth' | 'photo' | 'sigma' | 'age';

export interface Ranges {
  depth: [number, number]; // [m]
  sigma: [number, number]; // [m]
  age: [number, number]; // [s]
}

export interface Origin {
  north: number;
  east: number;
  depth: number;
}

const LEAST_DEPTH_RANGE = 1; // a flat floor must not turn centimetres of noise into a rainbow [m]
const LEAST_SIGMA_RANGE = 0.01; // [m]
const LEAST_AGE_RANGE = 60; // [s]
const NO_COLOUR: Rgb = [120, 128, 134];

interface Shown {
  tile: Tile;
  mesh: THREE.Mesh;
}

export class Seafloor {
  readonly group = new THREE.Group();
  origin: Origin | null = null;
  ranges: Ranges = { depth: [0, 1], sigma: [0, 1], age: [0, 1] };
  private shown = new Map<string, Shown>();
  private mode: ColourMode = 'depth';
  private now = 0;
  private material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });

  get size(): number {
    return this.shown.size;
  }
  get hasColour(): boolean {
    return [...this.shown.values()].some((s) => s.tile.colourBits > 0);
  }

  put(tiles: Tile[]): void {
    const rebuild = new Set<string>();
    for (const tile of tiles) {
      this.origin ??= {
        north: tile.northIndex * tile.size,
        east: tile.eastIndex * tile.size,
        depth: tile.depths.find((d) => !Number.isNaN(d)) ?? 0,
      };
      const old = this.shown.get(tile.key);
      if (old) {
        old.tile = tile;
      } else {
        const mesh = new THREE.Mesh(new THREE.BufferGeometry(), this.material);
        this.shown.set(tile.key, { tile, mesh });
        this.group.add(mesh);
      }
      // Shading at a tile's border looks across it.
      for (const [dn, de] of [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]] as const)
        rebuild.add(tileKey(tile.level, tile.northIndex + dn, tile.eastIndex + de));
    }
    for (const key of rebuild) {
      const entry = this.shown.get(key);
      if (entry) this.build(entry);
    }
    this.recolour();
  }

  setMode(mode: ColourMode, nowUtc: number): void {
    this.mode = mode;
    this.now = nowUtc;
    this.recolour();
  }

  bounds(): THREE.Box3 {
    return new THREE.Box3().setFromObject(this.group);
  }

  // Depth at a node, also beyond the tile's border where the neighbour of the same level is known.
  private depthAt(tile: Tile, i: number, j: number): number {
    const last = tile.side - 1;
    const dn = i < 0 ? -1 : i > last ? 1 : 0;
    const de = j < 0 ? -1 : j > last ? 1 : 0;
    if (dn === 0 && de === 0) return tile.depths[i * tile.side + j]!;
    const next = this.shown.get(tileKey(tile.level, tile.northIndex + dn, tile.eastIndex + de))?.tile;
    if (!next) return NaN;
    const row = ((i - dn * last) * tile.stride) / next.stride;
    const column = ((j - de * last) * tile.stride) / next.stride;
    return Number.isInteger(row) && Number.isInteger(column) ? next.depths[row * next.side + column]! : NaN;
  }

  private build({ tile, mesh }: Shown): void {
    const origin = this.origin!;
    const { side, stride } = tile;
    const step = (tile.size / CELLS) * stride;
    const positions = new Float32Array(side * side * 3);
    const normals = new Float32Array(side * side * 3);
    for (let i = 0; i < side; ++i) {
      for (let j = 0; j < side; ++j) {
        const n = i * side + j;
        const depth = tile.depths[n]!;
        const slope = (before: number, after: number): number => {
          const low = Number.isNaN(before) ? depth : before;
          const high = Number.isNaN(after) ? depth : after;
          const spans = Number(!Number.isNaN(before)) + Number(!Number.isNaN(after));
          return spans === 0 ? 0 : (high - low) / (spans * step);
        };
        const down = Number.isNaN(depth) ? origin.depth : depth;
        positions.set(
          [tile.eastIndex * tile.size + j * step - origin.east, origin.depth - down,
            -(tile.northIndex * tile.size + i * step - origin.north)], n * 3);
        const east = slope(this.depthAt(tile, i, j - 1), this.depthAt(tile, i, j + 1));
        const north = slope(this.depthAt(tile, i - 1, j), this.depthAt(tile, i + 1, j));
        const length = Math.hypot(east, north, 1);
        normals.set([east / length, 1 / length, -north / length], n * 3);
      }
    }
    mesh.geometry.dispose();
    mesh.geometry = new THREE.BufferGeometry();
    mesh.geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    mesh.geometry.setAttribute('normal', new THREE.BufferAttribute(normals, 3));
    mesh.geometry.setAttribute('color', new THREE.BufferAttribute(new Float32Array(side * side * 3), 3));
    mesh.geometry.setIndex(tileTriangles(tile));
  }

  private updateRanges(): void {
    const depths: number[] = [];
    const sigmas: number[] = [];
    const ages: number[] = [];
    for (const { tile } of this.shown.values()) {
      for (const d of tile.depths) if (!Number.isNaN(d)) depths.push(d);
      sigmas.push(tile.sigma);
      ages.push(Math.max(0, this.now - tile.receivedUtc));
    }
    this.ranges = {
      depth: robustRange(depths, LEAST_DEPTH_RANGE),
      sigma: [0, Math.max(LEAST_SIGMA_RANGE, robustRange(sigmas, 0)[1])],
      age: [0, Math.max(LEAST_AGE_RANGE, robustRange(ages, 0)[1])],
    };
  }

  private colourOf(tile: Tile, n: number): Rgb {
    const share = (value: number, [low, high]: [number, number]): number => (value - low) / (high - low);
    switch (this.mode) {
      case 'depth': // shallow bright, deep dark
        return ramp(VIRIDIS, 1 - share(tile.depths[n]!, this.ranges.depth));
      case 'photo':
        if (tile.colourBits === 0) return NO_COLOUR;
        return [tile.colours[n * 3]!, tile.colours[n * 3 + 1]!, tile.colours[n * 3 + 2]!];
      case 'sigma':
        return ramp(MAGMA, share(tile.sigma, this.ranges.sigma));
      case 'age': // fresh bright, old dark
        return ramp(MAGMA, 1 - share(this.now - tile.receivedUtc, this.ranges.age));
    }
  }

  private recolour(): void {
    this.updateRanges();
    const linear = new THREE.Color();
    for (const { tile, mesh } of this.shown.values()) {
      const colours = mesh.geometry.getAttribute('color') as THREE.BufferAttribute;
      for (let n = 0; n < tile.side * tile.side; ++n) {
        const [r, g, b] = Number.isNaN(tile.depths[n]) ? NO_COLOUR : this.colourOf(tile, n);
        linear.setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
        colours.setXYZ(n, linear.r, linear.g, linear.b);
      }
      colours.needsUpdate = true;
    }
  }
}
