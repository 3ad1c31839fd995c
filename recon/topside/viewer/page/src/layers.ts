import { fromBlob } from 'geotiff';
import type { Dive, LayerFile } from './dive';
import { number } from '#kit/format';
import { boundsOf, crsOfWorldFile, gridOfWorldFile, placementOf, Raster, type Patch } from './raster';
import type { Bounds } from '#kit/place';
import { make, rampBar } from '#kit/overlay';
import { rampOf, robustRange } from '#kit/ramps';
import { NO_DATA } from './raster';
import type { Look } from './tile_material';

// One raster at a time over the seafloor: the whole of it coarsely, and what the camera sees finely once it rests.

const WHOLE_EDGE = 1024; // of the coarse picture [px]
const DETAIL_EDGE = 1536; // of the fine one
const DETAIL_GAIN = 1.5; // the fine picture is fetched where it is so much sharper

export interface Layer extends LayerFile {
  own: boolean; // brought by the user
  about?: string; // how it was placed
  open: () => Promise<Raster | Patch>;
}

export class Layers {
  readonly all: Layer[] = [];
  chosen: Layer | null = null;
  range: [number, number] = [0, 1];
  opacity = 0.85;
  onChange: () => void = () => undefined;
  private rasters = new Map<string, Promise<Raster | Patch>>();
  private shown: Raster | null = null;
  private turn = 0; // a slower answer must not replace a later wish

  constructor(dive: Dive, private look: Look, near: () => Bounds, private complain: (what: string) => void) {
    for (const file of dive.scene.layers) this.all.push({ ...file, own: false, open: async () => Raster.open(await dive.source.tiff(dive.address(file.file)), dive.projection, near()) });
  }

  byName(name: string): Layer | undefined {
    return this.all.find((l) => l.name === name);
  }

  private opened(layer: Layer): Promise<Raster | Patch> {
    let raster = this.rasters.get(layer.name);
    if (!raster) this.rasters.set(layer.name, (raster = layer.open()));
    return raster;
  }
  // The raster behind a layer's name, or null where the dive has none or it cannot be read.
  async raster(name: string): Promise<Raster | null> {
    const layer = this.byName(name);
    if (!layer) return null;
    const raster = await this.opened(layer).catch(() => null);
    return raster instanceof Raster ? raster : null;
  }

  add(layer: Layer): void {
    const again = this.all.findIndex((l) => l.own && l.name === layer.name);
    if (again >= 0) this.all.splice(again, 1);
    this.rasters.delete(layer.name);
    this.all.push(layer);
  }

  async choose(name: string | null): Promise<void> {
    const turn = ++this.turn;
    const layer = name === null ? null : this.byName(name) ?? null;
    this.chosen = layer;
    this.shown = null;
    this.look.setSlot('layer', null, 0);
    this.look.setSlot('detail', null, 0);
    this.onChange();
    if (!layer) return;
    try {
      const opened = await this.opened(layer);
      const patch = opened instanceof Raster ? await opened.read(opened.bounds, WHOLE_EDGE) : opened;
      if (turn !== this.turn) return;
      if (!patch) throw new Error('does not reach this dive');
      if (patch.scalar) {
        this.range = layer.min !== undefined && layer.max !== undefined && layer.max > layer.min ? [layer.min, layer.max]
          : robustRange(Array.from(patch.values).filter((v) => v > NO_DATA / 2));
        this.look.setRamp(rampOf(layer.ramp), ...this.range);
      }
      this.look.setSlot('layer', patch, this.opacity);
      if (opened instanceof Raster) {
        layer.about ??= opened.about;
        this.shown = opened;
        if (opened.residual > 1) this.complain(`${layer.title}: its coordinates bend by ${opened.residual.toFixed(1)} pixels over the dive; shown straight`);
      }
      this.onChange();
      document.body.dataset.layer = layer.name;
    } catch (error) {
      if (turn !== this.turn) return;
      this.chosen = null;
      this.rasters.delete(layer.name);
      this.complain(`layer ${layer.title}: ${reason(error)}`);
      this.onChange();
    }
  }

  // `seen`: what the camera shows of the nav plane; `pixel`: what a screen pixel spans there [m].
  async refine(seen: Bounds, pixel: number): Promise<void> {
    const raster = this.shown;
    const turn = this.turn;
    if (!raster) return;
    const b = raster.bounds;
    const whole = Math.max(b.north1 - b.north0, b.east1 - b.east0) / WHOLE_EDGE;
    const extent = Math.max(seen.north1 - seen.north0, seen.east1 - seen.east0);
    const fine = Math.max(extent / DETAIL_EDGE, raster.step);
    if (fine * DETAIL_GAIN > whole || pixel > whole) {
      this.look.setSlot('detail', null, 0);
      return;
    }
    try {
      const patch = await raster.read(seen, DETAIL_EDGE);
      if (turn === this.turn) this.look.setSlot('detail', patch, this.opacity);
      this.onChange();
    } catch (error) {
      this.complain(`layer ${this.chosen?.title ?? ''}: ${reason(error)}`);
    }
  }

  setOpacity(opacity: number): void {
    this.opacity = opacity;
    this.look.setOpacity('layer', opacity);
  }

  legend(): HTMLElement[] {
    const layer = this.chosen;
    if (!layer) return [];
    const title = make('div', '', hasUnit(layer.unit) ? `${layer.title} [${layer.unit}]` : layer.title);
    if (!this.look.uniforms.layerKind!.value) return [title, make('div', 'fine', 'Loading')];
    if (this.look.uniforms.layerKind!.value === 2) return [title];
    const [low, high] = this.range;
    const digits = high - low < 2 ? 3 : high - low < 50 ? 1 : 0;
    const about = layer.own && layer.about ? [make('div', 'fine', layer.about)] : [];
    return [title, ...rampBar(rampOf(layer.ramp), [low, (low + high) / 2, high].map((v) => number(v, digits))), ...about];
  }
}

// A title as it fits a list: without what explains it.
export const shortTitle = (title: string): string =>
  title.replace(/ *\(.*\)$/, '').replace(/ along the track$/, '').replace(/ before fusion$/, '').replace(/ that saw the surface$/, '').replace(/ of depth between meshes$/, ' of depth');

// Layers without a dimension bear the unit 1.
export const hasUnit = (unit: string): boolean => unit !== '' && unit !== '1';

// Libraries throw long and odd things at broken files.
export function reason(error: unknown): string {
  const text = error instanceof Error ? error.message : String(error);
  if (/status|404|Failed to fetch|missing|not in the opened/i.test(text)) return 'the file is missing';
  if (error instanceof RangeError || error instanceof TypeError || /offset|bounds|magic|byte order|TIFF|block|DataView|buffer/i.test(text)) return 'the file is broken or no GeoTIFF';
  return text.slice(0, 160);
}

// A raster that a user brings. `world`: the text of the world file that belongs to a PNG or JPEG.
export async function userRaster(file: File, world: string | null, dive: Dive, near: Bounds): Promise<Layer> {
  const common = { name: `own:${file.name}`, title: file.name, unit: '', file: file.name, own: true };
  if (/\.tiff?$/i.test(file.name)) {
    const raster = await Raster.open(await fromBlob(file), dive.projection, near);
    return { ...common, about: raster.about, open: async () => raster };
  }
  if (world === null) throw new Error(`${file.name} needs its world file (.pgw, .jgw or .wld) beside it: add both together`);
  const bitmap = await createImageBitmap(file);
  const grid = gridOfWorldFile(world, bitmap.width, bitmap.height);
  const { crs, text } = crsOfWorldFile(grid, dive.projection);
  const { placement } = placementOf(grid, crs, near);
  const shrink = Math.min(1, 4096 / Math.max(bitmap.width, bitmap.height));
  const canvas = new OffscreenCanvas(Math.max(1, Math.round(bitmap.width * shrink)), Math.max(1, Math.round(bitmap.height * shrink)));
  const context = canvas.getContext('2d')!;
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  const values = new Uint8Array(context.getImageData(0, 0, canvas.width, canvas.height).data.buffer);
  bitmap.close();
  const patch: Patch = { values, scalar: false, width: canvas.width, height: canvas.height, placement };
  if (![...Object.values(boundsOf(placement))].every(Number.isFinite)) throw new Error(`${file.name}: the world file places it nowhere`);
  return { ...common, about: text, open: async () => patch };
}
