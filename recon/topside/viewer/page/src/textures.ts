import type { Tile } from '3d-tiles-renderer';
import * as THREE from 'three';
import type { GLTFLoaderPlugin, GLTFParser } from 'three/examples/jsm/loaders/GLTFLoader.js';
import type { KTX2Loader } from 'three/examples/jsm/loaders/KTX2Loader.js';
import { halvings, textureBytes } from './budget';
import { imageSize } from './image_size';
import type { TileMaterial } from './tile_material';

// A tile's texture is held at the size at which it is seen. The picture's bytes stay as they came (a tenth of a pixel each);
// the browser decodes them off the main thread, at once at the size wanted, and again larger when the camera comes near.
// Where the tile has a block-compressed texture beside it (KTX2), that is taken as it is: an eighth of the size anyway.

export interface TextureSource {
  blob: Blob;
  width: number;
  height: number;
}

const FIRST_EDGE = 256; // of a texture before its tile has been looked at [px]
const DECODERS = 2; // at the same time

async function decode(source: TextureSource, halved: number): Promise<THREE.Texture> {
  const [width, height] = [Math.max(1, source.width >> halved), Math.max(1, source.height >> halved)];
  const bitmap = await createImageBitmap(source.blob, {
    colorSpaceConversion: 'none', premultiplyAlpha: 'none', imageOrientation: 'from-image',
    ...(halved > 0 ? { resizeWidth: width, resizeHeight: height, resizeQuality: 'medium' as const } : {}),
  });
  const texture = new THREE.Texture(bitmap);
  texture.flipY = false;
  texture.generateMipmaps = true;
  texture.minFilter = THREE.LinearMipmapLinearFilter;
  texture.anisotropy = 4;
  texture.userData = { bytes: textureBytes(width, height) };
  texture.onUpdate = () => bitmap.close(); // the graphics card has it now
  texture.needsUpdate = true;
  return texture;
}

interface Waiting {
  source: TextureSource;
  halved: number;
}
const SOURCE = Symbol('texture source');
type WithSource = THREE.Texture & { [SOURCE]?: Waiting };

interface TextureDefinition {
  source?: number;
  extensions?: Record<string, { source?: number } | undefined>;
}

// Takes the textures of a glTF file before three's own loaders do. It bears the name of the WebP extension, in whose place it
// stands, and takes every picture that a browser decodes.
class TexturePlugin implements GLTFLoaderPlugin {
  readonly name = 'EXT_texture_webp';
  constructor(private parser: GLTFParser) {}
  loadTexture(index: number): Promise<THREE.Texture> | null {
    const definition = (this.parser.json.textures as TextureDefinition[])[index]!;
    const image = definition.extensions?.EXT_texture_webp?.source ?? definition.source;
    const view = image === undefined ? undefined : (this.parser.json.images as { bufferView?: number }[])[image]?.bufferView;
    return view === undefined ? null : this.load(view);
  }
  private async load(view: number): Promise<THREE.Texture> {
    const bytes = (await this.parser.getDependency('bufferView', view)) as ArrayBuffer;
    const size = imageSize(new Uint8Array(bytes));
    if (!size) throw new Error('its texture is no JPEG, PNG or WebP picture');
    const source = { blob: new Blob([bytes], { type: size.type }), width: size.width, height: size.height };
    const halved = Math.max(0, Math.ceil(Math.log2(Math.max(size.width, size.height) / FIRST_EDGE)));
    const texture: WithSource = await decode(source, halved);
    texture[SOURCE] = { source, halved };
    return texture;
  }
}
export const texturePlugin = (parser: GLTFParser): GLTFLoaderPlugin => new TexturePlugin(parser);

interface Entry {
  tile: Tile;
  material: TileMaterial;
  source: TextureSource | null; // null: the tile holds no picture, only the compressed texture beside it
  halved: number;
  texel: number; // at full size, on the ground [m]
  compressed: string | null; // address of the block-compressed texture until it has been asked for
  whole: boolean; // nothing finer to get, nor anything to halve
  busy: boolean;
}

interface Seen {
  used: boolean;
  visible: boolean;
  inFrustum: boolean;
  distanceFromCamera: number;
}
const NEAREST = 0.05; // distances below count as this [m]

export class Textures {
  private entries = new Map<Tile, Entry[]>();
  private decoding = 0;
  // Called when a tile's bytes changed; it may have to go.
  onBytes: (tile: Tile) => void = () => undefined;
  onTrouble: (what: string) => void = () => undefined;

  constructor(private ktx2: KTX2Loader, private read: (address: string) => Promise<ArrayBuffer>) {}

  // `edge`: of the tile on the ground [m]; `texel`: of its texture, where the file tells [m]; `compressed`: address.
  add(tile: Tile, material: TileMaterial, edge: number, texel: number | undefined, compressed: string | null): void {
    const waiting = (material.texture as WithSource | null)?.[SOURCE];
    if (!waiting && !compressed) return;
    const source = waiting?.source ?? null;
    const list = this.entries.get(tile) ?? [];
    list.push({
      tile, material, source, halved: waiting?.halved ?? 16, texel: texel ?? (source ? edge / Math.max(source.width, source.height) : 0),
      compressed, whole: waiting?.halved === 0 && !compressed, busy: false,
    });
    this.entries.set(tile, list);
  }

  remove(tile: Tile): void {
    for (const entry of this.entries.get(tile) ?? []) entry.material.texture?.dispose();
    this.entries.delete(tile);
  }

  bytes(tile: Tile): number {
    return (this.entries.get(tile) ?? []).reduce((sum, e) => sum + ((e.material.texture?.userData.bytes as number) ?? 0) + (e.source?.blob.size ?? 0), 0);
  }

  get busy(): number {
    return this.decoding;
  }

  // How often the texture may be halved as the tile is seen now.
  private wanted(entry: Entry, pixelAngle: number, factor: number): number {
    const { visible, inFrustum, distanceFromCamera } = entry.tile.traversal as Seen;
    if (!entry.source) return 0;
    const { width, height } = entry.source;
    const pixel = visible && inFrustum ? Math.max(distanceFromCamera, NEAREST) * pixelAngle * factor : Infinity;
    return Math.min(halvings(entry.texel, pixel, width, height), Math.max(0, Math.ceil(Math.log2(Math.max(width, height) / FIRST_EDGE))));
  }

  // Fetches what is most too coarse. `pixelAngle`: what a pixel spans at one metre [m]; `factor`: of the budget.
  update(pixelAngle: number, factor: number): void {
    if (this.decoding >= DECODERS) return;
    let best: [entry: Entry, wanted: number] | null = null;
    let most = 0;
    for (const entries of this.entries.values())
      for (const entry of entries) {
        const { used, visible } = entry.tile.traversal as Seen;
        if (entry.busy || entry.whole || !used || !visible) continue;
        const wanted = this.wanted(entry, pixelAngle, factor);
        if (entry.halved - wanted <= most) continue;
        most = entry.halved - wanted;
        best = [entry, wanted];
      }
    if (best) void this.change(...best);
  }

  // Halves what is sharper than the present view needs; called when room is short.
  soften(pixelAngle: number, factor: number): void {
    for (const entries of this.entries.values())
      for (const entry of entries) {
        if (this.decoding >= DECODERS) return;
        if (entry.busy || !entry.source || entry.material.texture instanceof THREE.CompressedTexture) continue;
        const wanted = this.wanted(entry, pixelAngle, factor);
        if (wanted > entry.halved) void this.change(entry, wanted);
      }
  }

  private async change(entry: Entry, halved: number): Promise<void> {
    entry.busy = true;
    ++this.decoding;
    try {
      const texture = await this.fetch(entry, halved);
      if (!this.entries.has(entry.tile)) return texture?.dispose();
      if (!texture) return;
      entry.material.texture?.dispose();
      entry.material.setTexture(texture);
      this.onBytes(entry.tile);
    } catch (error) {
      entry.whole = true;
      this.onTrouble(`texture of tile ${entry.tile.content?.uri ?? ''}: ${(error as Error).message}`);
    } finally {
      entry.busy = false;
      --this.decoding;
    }
  }

  private async fetch(entry: Entry, halved: number): Promise<THREE.Texture | null> {
    if (entry.compressed) {
      const address = entry.compressed;
      entry.compressed = null;
      try {
        const texture = await this.parseCompressed(await this.read(address));
        entry.whole = true;
        entry.halved = 0;
        return texture;
      } catch (error) {
        // Absent, or not for this graphics card: then the picture in the tile does.
        if (!entry.source) throw error;
      }
    }
    if (!entry.source) return null;
    const texture = await decode(entry.source, halved);
    entry.halved = halved;
    entry.whole = halved === 0;
    return texture;
  }

  private parseCompressed(buffer: ArrayBuffer): Promise<THREE.CompressedTexture> {
    return new Promise((done, failed) =>
      this.ktx2.parse(buffer, (texture) => {
        texture.colorSpace = THREE.NoColorSpace;
        texture.anisotropy = 4;
        texture.minFilter = texture.mipmaps!.length > 1 ? THREE.LinearMipmapLinearFilter : THREE.LinearFilter;
        texture.userData = { bytes: texture.mipmaps!.reduce((sum, m) => sum + m.data!.byteLength, 0) };
        done(texture);
      }, failed));
  }
}
