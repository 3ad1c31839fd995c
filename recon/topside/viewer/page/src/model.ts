import { TilesRenderer, type Tile } from '3d-tiles-renderer';
import { GLTFExtensionsPlugin } from '3d-tiles-renderer/plugins';
import * as THREE from 'three';
import { DRACOLoader } from 'three/examples/jsm/loaders/DRACOLoader.js';
import { KTX2Loader } from 'three/examples/jsm/loaders/KTX2Loader.js';
import { Budget, defaultLimit } from './budget';
import type { Dive } from './dive';
import { fileName } from './source';
import { Textures, texturePlugin } from './textures';
import type { Look, TileMaterial } from './tile_material';
import type { View } from './view';

// The dive's tiles in the scene: which are loaded, at what resolution, and within how many bytes.

const SHARPNESS = 1.25; // screen pixels that a texel of the level shown may span
const ERROR_A_TEXEL = 8; // geometric error of a tile over its texel, as fathom-topside writes tilesets
const BASE_ERROR = SHARPNESS * ERROR_A_TEXEL; // allowed screen error [px]
const BUDGET_INTERVAL = 6; // frames
const PARSERS = 2; // tiles parsed at the same time: the main thread has to take each over
const DOWNLOADS = 10;
// Room kept free under the limit for tiles in transit, whose size is not known before they are here.
const RESERVE = 0.08;
// While more is held than may be, room for the coarser tiles that will take the finer ones' place.
const COARSER_TILES = 32 * 2 ** 20;

// What of the renderer is not in its types.
interface Internals {
  stats: { queued: number; downloading: number; parsing: number; failed: number; inCache: number };
  lruCache: { cachedBytes: number; usedSet: Set<Tile> };
  recalculateBytesUsed(tile: Tile): void;
}

class Tiles extends TilesRenderer {
  textures: Textures | null = null;
  calculateBytesUsed(tile: Tile): number {
    const scene = (tile as unknown as { engineData: { scene: THREE.Object3D | null } }).engineData.scene;
    if (!scene) return 0;
    let bytes = this.textures?.bytes(tile) ?? 0;
    scene.traverse((o) => {
      const { geometry } = o as THREE.Mesh;
      if (!geometry) return;
      // Twice: the arrays stay here for picking, and the graphics card has its own.
      for (const attribute of Object.values(geometry.attributes)) bytes += 2 * (attribute as THREE.BufferAttribute).array.byteLength;
      bytes += 2 * (geometry.index?.array.byteLength ?? 0);
    });
    return bytes;
  }
}

// glTF content of tiles is in the tileset's axes (east, north, up); the scene has y up.
const FROM_ENU = new THREE.Matrix4().set(1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1);

export interface ModelStats {
  bytes: number;
  limit: number;
  used: number;
  tiles: number;
  visible: number;
  loading: number;
  failed: number;
  factor: number;
}

export class Model {
  readonly budget = new Budget();
  readonly tiles: Tiles;
  private textures: Textures;
  private dirty = true;
  private refused = false;
  private over = false; // more is held than may be
  private frames = 0;
  private draco = new DRACOLoader();
  private ktx2 = new KTX2Loader();
  private bound: number;
  private said = new Set<string>();
  onFailed: () => void = () => undefined; // there is no tileset
  onRoot: (box: THREE.Box3) => void = () => undefined;
  firstPicture: number | null = null; // when the first tile was drawn [ms since the page began]

  constructor(private view: View, private look: Look, dive: Dive, private complain: (what: string) => void, limit: number | null) {
    this.bound = limit ?? defaultLimit((navigator as { deviceMemory?: number }).deviceMemory);
    const { source, scene } = dive;
    const tiles = (this.tiles = new Tiles(dive.address(scene.tileset)));
    this.draco.setDecoderPath(new URL('draco/', document.baseURI).href).setWorkerLimit(2);
    this.draco.preload();
    this.ktx2.setTranscoderPath(new URL('basis/', document.baseURI).href).detectSupport(view.renderer);
    this.textures = new Textures(this.ktx2, async (address) => (await source.blob(address)).arrayBuffer());
    tiles.textures = this.textures;
    this.textures.onTrouble = (what) => this.tell(what);
    this.textures.onBytes = (tile) => this.weigh(tile);
    tiles.registerPlugin(new GLTFExtensionsPlugin({ dracoLoader: this.draco, ktxLoader: this.ktx2, plugins: [texturePlugin], metadata: false, rtc: false }));
    tiles.registerPlugin({
      name: 'FATHOM_SOURCE',
      fetchData: (url: string, options: RequestInit) => source.fetch(url, options),
      processTileModel: (object: THREE.Object3D, tile: Tile) => this.dress(object, tile),
    });
    tiles.setCamera(view.camera);
    tiles.lruCache.minSize = 0;
    tiles.lruCache.maxSize = 20_000;
    tiles.lruCache.unloadPercent = 0.5;
    tiles.parseQueue.maxJobs = PARSERS;
    tiles.downloadQueue.maxJobs = DOWNLOADS;
    this.setLimit(this.bound);
    tiles.errorTarget = BASE_ERROR;
    tiles.addEventListener('needs-update', () => (this.dirty = true));
    tiles.addEventListener('load-root-tileset', () => this.setFrame());
    tiles.addEventListener('load-model', ({ tile }) => this.weigh(tile as Tile));
    tiles.addEventListener('dispose-model', ({ tile }) => this.textures.remove(tile as Tile));
    tiles.addEventListener('load-error', ({ tile, error, url }) => this.failed(tile as Tile | null, error as Error, String(url)));
    view.pickable.add(tiles.group);
  }

  private get inner(): Internals {
    return this.tiles as unknown as Internals;
  }
  get limit(): number {
    return this.bound;
  }
  setLimit(bytes: number): void {
    this.bound = bytes;
    this.tiles.lruCache.maxBytesSize = bytes * (1 - RESERVE);
    this.tiles.lruCache.minBytesSize = bytes * (1 - 2.5 * RESERVE);
    this.dirty = true;
  }

  // The tileset's root stands on the earth; here the dive's own frame is the scene's.
  private setFrame(): void {
    const root = this.tiles.root as unknown as { engineData: { transform: THREE.Matrix4 } };
    const matrix = root.engineData.transform.clone().invert().premultiply(FROM_ENU);
    matrix.decompose(this.tiles.group.position, this.tiles.group.quaternion, this.tiles.group.scale);
    this.tiles.group.updateMatrixWorld(true);
    const box = new THREE.Box3();
    const turn = new THREE.Matrix4();
    if (this.tiles.getOrientedBoundingBox(box, turn)) this.onRoot(box.applyMatrix4(turn.premultiply(this.tiles.group.matrixWorld)));
    this.dirty = true;
  }

  private levelOf(tile: Tile): number {
    const named = /(?:^|\/)L?(\d+)\/[^/]*$/.exec(tile.content?.uri ?? '');
    return named ? Number(named[1]) : 0;
  }

  private async dress(object: THREE.Object3D, tile: Tile): Promise<void> {
    const uri = tile.content?.uri ?? '';
    object.traverse((o) => {
      const mesh = o as THREE.Mesh<THREE.BufferGeometry, THREE.MeshStandardMaterial>;
      if (!mesh.isMesh) return;
      const { map } = mesh.material;
      const gpu = mesh.material.userData.gpu_texture as string | undefined; // block-compressed, beside the tile
      if (map) map.colorSpace = THREE.NoColorSpace; // shown as stored, no light is computed on it
      const material = this.look.material(map, this.levelOf(tile), mesh.geometry.hasAttribute('color'));
      mesh.material.dispose();
      (mesh as THREE.Mesh).material = material;
      mesh.geometry.computeBoundingBox();
      const size = mesh.geometry.boundingBox!.getSize(new THREE.Vector3()).multiply(mesh.scale);
      const { basePath } = (tile as unknown as { internal: { basePath: string } }).internal;
      const compressed = gpu ? new URL(gpu, new URL(uri, `${basePath}/`)).href : null;
      this.textures.add(tile, material, Math.max(size.x, size.z), mesh.userData.texel as number | undefined, compressed);
    });
  }

  private weigh(tile: Tile): void {
    const { lruCache } = this.tiles;
    this.inner.recalculateBytesUsed(tile);
    // Over the limit a coarser tile is let in: the finer ones in use can be evicted for it.
    const standsIn = this.over && (tile.children?.length ?? 0) > 0;
    if (this.bytes > this.bound && !standsIn) {
      this.refused = true;
      lruCache.remove(tile);
    }
    this.dirty = true;
  }

  private tell(what: string): void {
    if (this.said.has(what)) return;
    this.said.add(what);
    this.complain(what);
  }

  // A tile that cannot be read is shown by its parent, cut to where the tile would be.
  private failed(tile: Tile | null, error: Error, url: string): void {
    const why = error instanceof SyntaxError || error instanceof RangeError ? 'is broken' : error.message.replace(/^TilesRenderer: ?/, '');
    if (tile === null) {
      this.tell(`${fileName(url)}: ${why}`);
      this.onFailed();
      return;
    }
    this.tell(`tile ${tile.content?.uri ?? ''}: ${/code 404/.test(why) ? 'is missing' : why}; shown coarser there`);
    type Engine = { scene: THREE.Object3D | null; boundingVolume: { getOBB(box: THREE.Box3, matrix: THREE.Matrix4): void }; materials: unknown[]; geometry: unknown[]; textures: unknown[] };
    const own = (tile as unknown as { engineData: Engine }).engineData;
    const parent = (tile.parent as unknown as { engineData: Engine } | null)?.engineData.scene;
    if (!parent) return;
    const box = new THREE.Box3();
    const turn = new THREE.Matrix4();
    own.boundingVolume.getOBB(box, turn);
    box.applyMatrix4(turn.premultiply(this.tiles.group.matrixWorld));
    const standIn = parent.clone(true);
    const materials: TileMaterial[] = [];
    standIn.traverse((o) => {
      const mesh = o as THREE.Mesh;
      if (!mesh.isMesh) return;
      const material = (mesh.material as TileMaterial).cutTo(new THREE.Vector4(-box.max.z, box.min.x, -box.min.z, box.max.x));
      mesh.material = material;
      materials.push(material);
    });
    Object.assign(own, { scene: standIn, materials, geometry: [], textures: [] });
    (tile as unknown as { internal: { loadingState: number } }).internal.loadingState = LOADED;
    this.dirty = true;
  }

  // Before a frame: which tiles, which textures. Gives whether there is something new to draw.
  update(moved: boolean): boolean {
    const { tiles, view } = this;
    const every = ++this.frames % BUDGET_INTERVAL === 0;
    const had = this.dirty;
    if (moved) this.budget.moved();
    if (moved || had) {
      this.dirty = false;
      tiles.setResolutionFromRenderer(view.camera, view.renderer);
      tiles.update();
      if (this.firstPicture === null && tiles.visibleTiles.size > 0) this.firstPicture = performance.now();
    }
    const pixelAngle = (2 * Math.tan(THREE.MathUtils.degToRad(view.camera.fov / 2))) / Math.max(view.canvas.clientHeight, 1);
    if (every) {
      const { stats } = this.inner;
      let used = 0;
      for (const tile of this.inner.lruCache.usedSet) used += tiles.lruCache.getMemoryUsage(tile);
      const full = tiles.lruCache.isFull() && stats.queued + stats.downloading === 0 && this.wanting();
      // A limit that was lowered is met at once by what is not seen, and by coarser tiles as fast as they come.
      const over = this.bytes > this.bound;
      if (over) tiles.lruCache.unloadUnusedContent();
      if (over || this.over) {
        tiles.lruCache.maxBytesSize = over ? this.bytes + COARSER_TILES : this.bound * (1 - RESERVE);
        this.dirty = true;
      }
      this.over = over;
      if (this.budget.update({ used, limit: this.bound, calls: view.calls }, this.refused || full || over)) {
        tiles.errorTarget = BASE_ERROR * this.budget.factor;
        this.dirty = true;
      }
      if (this.refused || used > 0.75 * this.bound || tiles.lruCache.isFull()) this.textures.soften(pixelAngle, this.budget.factor);
      this.refused = false;
    }
    this.textures.update(pixelAngle, this.budget.factor);
    return had || this.dirty;
  }

  // Whether tiles that the view asks for are not here.
  private wanting(): boolean {
    for (const tile of this.tiles.visibleTiles) {
      const t = tile as Tile & { traversal: { error: number }; children?: Tile[] };
      if (t.traversal.error > this.tiles.errorTarget && (t.children?.length ?? 0) > 0) return true;
    }
    return false;
  }

  get bytes(): number {
    return this.inner.lruCache.cachedBytes;
  }
  get stats(): ModelStats {
    const { lruCache, visibleTiles } = this.tiles;
    const { stats } = this.inner;
    let used = 0;
    for (const tile of visibleTiles) used += lruCache.getMemoryUsage(tile);
    return {
      bytes: this.bytes, limit: this.bound, used, tiles: stats.inCache, visible: visibleTiles.size,
      loading: stats.queued + stats.downloading + stats.parsing + this.textures.busy, failed: stats.failed, factor: this.budget.factor,
    };
  }

  dispose(): void {
    this.tiles.dispose();
    this.draco.dispose();
    this.ktx2.dispose();
  }
}

const LOADED = 4; // of 3d-tiles-renderer's loading states
