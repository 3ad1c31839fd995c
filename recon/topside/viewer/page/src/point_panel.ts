import * as THREE from 'three';
import { imagesThatSaw, type DiveImage, type Sighting } from './cameras';
import type { Decoder } from './decoder';
import type { Dive } from './dive';
import { dateAndClock, length, number, position } from '#kit/format';
import { cross, type ImageViewer } from './image_viewer';
import { hasUnit, reason, shortTitle, type Layers } from './layers';
import { element, make, row } from '#kit/overlay';
import { toScene, type Place } from '#kit/place';
import type { Look } from './tile_material';
import type { View } from './view';
import { halfHeightAngle } from './cameras';

// What is known of a place: position and its uncertainty, what the layers say, and the original images that saw it.

const MOST_IMAGES = 12; // shown at once
const MOST_TESTED = 40; // for being hidden behind something
const THUMB_EDGE = 200; // [px]
const HIDDEN_MARGIN = 0.06; // [m], or this share of the range: what is nearer to the camera than that hides the place

const taken = (image: DiveImage): string => (image.utc_ns === '' ? 'time unknown' : `${dateAndClock(Number(image.utc_ns) / 1e9)} UTC`);

export interface Quality {
  sigma: number | null; // of the surface [m]
  views: number | null;
}

export class PointPanel {
  place: Place | null = null;
  image: string | null = null; // name of the image draped over the model
  classOf: (image: number) => string | null = () => null;
  onImage: (index: number | null) => void = () => undefined;
  private turn = 0;
  private sightings: Sighting[] = [];

  constructor(private dive: Dive, private view: View, private look: Look, private layers: Layers, private decoder: Decoder, private viewer: ImageViewer,
              private complain: (what: string) => void) {}

  get images(): string[] {
    return this.sightings.map((s) => this.dive.images[s.index]!.left);
  }

  clear(): void {
    ++this.turn;
    this.place = null;
    this.sightings = [];
    for (const id of ['image-actions', 'layers-here']) element(id).hidden = true;
    for (const id of ['point-rows', 'point-layers', 'images', 'images-head']) element(id).replaceChildren();
    element('point-empty').hidden = false;
  }

  show(place: Place, quality: Quality): void {
    const turn = ++this.turn;
    this.place = place;
    element('point-empty').hidden = true;
    const geodetic = this.dive.projection?.toGeodetic(place);
    const rows = element('point-rows');
    rows.replaceChildren();
    if (geodetic) {
      rows.append(row('Position', position(geodetic)));
      rows.append(row('Degrees', `${geodetic.latitude.toFixed(7)}, ${geodetic.longitude.toFixed(7)}`));
    }
    rows.append(row('North, east', `${number(place.north, 3, 'm')}, ${number(place.east, 3, 'm')}`));
    rows.append(row('Depth', number(place.depth, 3, 'm')));
    const sure = row('Uncertainty (1 σ)', quality.sigma !== null ? length(quality.sigma) : '–');
    const views = row('Views', quality.views !== null ? String(Math.round(quality.views)) : '–');
    rows.append(sure, views);
    Object.assign(document.body.dataset, { north: place.north.toFixed(4), east: place.east.toFixed(4), depth: place.depth.toFixed(4) });
    void this.showLayers(place, turn, quality.sigma === null ? sure.querySelector('b')! : null);
    this.showImages(place, turn);
  }

  private async showLayers(place: Place, turn: number, sure: HTMLElement | null): Promise<void> {
    const box = element('point-layers');
    box.replaceChildren();
    element('layers-here').hidden = this.layers.all.length === 0;
    for (const layer of this.layers.all) {
      const raster = await this.layers.raster(layer.name);
      const value = raster?.scalar ? await raster.valueAt(place.north, place.east).catch(() => NaN) : NaN;
      if (turn !== this.turn) return;
      if (!Number.isFinite(value)) continue;
      if (layer.name === 'uncertainty') {
        if (sure) sure.textContent = length(value);
      } else if (layer.name !== 'elevation') box.append(row(shortTitle(layer.title), number(value, Math.abs(value) < 10 ? 3 : 1, hasUnit(layer.unit) ? layer.unit : '')));
    }
  }

  // Images whose view of the place is not blocked by the model itself.
  private visible(place: Place): Sighting[] {
    const { camera, images } = this.dive;
    if (!camera) return [];
    const target = toScene(place);
    return imagesThatSaw(camera, images, place).slice(0, MOST_TESTED).filter(({ index, range }) => {
      const eye = toScene(images[index]!);
      const ray = new THREE.Raycaster(eye, target.clone().sub(eye).normalize(), 0.1, range - Math.max(HIDDEN_MARGIN, 0.05 * range));
      Object.assign(ray, { firstHitOnly: true });
      return ray.intersectObject(this.view.pickable, true).length === 0;
    });
  }

  private showImages(place: Place, turn: number): void {
    const { dive } = this;
    const box = element('images');
    box.replaceChildren();
    this.sightings = this.visible(place);
    document.body.dataset.images = String(this.sightings.length);
    const shown = dive.originals ? this.sightings.slice(0, MOST_IMAGES) : [];
    element('images-head').textContent = dive.images.length === 0 ? '' : this.sightings.length === 0 ? 'No image saw this point.'
      : `${this.sightings.length} image${this.sightings.length > 1 ? 's' : ''} saw it${dive.originals && shown.length < this.sightings.length ? `, the best ${shown.length} here` : ''}`;
    element('image-actions').hidden = true;
    for (const sighting of shown) box.append(this.thumb(sighting, turn));
  }

  private thumb(sighting: Sighting, turn: number): HTMLElement {
    const image = this.dive.images[sighting.index]!;
    const button = make('button', 'thumb');
    const label = this.classOf(sighting.index);
    button.title = `${image.left}\n${taken(image)}${label ? `\n${label}` : ''}`;
    button.append(make('em', '', `${sighting.range.toFixed(2)} m${label ? ` · ${label}` : ''}`));
    button.onmouseenter = () => this.onImage(sighting.index);
    button.onmouseleave = () => this.onImage(null);
    button.onclick = () => {
      for (const other of element('images').querySelectorAll('.thumb')) other.setAttribute('aria-pressed', String(other === button));
      element('image-actions').hidden = false;
      element('image-actions').replaceChildren(make('div', 'fine', image.left), ...this.actions(sighting));
    };
    button.ondblclick = () => void this.full(sighting);
    this.decoder.decode(this.dive.imageAddress(image.left), this.dive.scene.imageFormat, THUMB_EDGE, () => turn === this.turn).then((decoded) => {
      if (!decoded || turn !== this.turn) return decoded?.bitmap.close();
      const canvas = make('canvas');
      canvas.width = decoded.bitmap.width;
      canvas.height = decoded.bitmap.height;
      const c = canvas.getContext('2d')!;
      c.drawImage(decoded.bitmap, 0, 0);
      decoded.bitmap.close();
      cross(c, (sighting.u / decoded.width) * canvas.width, (sighting.v / decoded.height) * canvas.height, 16);
      button.prepend(canvas);
      document.body.dataset.thumbs = String(Number(document.body.dataset.thumbs ?? 0) + 1);
    }).catch((error: unknown) => {
      if (turn !== this.turn) return;
      const why = reason(error);
      button.prepend(make('span', 'missing', why));
      this.complain(`image ${image.left}: ${why}`);
    });
    return button;
  }

  private actions(sighting: Sighting): HTMLElement[] {
    const image = this.dive.images[sighting.index]!;
    const open = make('button', '', 'Open');
    open.title = 'Full resolution';
    open.onclick = () => void this.full(sighting);
    const fly = make('button', '', 'Fly there');
    fly.onclick = () => this.fly(sighting.index);
    const drape = make('button', '', 'On the model');
    drape.title = 'Project the image onto the model from where it was taken';
    drape.setAttribute('aria-pressed', String(this.image === image.left));
    drape.onclick = async () => {
      await this.drape(this.image === image.left ? null : image.left);
      drape.setAttribute('aria-pressed', String(this.image === image.left));
    };
    return [open, fly, drape];
  }

  private async full(sighting: Sighting): Promise<void> {
    const image = this.dive.images[sighting.index]!;
    try {
      const decoded = await this.decoder.decode(this.dive.imageAddress(image.left), this.dive.scene.imageFormat, 0);
      if (decoded) this.viewer.show(decoded.bitmap, [sighting.u, sighting.v], `${image.left} · ${taken(image)} · ${length(sighting.range)} away · ${decoded.width} × ${decoded.height}`, image.left);
    } catch (error) {
      this.complain(`image ${image.left}: ${reason(error)}`);
    }
  }

  async drape(name: string | null): Promise<void> {
    const image = name === null ? null : this.dive.images.find((i) => i.left === name) ?? null;
    this.image = image?.left ?? null;
    if (!image || !this.dive.camera || !this.dive.originals) {
      this.look.setPhoto(null, null, null);
      this.view.draw();
      return;
    }
    try {
      const decoded = await this.decoder.decode(this.dive.imageAddress(image.left), this.dive.scene.imageFormat, 0, () => this.image === image.left);
      if (decoded) this.look.setPhoto(decoded.bitmap, this.dive.camera, image);
      this.view.draw();
    } catch (error) {
      this.image = null;
      this.complain(`image ${image.left}: ${reason(error)}`);
    }
  }

  // To where the image was taken, so that it fills the picture.
  fly(index: number): void {
    const image = this.dive.images[index]!;
    const { camera } = this.dive;
    const eye = toScene(image);
    const [w, x, y, z] = image.q;
    const turned = (v: [number, number, number]): THREE.Vector3 => {
      const nav = new THREE.Vector3(...v).applyQuaternion(new THREE.Quaternion(x, y, z, w));
      return new THREE.Vector3(nav.y, -nav.z, -nav.x);
    };
    const ahead = turned([0, 0, 1]);
    const range = image.altitude && image.altitude > 0 ? image.altitude : 2;
    const look = eye.clone().addScaledVector(ahead, range);
    const wanted = camera ? halfHeightAngle(camera) * 1.05 : 0.4;
    const distance = (range * Math.tan(wanted)) / Math.tan(THREE.MathUtils.degToRad(this.view.camera.fov / 2));
    this.view.flyTo(look.clone().addScaledVector(ahead, -distance), look, turned([0, -1, 0]));
  }
}
