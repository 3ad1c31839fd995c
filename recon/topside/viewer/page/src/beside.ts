import { fromBlob } from 'geotiff';
import * as THREE from 'three';
import { readCsv } from './csv';
import type { Dive } from './dive';
import { count } from '#kit/format';
import { drapeLabels } from './label_drape';
import { joinLabels, type Labels } from './labels';
import { userRaster, type Layers } from './layers';
import { gridSurface, readPly, type Axes } from './meshes';
import { element, make, swatch } from '#kit/overlay';
import { boundsOf, Raster } from './raster';
import type { Bounds } from '#kit/place';
import { classColour } from '#kit/ramps';
import type { Look } from './tile_material';
import type { View } from './view';

// Files that people bring beside a dive: rasters and labels over the seafloor, meshes and multibeam next to it.

const LABEL_OPACITY = 0.55;
const GRID_EDGE = 1400; // nodes read of a gridded surface

interface Beside {
  name: string;
  about: string;
  object: THREE.Object3D;
}

export class BesideFiles {
  readonly group = new THREE.Group();
  labels: Labels | null = null;
  onAnnotations: (file: File) => Promise<void> = async () => undefined;
  private meshes: Beside[] = [];
  private labelsOn = true;

  constructor(private dive: Dive, private view: View, private look: Look, private layers: Layers, private near: () => Bounds, private complain: (what: string) => void) {
    view.pickable.add(this.group);
  }

  classOf(image: number): string | null {
    const index = this.labels?.ofImage[image] ?? -1;
    return index < 0 ? null : this.labels!.classes[index]!.name;
  }

  async add(files: File[]): Promise<void> {
    const worlds = new Map(files.filter((f) => /\.(pgw|pngw|jgw|jpgw|wld)$/i.test(f.name)).map((f) => [f.name.replace(/\.[^.]*$/, '').toLowerCase(), f]));
    for (const file of files) {
      try {
        if (/\.(tiff?|png|jpe?g)$/i.test(file.name)) {
          const layer = await userRaster(file, (await worlds.get(file.name.replace(/\.[^.]*$/, '').toLowerCase())?.text()) ?? null, this.dive, this.near());
          this.layers.add(layer);
          await this.layers.choose(layer.name);
          if (/\.tiff?$/i.test(file.name)) this.offerSurface(file);
        } else if (/\.ply$/i.test(file.name)) await this.addPly(file);
        else if (/\.(geojson|json)$/i.test(file.name)) await this.onAnnotations(file);
        else if (/\.(csv|tsv|txt)$/i.test(file.name)) await this.addTable(file);
        else if (!worlds.has(file.name.replace(/\.[^.]*$/, '').toLowerCase())) throw new Error('is of no kind that this page reads');
      } catch (error) {
        const text = error instanceof Error ? error.message : String(error);
        this.complain(text.startsWith(file.name) ? text : `${file.name}: ${text}`);
      }
    }
    this.view.draw();
  }

  private async addTable(file: File): Promise<void> {
    const table = readCsv(await file.text());
    const isPoints = ['note', 'depth_m'].every((c) => table.columns.includes(c));
    if (isPoints) return this.onAnnotations(file);
    this.labels = joinLabels(table, this.dive.images);
    if (this.labels.unknown > 0) this.complain(`${file.name}: ${count(this.labels.unknown)} rows name no image of this dive`);
    this.labelsOn = true;
    this.drawLabels(file.name);
  }

  private drawLabels(name: string): void {
    const { labels } = this;
    const box = element('labels');
    box.replaceChildren();
    if (!labels) return;
    const patch = drapeLabels(labels, this.dive.images);
    if (!patch) this.complain(`${name}: the labelled images have no footprints to colour`);
    this.look.setSlot('labels', patch, LABEL_OPACITY);
    const toggle = make('input');
    toggle.type = 'checkbox';
    toggle.checked = this.labelsOn;
    toggle.onchange = () => {
      this.labelsOn = toggle.checked;
      this.look.setOpacity('labels', toggle.checked ? LABEL_OPACITY : 0);
      this.view.draw();
    };
    const remove = make('button', '', '×');
    remove.title = 'Remove';
    remove.onclick = () => {
      this.labels = null;
      this.look.setSlot('labels', null, 0);
      box.replaceChildren();
      this.view.draw();
    };
    const head = make('label', 'group-head');
    head.append(toggle, make('span', '', `${name}: ${labels.column}`), remove);
    box.append(head, ...labels.classes.slice(0, 14).map((c, i) => swatch(classColour(i), c.name, `${count(c.images)} image${c.images > 1 ? 's' : ''}`)));
    document.body.dataset.labels = String(labels.classes.length);
  }

  private async addPly(file: File, axes: Axes = 'north east down'): Promise<void> {
    const buffer = await file.arrayBuffer();
    const { object, triangles, axes: used } = readPly(buffer, axes);
    const about = `${triangles > 0 ? `${count(triangles)} triangles` : 'points'}, ${used}`;
    this.put({ name: file.name, about, object });
    const box = new THREE.Box3().setFromObject(object);
    if (!box.intersectsBox(this.view.home.clone().expandByScalar(50))) this.complain(`${file.name} is away from this dive: are its axes ${used} about the dive's origin?`);
  }

  // A raster with heights can stand beside the dive as a surface too.
  private offerSurface(file: File): void {
    const button = make('button', '', `${file.name} as a surface`);
    const line = make('div', 'buttons');
    line.append(button);
    button.onclick = async () => {
      try {
        const raster = await Raster.open(await fromBlob(file), this.dive.projection, this.near());
        const b = boundsOf(raster.placement);
        const n = this.near();
        const pad = Math.max(n.north1 - n.north0, n.east1 - n.east0);
        const grid = await raster.grid({
          north0: Math.max(b.north0, n.north0 - pad), north1: Math.min(b.north1, n.north1 + pad), east0: Math.max(b.east0, n.east0 - pad), east1: Math.min(b.east1, n.east1 + pad),
        }, GRID_EDGE);
        if (!grid) throw new Error('holds no heights near the dive');
        const { object, triangles } = gridSurface(grid);
        this.put({ name: file.name, about: `${count(triangles)} triangles, heights positive up`, object });
        line.remove();
      } catch (error) {
        this.complain(`${file.name}: ${(error as Error).message}`);
      }
    };
    element('meshes').append(line);
  }

  private put(mesh: Beside): void {
    this.meshes.push(mesh);
    this.group.add(mesh.object);
    const head = make('label', 'group-head');
    const toggle = make('input');
    toggle.type = 'checkbox';
    toggle.checked = true;
    toggle.onchange = () => {
      // Out of the group, not only unseen: what is unseen must not be clicked.
      if (toggle.checked) this.group.add(mesh.object);
      else this.group.remove(mesh.object);
      this.view.draw();
    };
    const remove = make('button', '', '×');
    remove.title = 'Remove';
    remove.onclick = () => {
      this.group.remove(mesh.object);
      (mesh.object as THREE.Mesh).geometry.dispose();
      head.remove();
      this.view.draw();
    };
    const name = make('span', '', mesh.name);
    name.title = mesh.about;
    head.append(toggle, name, make('em', '', mesh.about.split(',')[0]), remove);
    element('meshes').append(head);
    document.body.dataset.meshes = String(this.meshes.length);
    this.view.draw();
  }
}
