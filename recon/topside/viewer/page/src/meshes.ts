import * as THREE from 'three';
import { PLYLoader } from 'three/examples/jsm/loaders/PLYLoader.js';
import type { HeightGrid } from '#kit/measure';
import { rampOf, ramp, robustRange } from '#kit/ramps';

// Other surfaces beside the dive's own: meshes and point clouds (PLY), and gridded multibeam as a surface.

const MOST_GRID = 700; // nodes along an edge of a gridded surface

const HILLSHADE = new THREE.Vector3(-0.6, 0.75, -0.55).normalize();

function shaded(vertexColours: boolean): THREE.Material {
  const material = new THREE.MeshBasicMaterial({ vertexColors: vertexColours, color: vertexColours ? 0xffffff : 0xb8c2c8, side: THREE.DoubleSide });
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace('#include <common>', '#include <common>\nvarying vec3 vPlace;').replace('#include <project_vertex>', '#include <project_vertex>\nvPlace = (modelMatrix * vec4(transformed, 1.0)).xyz;');
    shader.fragmentShader = shader.fragmentShader.replace('#include <common>', '#include <common>\nvarying vec3 vPlace;').replace('#include <color_fragment>', `#include <color_fragment>
      vec3 facet = normalize(cross(dFdx(vPlace), dFdy(vPlace)));
      if (facet.y < 0.0) facet = -facet;
      diffuseColor.rgb *= 0.35 + 0.65 * max(dot(facet, vec3(${HILLSHADE.toArray().map((v) => v.toFixed(3)).join(',')})), 0.0) + 0.15 * facet.y;`);
  };
  return material;
}

const head = (buffer: ArrayBuffer): string => new TextDecoder('latin1').decode(buffer.slice(0, 2000)).split('end_header')[0]!;

// Axes as the file's comment tells ("nav: north, east, down"), else `axes`.
export type Axes = 'north east down' | 'east north up';
export function readPly(buffer: ArrayBuffer, axes: Axes): { object: THREE.Object3D; triangles: number; axes: Axes } {
  const header = head(buffer);
  if (!header.startsWith('ply')) throw new Error('is no PLY file');
  const known: Axes = /north,? *east,? *(down|depth)/i.test(header) ? 'north east down' : /east,? *north,? *up/i.test(header) ? 'east north up' : axes;
  const geometry = new PLYLoader().parse(buffer);
  const position = geometry.getAttribute('position') as THREE.BufferAttribute | undefined;
  if (!position || position.count === 0) throw new Error('holds no vertices');
  for (let i = 0; i < position.count; ++i) {
    const [x, y, z] = [position.getX(i), position.getY(i), position.getZ(i)];
    if (known === 'north east down') position.setXYZ(i, y, -z, -x);
    else position.setXYZ(i, x, z, -y);
  }
  geometry.deleteAttribute('normal');
  const triangles = geometry.index ? geometry.index.count / 3 : 0;
  const colours = geometry.hasAttribute('color');
  const object = triangles > 0 ? new THREE.Mesh(geometry, shaded(colours))
    : new THREE.Points(geometry, new THREE.PointsMaterial({ size: 2, sizeAttenuation: false, vertexColors: colours, color: colours ? 0xffffff : 0x9fd8e6 }));
  geometry.computeBoundingSphere();
  return { object, triangles, axes: known };
}

// A grid of elevations (positive up) as a surface coloured by height; holes stay holes.
export function gridSurface(grid: HeightGrid): { object: THREE.Object3D; triangles: number } {
  const thin = Math.max(1, Math.ceil(Math.max(grid.width, grid.height) / MOST_GRID));
  const [w, h] = [Math.floor((grid.width - 1) / thin) + 1, Math.floor((grid.height - 1) / thin) + 1];
  const positions = new Float32Array(w * h * 3);
  const colours = new Float32Array(w * h * 3);
  const [low, high] = robustRange(grid.values);
  const stops = rampOf('viridis');
  const colour = new THREE.Color();
  const at = (r: number, c: number): number => grid.values[r * thin * grid.width + c * thin]!;
  for (let r = 0; r < h; ++r)
    for (let c = 0; c < w; ++c) {
      const z = at(r, c);
      const i = 3 * (r * w + c);
      positions.set([grid.east + c * thin * grid.step, Number.isFinite(z) ? z : 0, -(grid.north - r * thin * grid.step)], i);
      const [red, green, blue] = ramp(stops, (z - low) / (high - low));
      colour.setRGB(red / 255, green / 255, blue / 255, THREE.SRGBColorSpace).toArray(colours, i);
    }
  const index: number[] = [];
  for (let r = 0; r + 1 < h; ++r)
    for (let c = 0; c + 1 < w; ++c) {
      const [a, b, d, e] = [at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)].map(Number.isFinite) as [boolean, boolean, boolean, boolean];
      const [ia, ib, id, ie] = [r * w + c, r * w + c + 1, (r + 1) * w + c, (r + 1) * w + c + 1];
      if (a && b && d) index.push(ia, id, ib);
      if (b && d && e) index.push(ib, id, ie);
    }
  if (index.length === 0) throw new Error('holds no heights near the dive');
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
  geometry.setIndex(index);
  return { object: new THREE.Mesh(geometry, shaded(true)), triangles: index.length / 3 };
}
