import * as THREE from 'three';
import type { CameraModel, DiveImage } from './cameras';
import { turnToScene, toScene } from '#kit/place';
import { ramp, type Rgb } from '#kit/ramps';
import { NO_DATA, type Patch, type Placement } from './raster';

// How the seafloor looks: its texture or its plain shape, with rasters draped over it by north and east, labels, contours,
// and one original image projected from where it was taken. All tiles share these settings; a tile has its own texture.

export type Surface = 'texture' | 'plain' | 'wire';

const KIND = { none: 0, scalar: 1, colour: 2 } as const;
const SLOTS = ['layer', 'detail', 'labels'] as const;
export type Slot = (typeof SLOTS)[number];
const RAMP_SIZE = 256;

const empty = new THREE.DataTexture(new Uint8Array(4), 1, 1);
empty.needsUpdate = true;

const matrixOf = (m: Placement): THREE.Matrix3 => new THREE.Matrix3(m[0], m[1], m[2], m[3], m[4], m[5], 0, 0, 1);

const VERTEX = /* glsl */ `
varying vec3 vPlace;
varying vec3 vNormal;
varying vec2 vTexel;
#ifdef VERTEX_COLOURS
attribute vec4 color;
varying vec3 vColour;
#endif
void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  vPlace = world.xyz;
  vec3 turned = mat3(modelMatrix) * normal; // tiles are scaled: their vertices stand on a lattice
  vNormal = dot(normal, normal) > 0.1 ? normalize(turned) : vec3(0.0);
  vTexel = uv;
#ifdef VERTEX_COLOURS
  vColour = color.rgb;
#endif
  gl_Position = projectionMatrix * (viewMatrix * world);
}`;

const FRAGMENT = /* glsl */ `
precision highp float;
uniform sampler2D map;
uniform int mapped;
uniform vec3 levelColour;
uniform vec4 clip; // north and east of the low corner, then of the high one
uniform int surface; // 0 texture, 1 plain, 2 wire
uniform float shade;
uniform float contour; // interval [m], 0 none
uniform float rampRange[2];
uniform sampler2D ramp;
${SLOTS.map((s) => `uniform sampler2D ${s}Texture; uniform mat3 ${s}Matrix; uniform int ${s}Kind; uniform float ${s}Opacity;`).join('\n')}
uniform sampler2D photo;
uniform float photoOpacity;
uniform mat3 photoTurn; // scene to camera
uniform vec3 photoPlace;
uniform vec4 photoLens; // fx, fy, cx, cy over width and height
uniform float photoDistortion[5]; // k1 k2 p1 p2 k3
varying vec3 vPlace;
varying vec3 vNormal;
varying vec2 vTexel;
#ifdef VERTEX_COLOURS
varying vec3 vColour;
#endif

// Bilinear over the nodes that hold a value; a is how much of the pixel's weight they have.
vec2 scalarAt(sampler2D raster, vec2 uv) {
  ivec2 size = textureSize(raster, 0);
  vec2 at = uv * vec2(size) - 0.5;
  ivec2 low = ivec2(floor(at));
  vec2 f = at - vec2(low);
  vec2 sum = vec2(0.0);
  for (int k = 0; k < 4; ++k) {
    ivec2 step = ivec2(k & 1, k >> 1);
    float v = texelFetch(raster, clamp(low + step, ivec2(0), size - 1), 0).r;
    vec2 w2 = mix(1.0 - f, f, vec2(step));
    float w = v > ${(NO_DATA / 2).toExponential()} ? w2.x * w2.y : 0.0;
    sum += w > 0.0 ? vec2(w * v, w) : vec2(0.0);
  }
  return vec2(sum.x / max(sum.y, 1e-6), sum.y);
}

vec4 drape(sampler2D raster, mat3 placement, int kind) {
  vec2 uv = (placement * vec3(-vPlace.z, vPlace.x, 1.0)).xy;
  if (kind == 0 || any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) return vec4(0.0);
  if (kind == 2) return texture(raster, uv);
  vec2 value = scalarAt(raster, uv);
  float t = clamp((value.x - rampRange[0]) / (rampRange[1] - rampRange[0]), 0.0, 1.0);
  return vec4(texture(ramp, vec2((t * ${RAMP_SIZE - 1}.0 + 0.5) / ${RAMP_SIZE}.0, 0.5)).rgb, value.y > 0.5 ? 1.0 : 0.0);
}

vec4 photoAt() {
  vec3 c = photoTurn * (vPlace - photoPlace);
  if (c.z < 0.05) return vec4(0.0);
  vec2 p = c.xy / c.z;
  float r2 = dot(p, p);
  if (r2 > 2.25) return vec4(0.0);
  float radial = 1.0 + r2 * (photoDistortion[0] + r2 * (photoDistortion[1] + r2 * photoDistortion[4]));
  vec2 d = p * radial + vec2(
    2.0 * photoDistortion[2] * p.x * p.y + photoDistortion[3] * (r2 + 2.0 * p.x * p.x),
    photoDistortion[2] * (r2 + 2.0 * p.y * p.y) + 2.0 * photoDistortion[3] * p.x * p.y);
  vec2 uv = d * photoLens.xy + photoLens.zw;
  if (any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) return vec4(0.0);
  return vec4(texture(photo, uv).rgb, 1.0);
}

void main() {
  float north = -vPlace.z;
  if (north < clip.x || vPlace.x < clip.y || north > clip.z || vPlace.x > clip.w) discard;
  vec3 facet = cross(dFdx(vPlace), dFdy(vPlace));
  vec3 n = dot(vNormal, vNormal) > 0.1 ? normalize(vNormal) : normalize(facet);
  if (n.y < 0.0 && dot(vNormal, vNormal) <= 0.1) n = -n;
  // Light from the north-west, halfway up, as on charts; and some from above.
  float light = 0.35 + 0.5 * max(dot(n, normalize(vec3(-0.6, 0.75, -0.55))), 0.0) + 0.25 * max(n.y, 0.0);
  vec3 colour = vec3(0.72, 0.76, 0.78) * light;
  if (surface == 2) colour = levelColour;
  else if (surface == 0) {
#ifdef VERTEX_COLOURS
    vec3 own = mapped == 1 ? texture(map, vTexel).rgb : vColour * light;
#else
    vec3 own = mapped == 1 ? texture(map, vTexel).rgb : colour;
#endif
    colour = own * mix(1.0, min(light * 1.15, 1.25), shade);
  }
  vec4 over = drape(layerTexture, layerMatrix, layerKind);
  vec4 fine = drape(detailTexture, detailMatrix, detailKind);
  if (fine.a > 0.0) over = fine;
  float lit = layerKind == 1 ? mix(1.0, light, 0.55) : 1.0;
  colour = mix(colour, over.rgb * lit, over.a * layerOpacity);
  vec4 label = drape(labelsTexture, labelsMatrix, labelsKind);
  colour = mix(colour, label.rgb, label.a * labelsOpacity);
  if (photoOpacity > 0.0) {
    vec4 seen = photoAt();
    colour = mix(colour, seen.rgb, seen.a * photoOpacity);
  }
  if (contour > 0.0) {
    float at = vPlace.y / contour;
    float width = fwidth(at);
    float line = 1.0 - smoothstep(0.0, 1.4, abs(fract(at + 0.5) - 0.5) / max(width, 1e-6));
    colour = mix(colour, vec3(0.02, 0.05, 0.07), 0.75 * line * (1.0 - smoothstep(0.25, 0.6, width)));
  }
  gl_FragColor = vec4(colour, 1.0);
}`;

const EVERYWHERE = new THREE.Vector4(-1e9, -1e9, 1e9, 1e9);
const LEVEL_COLOURS = [0x6fb7c9, 0x74c08f, 0xf0b95e, 0xf0705c, 0xc58be0, 0xdddddd];

const slotUniforms = (slot: Slot): Record<string, THREE.IUniform> => ({
  [`${slot}Texture`]: { value: empty }, [`${slot}Matrix`]: { value: new THREE.Matrix3() }, [`${slot}Kind`]: { value: KIND.none }, [`${slot}Opacity`]: { value: 0.85 },
});

export class Look {
  readonly uniforms: Record<string, THREE.IUniform> = {
    surface: { value: 0 }, shade: { value: 0 }, contour: { value: 0 }, ramp: { value: empty }, rampRange: { value: [0, 1] },
    ...Object.assign({}, ...SLOTS.map(slotUniforms)),
    photo: { value: empty }, photoOpacity: { value: 0 }, photoTurn: { value: new THREE.Matrix3() }, photoPlace: { value: new THREE.Vector3() },
    photoLens: { value: new THREE.Vector4() }, photoDistortion: { value: [0, 0, 0, 0, 0] },
  };
  private made = new Set<TileMaterial>();
  surface: Surface = 'texture';

  material(map: THREE.Texture | null, level: number, colours: boolean): TileMaterial {
    const material = new TileMaterial(this.uniforms, map, level, colours);
    material.wireframe = this.surface === 'wire';
    this.made.add(material);
    material.addEventListener('dispose', () => this.made.delete(material));
    return material;
  }

  setSurface(surface: Surface): void {
    this.surface = surface;
    this.uniforms.surface!.value = ['texture', 'plain', 'wire'].indexOf(surface);
    for (const material of this.made) material.wireframe = surface === 'wire';
  }
  set(name: 'shade' | 'contour', value: number): void {
    this.uniforms[name]!.value = value;
  }

  setRamp(stops: Rgb[], low: number, high: number): void {
    const data = new Uint8Array(RAMP_SIZE * 4);
    for (let i = 0; i < RAMP_SIZE; ++i) data.set([...ramp(stops, i / (RAMP_SIZE - 1)), 255], 4 * i);
    (this.uniforms.ramp!.value as THREE.Texture).dispose();
    const texture = new THREE.DataTexture(data, RAMP_SIZE, 1);
    texture.minFilter = texture.magFilter = THREE.LinearFilter;
    texture.needsUpdate = true;
    this.uniforms.ramp!.value = texture;
    this.uniforms.rampRange!.value = [low, high > low ? high : low + 1e-6];
  }

  setSlot(slot: Slot, patch: Patch | null, opacity: number): void {
    this.clearTexture(`${slot}Texture`);
    this.uniforms[`${slot}Kind`]!.value = patch === null ? KIND.none : patch.scalar ? KIND.scalar : KIND.colour;
    this.uniforms[`${slot}Opacity`]!.value = opacity;
    if (!patch) return;
    const texture = patch.scalar
      ? new THREE.DataTexture(patch.values, patch.width, patch.height, THREE.RedFormat, THREE.FloatType)
      : new THREE.DataTexture(patch.values, patch.width, patch.height);
    texture.minFilter = texture.magFilter = patch.scalar ? THREE.NearestFilter : THREE.LinearFilter;
    if (!patch.scalar) {
      texture.generateMipmaps = true;
      texture.minFilter = THREE.LinearMipmapLinearFilter;
    }
    texture.needsUpdate = true;
    this.uniforms[`${slot}Texture`]!.value = texture;
    this.uniforms[`${slot}Matrix`]!.value = matrixOf(patch.placement);
  }
  setOpacity(slot: Slot, opacity: number): void {
    this.uniforms[`${slot}Opacity`]!.value = opacity;
  }

  // Drapes an original image over what it saw; null takes it away.
  setPhoto(bitmap: ImageBitmap | null, camera: CameraModel | null, image: DiveImage | null): void {
    this.clearTexture('photo');
    this.uniforms.photoOpacity!.value = bitmap ? 1 : 0;
    if (!bitmap || !camera || !image) return;
    const texture = new THREE.Texture(bitmap);
    texture.flipY = false;
    texture.generateMipmaps = true;
    texture.anisotropy = 8;
    texture.needsUpdate = true;
    this.uniforms.photo!.value = texture;
    const toCamera = new THREE.Matrix4().makeRotationFromQuaternion(turnToScene(image.q).invert());
    // turnToScene speaks of scene axes on both sides: the camera's x, y, z are nav's north, east, down of its own frame.
    const axes = new THREE.Matrix3().set(0, 0, -1, 1, 0, 0, 0, -1, 0);
    this.uniforms.photoTurn!.value = axes.multiply(new THREE.Matrix3().setFromMatrix4(toCamera));
    this.uniforms.photoPlace!.value = toScene(image);
    const { width, height, fx, fy, cx, cy } = camera;
    this.uniforms.photoLens!.value = new THREE.Vector4(fx / width, fy / height, (cx + 0.5) / width, (cy + 0.5) / height);
    this.uniforms.photoDistortion!.value = [camera.k1, camera.k2, camera.p1, camera.p2, camera.k3];
  }

  private clearTexture(name: string): void {
    const old = this.uniforms[name]!.value as THREE.Texture;
    if (old !== empty) old.dispose();
    this.uniforms[name]!.value = empty;
  }

  get bytes(): number {
    return [...SLOTS.map((s) => `${s}Texture`), 'photo'].reduce((sum, name) => {
      const image = (this.uniforms[name]!.value as THREE.Texture).image as { width: number; height: number };
      return sum + image.width * image.height * 4;
    }, 0);
  }
}

export class TileMaterial extends THREE.ShaderMaterial {
  constructor(shared: Record<string, THREE.IUniform>, map: THREE.Texture | null, level: number, colours: boolean) {
    super({
      vertexShader: VERTEX, fragmentShader: FRAGMENT, side: THREE.DoubleSide, defines: colours ? { VERTEX_COLOURS: '' } : {},
      uniforms: {
        ...shared, map: { value: map ?? empty }, mapped: { value: map ? 1 : 0 }, clip: { value: EVERYWHERE },
        levelColour: { value: new THREE.Color(LEVEL_COLOURS[level % LEVEL_COLOURS.length]!).convertLinearToSRGB() },
      },
    });
  }
  get texture(): THREE.Texture | null {
    return this.uniforms?.mapped?.value === 1 ? (this.uniforms.map!.value as THREE.Texture) : null;
  }
  setTexture(map: THREE.Texture): void {
    this.uniforms.map!.value = map;
    this.uniforms.mapped!.value = 1;
  }
  // The same surface, its texture shared, cut to north and east of a low and a high corner.
  cutTo(clip: THREE.Vector4): TileMaterial {
    const { map, mapped, levelColour, clip: _, ...shared } = this.uniforms;
    const cut = new TileMaterial(shared, null, 0, 'VERTEX_COLOURS' in this.defines);
    Object.assign(cut.uniforms, { map, mapped, levelColour, clip: { value: clip } });
    cut.wireframe = this.wireframe;
    return cut;
  }
}
