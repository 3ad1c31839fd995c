import * as THREE from 'three';
import { MAGMA, VIRIDIS, type Rgb } from '#kit/ramps';

// The seafloor's material. All that can be coloured by travels with the vertices, so that a change of mode, range or
// clock is a change of uniforms: no vertex is touched.

export const MODES = ['depth', 'photo', 'sigma', 'age', 'coverage'] as const;
export type ColourMode = (typeof MODES)[number];

export const COVERAGE_COLOURS = {
  fine: [74, 158, 178] as Rgb,
  coarse: [52, 92, 118] as Rgb,
  changed: [226, 110, 164] as Rgb,
  pending: [214, 158, 60] as Rgb,
};
const NO_COLOUR: Rgb = [116, 124, 130];

function rampTexture(stops: Rgb[]): THREE.DataTexture {
  const data = new Uint8Array(stops.flatMap(([r, g, b]) => [r, g, b, 255]));
  const texture = new THREE.DataTexture(data, stops.length, 1, THREE.RGBAFormat);
  texture.magFilter = texture.minFilter = THREE.LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

const vector = ([r, g, b]: Rgb): THREE.Vector3 => new THREE.Vector3(r / 255, g / 255, b / 255);

const VERTEX = /* glsl */ `
attribute vec4 aNormal; // north, east, up, spacing code
attribute vec4 aColour; // red, green, blue, flags
attribute vec2 aBounds; // sigma, error bound [mm]
attribute vec2 aTimes;  // received, changed [s]
uniform float exaggeration;
uniform int mode;
uniform float now;
uniform float recent;   // [s]
uniform float fineCode;
varying vec3 vNormal;
varying vec3 vRgb;
varying float vDepth;
varying float vValue;
varying float vKind;    // 0: no colour, 1: colour; in coverage 0 coarse, 1 fine
varying float vChanged;
void main() {
  vNormal = normalize(vec3(aNormal.y, aNormal.z / exaggeration, -aNormal.x));
  vRgb = aColour.rgb;
  vDepth = -position.y;
  float flags = floor(aColour.a * 255.0 + 0.5);
  float code = floor(aNormal.w * 127.0 + 0.5);
  vKind = mode == 4 ? (code <= fineCode ? 1.0 : 0.0) : mod(flags, 2.0);
  vValue = mode == 2 ? aBounds.x * 0.001 : now - aTimes.x;
  vChanged = (aTimes.y == aTimes.y && now - aTimes.y < recent) ? 1.0 : 0.0;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const FRAGMENT = /* glsl */ `
uniform int mode;
uniform vec2 range;
uniform sampler2D ramp;
uniform vec3 noColour, fine, coarse, changed, sun;
uniform vec2 light;        // ambient, diffuse
uniform float contour;     // interval [m], 0: none
uniform float originDepth; // [m]
varying vec3 vNormal;
varying vec3 vRgb;
varying float vDepth;
varying float vValue;
varying float vKind;
varying float vChanged;
vec3 rampAt(float t) {
  float n = float(textureSize(ramp, 0).x);
  return texture2D(ramp, vec2((clamp(t, 0.0, 1.0) * (n - 1.0) + 0.5) / n, 0.5)).rgb;
}
void main() {
  float depth = vDepth + originDepth;
  vec3 colour;
  if (mode == 0) colour = rampAt(1.0 - (depth - range.x) / (range.y - range.x));
  else if (mode == 1) colour = mix(noColour, vRgb, vKind);
  else if (mode == 2) colour = rampAt((vValue - range.x) / (range.y - range.x));
  else if (mode == 3) colour = rampAt(1.0 - (vValue - range.x) / (range.y - range.x));
  else colour = mix(mix(coarse, fine, vKind), changed, step(0.5, vChanged));
  float shade = light.x + light.y * max(dot(normalize(vNormal), sun), 0.0);
  colour *= shade;
  if (contour > 0.0) {
    float step_ = depth / contour;
    float width = fwidth(step_);
    float line = abs(fract(step_ - 0.5) - 0.5) / max(width, 1e-6);
    // Lines closer than four pixels are left out.
    float ink = (1.0 - smoothstep(0.6, 1.4, line)) * (1.0 - smoothstep(0.15, 0.3, width));
    colour = mix(colour, vec3(0.04, 0.07, 0.09), 0.55 * ink);
  }
  gl_FragColor = vec4(colour, 1.0);
}`;

const RELIEF = new THREE.Vector2(0.42, 0.72); // strong hill shading for ramps
const PHOTO = new THREE.Vector2(0.78, 0.28); // photographs bring their own light

export class SeafloorMaterial extends THREE.ShaderMaterial {
  private ramps = { depth: rampTexture(VIRIDIS), other: rampTexture(MAGMA) };

  constructor() {
    super({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      side: THREE.DoubleSide,
      uniforms: {
        exaggeration: { value: 1 },
        mode: { value: 0 },
        now: { value: 0 },
        recent: { value: 600 },
        fineCode: { value: 5 },
        range: { value: new THREE.Vector2(0, 1) },
        ramp: { value: null },
        noColour: { value: vector(NO_COLOUR) },
        fine: { value: vector(COVERAGE_COLOURS.fine) },
        coarse: { value: vector(COVERAGE_COLOURS.coarse) },
        changed: { value: vector(COVERAGE_COLOURS.changed) },
        sun: { value: new THREE.Vector3(-1, 1.1, -1).normalize() }, // from the north-west, as maps are shaded
        light: { value: RELIEF },
        contour: { value: 0 },
        originDepth: { value: 0 },
      },
    });
  }

  set(name: string, value: number): void {
    this.uniforms[name]!.value = value;
  }

  setMode(mode: ColourMode, range: [number, number]): void {
    this.uniforms.mode!.value = MODES.indexOf(mode);
    this.uniforms.ramp!.value = mode === 'depth' ? this.ramps.depth : this.ramps.other;
    (this.uniforms.range!.value as THREE.Vector2).set(...range);
    this.uniforms.light!.value = mode === 'photo' ? PHOTO : RELIEF;
  }
}
