import type { Tile } from '3d-tiles-renderer';
import * as THREE from 'three';
import { AnnotationPanel } from './annotation_panel';
import { BesideFiles } from './beside';
import { ControlMarks } from './control_marks';
import { Decoder } from './decoder';
import { openDive, readRecords, type Dive } from './dive';
import { bytes, count, dateAndClock, length, number, position } from '#kit/format';
import { learnProjection, type Projection } from '#kit/geodesy';
import { ImageViewer } from './image_viewer';
import { Layers, hasUnit, shortTitle } from './layers';
import { Marks } from './marks';
import { measuredGeoJson } from './measured';
import { Model } from './model';
import { drawScale, element, input, make, mark, row, save, segments, takesKeys } from '#kit/overlay';
import { readPermalink, writePermalink } from './permalink';
import { toNav, toScene, type Bounds, type Place } from '#kit/place';
import { PointPanel, type Quality } from './point_panel';
import { savePicture } from './screenshot';
import type { Source } from './source';
import { Look, type Surface } from './tile_material';
import { Timeline } from './timeline';
import { trouble } from './troubles';
import { Tools, sceneBox, type Tool } from './tools';
import { View } from './view';

// One dive, open.

const MEBIBYTE = 2 ** 20;
const LIMITS = [64, 128, 192, 256, 384, 512, 768, 1024, 2048, 4096]; // [MiB]
const HUD_INTERVAL = 250; // [ms]
const LINK_INTERVAL = 400; // least time between two writes of the address [ms]
const SHADE = 0.7; // share of the light on the texture when relief is on
const CONTOURS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20]; // intervals [m]
const MOST_CONTOURS = 16;
const TOP_HEIGHT = 70; // of the bars over the picture [px], and
const TIMELINE_HEIGHT = 148; // of the one below, before they are there

export class App {
  readonly view = new View(element('scene') as HTMLCanvasElement);
  readonly look = new Look();
  readonly marks = new Marks();
  model!: Model;
  private dive!: Dive;
  private layers!: Layers;
  private tools!: Tools;
  private point!: PointPanel;
  private annotations!: AnnotationPanel;
  private beside!: BesideFiles;
  private timeline: Timeline | null = null;
  private crs: Projection | null = null; // that people asked for
  private viewer = new ImageViewer();
  private linkAt = 0;
  private linkTimer: ReturnType<typeof setTimeout> | null = null;

  // Throws where there is no dive.
  async open(source: Source, imageFolder?: string | null): Promise<void> {
    this.dive = await openDive(source, trouble, imageFolder);
    const { dive, view, look, marks } = this;
    const { scene } = dive;
    const name = scene.name || scene.dive_id || source.name;
    document.title = `${name} · Fathom`;
    element('dive-name').textContent = name;
    element('software').textContent = scene.software ? `Made by ${scene.software}` : '';

    const kept = Number(localStorage.getItem('fathom limit') ?? NaN);
    this.model = new Model(view, look, dive, trouble, Number.isFinite(kept) && kept > 0 ? kept : null);
    const records = readRecords(dive, trouble);
    this.frames();
    const link = readPermalink(location.hash);
    if (scene.bounds) this.setHome(sceneBox(scene.bounds, scene.depth ?? [0, 0]));
    else await new Promise<void>((rooted) => {
      this.model.onRoot = (box) => {
        this.setHome(box);
        rooted();
      };
      this.model.onFailed = rooted;
    });
    // The bar of the timeline will stand there; the dive fits above it from the start.
    const height = (id: string): number => (element(id).hidden ? 0 : element(id).getBoundingClientRect().height);
    let timelineHeight = scene.track ? TIMELINE_HEIGHT : 0;
    view.covered = () => ({ top: Math.max(height('top'), TOP_HEIGHT) + 24, bottom: Math.max(height('timeline-card'), timelineHeight) + 24 });
    const whole = view.wholeView(false);
    if (link.eye && link.look) view.setPose(new THREE.Vector3(...link.eye), new THREE.Vector3(...link.look));
    else view.setPose(whole.eye, whole.look);
    await records;
    timelineHeight = 0;
    const first = dive.track?.timed ? dive.track.utc[0] : undefined;
    element('dive-about').textContent = [name.includes(scene.vehicle) ? null : scene.vehicle, first ? dateAndClock(first).slice(0, 16) : null, dive.images.length > 0 ? `${count(dive.images.length)} images` : null].filter(Boolean).join(' · ');
    this.layers = new Layers(dive, look, () => this.bounds(), trouble);
    this.tools = new Tools(view, marks, this.layers);
    this.point = new PointPanel(dive, view, look, this.layers, new Decoder(() => source), this.viewer, trouble);
    this.annotations = new AnnotationPanel(dive, view, marks, trouble);
    this.viewer.markIn(new ControlMarks(dive, trouble));
    this.beside = new BesideFiles(dive, view, look, this.layers, () => this.bounds(), trouble);
    this.beside.onAnnotations = (file) => this.annotations.read(file);
    this.point.classOf = (image) => this.beside.classOf(image);
    this.point.onImage = (index) => {
      marks.setSeen(index === null ? null : dive.images[index]!);
      view.draw();
    };
    view.scene.add(marks.group);
    if (dive.track) {
      marks.setTrack(dive.track);
      this.timeline = new Timeline(dive.track, marks, view);
    }
    this.controls();
    this.restore(link);
  }

  private setHome(box: THREE.Box3): void {
    this.view.home = box;
    this.view.setLevel((box.min.y + box.max.y) / 2);
  }
  private bounds(): Bounds {
    const { min, max } = this.view.home;
    return { north0: -max.z, north1: -min.z, east0: min.x, east1: max.x };
  }

  private controls(): void {
    const { view, look, marks, dive, layers } = this;
    segments('surfaces', [['texture', 'Texture'], ['plain', 'Shape', 'Without texture, lit from the north-west'], ['wire', 'Wire', 'Triangles, coloured by level of detail']], (v) => this.setSurface(v as Surface));
    segments('views', [['whole', 'Whole dive', 'Home'], ['top', 'From above']], (v) => {
      const { eye, look: at, up } = view.wholeView(v === 'top');
      view.flyTo(eye, at, up);
    });
    segments('tools', [['explore', 'Explore'], ['distance', 'Distance'], ['area', 'Area'], ['profile', 'Profile'], ['annotate', 'Annotate']], (v) => this.tools.choose(v as Tool));
    this.tools.choose('explore');
    this.tools.onSelect = (place) => this.select(place);
    this.tools.onAnnotate = (place) => {
      this.select(place);
      this.annotations.add(place, this.point.images.slice(0, 12));
    };
    this.tools.onHover = (place) => this.hover(place);
    element('compass').onclick = () => view.northUp();
    element('link').onclick = () => {
      this.writeLink();
      void navigator.clipboard?.writeText(location.href).then(() => { element('link').textContent = 'Copied'; setTimeout(() => (element('link').textContent = 'Link'), 1500); });
    };
    element('measure-save').onclick = () => save(`${(dive.scene.name || dive.scene.dive_id || 'dive').replace(/[^\w.-]+/g, '_')}_measured.geojson`,
      measuredGeoJson(this.tools.kept, dive.projection, dive.scene.dive_id), 'application/geo+json');
    input('crs').onchange = () => void this.chooseCrs(input('crs').value.trim().replace(/^EPSG:/i, ''));
    element('screenshot').onclick = () => void savePicture(view, dive.scene.name || dive.scene.dive_id || 'dive', this.caption());
    const toggle = (id: string, apply: (on: boolean) => void): void => {
      input(id).onchange = () => {
        apply(input(id).checked);
        view.draw();
        this.changed();
      };
    };
    toggle('show-track', (on) => (marks.track.object.visible = on));
    toggle('show-footprints', (on) => marks.setFootprints(dive.images, on));
    toggle('show-contours', () => this.setContours());
    toggle('show-shade', (on) => look.set('shade', on ? SHADE : 0));
    toggle('show-timeline', (on) => this.showTimeline(on));
    input('show-footprints').disabled = dive.images.length === 0;
    input('show-timeline').disabled = this.timeline === null;
    input('opacity').oninput = () => {
      layers.setOpacity(Number(input('opacity').value));
      view.draw();
      this.changed();
    };
    layers.onChange = () => this.drawLayers();
    this.drawLayers();
    element('add-files').onclick = () => input('files-input').click();
    input('files-input').onchange = async () => {
      await this.addFiles([...(input('files-input').files ?? [])]);
      input('files-input').value = '';
    };
    const choose = element('limit') as HTMLSelectElement;
    const limits = [...new Set([...LIMITS, Math.round(this.model.limit / MEBIBYTE)])].sort((a, b) => a - b);
    choose.replaceChildren(...limits.map((m) => new Option(m < 1024 ? `${m} MiB` : `${m / 1024} GiB`, String(m))));
    choose.value = String(Math.round(this.model.limit / MEBIBYTE));
    choose.onchange = () => {
      this.model.setLimit(Number(choose.value) * MEBIBYTE);
      localStorage.setItem('fathom limit', String(Number(choose.value) * MEBIBYTE));
    };
    window.addEventListener('keydown', (e) => {
      if (takesKeys(e.target)) return;
      if (e.key === 'Escape') {
        if (this.viewer.open) this.viewer.close();
        else this.tools.escape();
      } else if (e.key === 'Enter') this.tools.finish();
      else if (e.key === 'Home') {
        const whole = view.wholeView(false);
        view.flyTo(whole.eye, whole.look, whole.up);
      } else if (e.key === 'n' || e.key === 'N') view.northUp();
    });
  }

  async addFiles(files: File[]): Promise<void> {
    await this.beside.add(files);
    if (this.point.place) this.select(this.point.place);
    this.changed();
  }

  private setSurface(surface: Surface): void {
    this.look.setSurface(surface);
    mark('surfaces', surface);
    this.view.draw();
    this.changed();
  }

  private setContours(): void {
    const [low, high] = [this.view.home.min.y, this.view.home.max.y];
    const interval = CONTOURS.find((step) => (high - low) / step <= MOST_CONTOURS) ?? 50;
    this.look.set('contour', input('show-contours').checked ? interval : 0);
    element('contour-choice').title = `Depth contours every ${interval} m`;
  }

  private showTimeline(on: boolean): void {
    element('timeline-card').hidden = !on || this.timeline === null;
    if (on) this.timeline?.draw();
  }

  private drawLayers(): void {
    const { layers } = this;
    const choice = (name: string | null, title: string): HTMLElement => {
      const label = make('label');
      const radio = make('input');
      radio.type = 'radio';
      radio.name = 'layer';
      radio.value = name ?? '';
      radio.checked = (layers.chosen?.name ?? null) === name;
      radio.onchange = () => void layers.choose(name);
      label.append(radio, make('span', '', shortTitle(title)));
      label.title = title;
      return label;
    };
    element('layers').replaceChildren(choice(null, 'None'), ...layers.all.map((l) => choice(l.name, l.title)));
    element('opacity-row').hidden = layers.chosen === null;
    const legend = layers.legend();
    element('legend').hidden = legend.length === 0;
    element('legend').replaceChildren(...legend);
    this.view.draw();
    this.changed();
  }

  // What the file's own vertices tell of a place: their uncertainty and how many images saw them.
  private qualityAt(place: Place): Quality {
    const target = toScene(place);
    const from = this.view.camera.position;
    const ray = new THREE.Raycaster(from, target.clone().sub(from).normalize());
    Object.assign(ray, { firstHitOnly: true });
    const hit = ray.intersectObject(this.model.tiles.group, true).sort((a, b) => a.distance - b.distance)[0];
    const none = { sigma: null, views: null };
    if (!hit?.face || hit.point.distanceTo(target) > 0.05) return none;
    const mesh = hit.object as THREE.Mesh;
    const { geometry } = mesh;
    const local = mesh.worldToLocal(hit.point.clone());
    const { a, b, c } = hit.face;
    const corners = [a, b, c].map((i) => new THREE.Vector3().fromBufferAttribute(geometry.getAttribute('position'), i));
    const weights = THREE.Triangle.getBarycoord(local, corners[0]!, corners[1]!, corners[2]!, new THREE.Vector3());
    const blend = (name: string): number | null => {
      const values = geometry.getAttribute(name) as THREE.BufferAttribute | undefined;
      if (!values || !weights) return null;
      const v = weights.x * values.getX(a) + weights.y * values.getX(b) + weights.z * values.getX(c);
      return Number.isFinite(v) ? v : null;
    };
    return { sigma: blend('_sigma'), views: blend('_views') };
  }

  private select(place: Place): void {
    this.marks.setSelected(place);
    this.point.show(place, this.qualityAt(place));
    this.view.draw();
    this.changed();
  }

  private async chooseCrs(code: string): Promise<void> {
    this.crs = /^\d{4,6}$/.test(code) ? await learnProjection(Number(code)) : null;
    input('crs').setCustomValidity(code === '' || this.crs ? '' : `EPSG:${code} is none that this page knows`);
    input('crs').reportValidity();
    document.body.dataset.crs = this.crs ? code : '';
  }

  private hover(place: Place | null): void {
    const box = element('hover');
    box.hidden = place === null;
    if (!place) return;
    const g = this.dive.projection?.toGeodetic(place);
    const grid = g && this.crs ? this.crs.toLocal(g) : null;
    box.textContent = `${g ? `${position(g)}   ` : ''}${grid ? `${number(grid.east, 2, 'E')} ${number(grid.north, 2, 'N')}   ` : ''}${number(place.depth, 2, 'm deep')}`;
  }

  private caption(): string[] {
    const { scene } = this.dive;
    const layer = this.layers.chosen;
    const g = this.dive.projection?.toGeodetic(toNav(this.view.focus));
    return [scene.name || `${scene.vehicle} ${scene.dive_id}`, ...(g ? [position(g)] : []),
      ...(layer ? [`${layer.title}${hasUnit(layer.unit) ? ` [${layer.unit}]` : ''}: ${number(this.layers.range[0], 2)} to ${number(this.layers.range[1], 2)}`] : [])];
  }

  private restore(link: ReturnType<typeof readPermalink>): void {
    const shown = link.show;
    for (const name of ['track', 'footprints', 'contours', 'shade', 'timeline'] as const) {
      const box = input(`show-${name}`);
      if (shown) box.checked = shown.includes(name) && !box.disabled;
      box.onchange?.(new Event('change'));
    }
    this.setSurface((['texture', 'plain', 'wire'] as const).find((s) => s === link.surface) ?? 'texture');
    if (link.opacity !== undefined) {
      input('opacity').value = String(link.opacity);
      this.layers.opacity = link.opacity;
    }
    if (link.layer) void this.layers.choose(link.layer);
    if (link.time !== undefined) this.timeline?.goToTime(link.time);
    if (link.select) {
      // Hidden images are distinguished by the model, so it has to be there first.
      const [north, east, depth] = link.select;
      setTimeout(() => this.select({ north, east, depth }), 1200);
    }
    if (link.image) void this.point.drape(link.image);
  }

  private writeLink(): void {
    const { view } = this;
    if (!this.point) return;
    const show = ['track', 'footprints', 'contours', 'shade', 'timeline'].filter((name) => input(`show-${name}`).checked);
    const place = this.point.place;
    const hash = writePermalink({
      eye: view.camera.position.toArray(), look: view.focus.toArray(), surface: this.look.surface, layer: this.layers.chosen?.own ? undefined : this.layers.chosen?.name,
      opacity: this.layers.chosen ? this.layers.opacity : undefined, show, select: place ? [place.north, place.east, place.depth] : undefined,
      image: this.point.image ?? undefined, time: this.timeline?.time ?? undefined,
    });
    if (hash !== location.hash) history.replaceState(null, '', location.pathname + location.search + hash);
    this.linkAt = performance.now();
  }
  private changed(): void {
    if (this.linkTimer !== null) return;
    this.linkTimer = setTimeout(() => {
      this.linkTimer = null;
      this.writeLink();
    }, Math.max(0, LINK_INTERVAL - (performance.now() - this.linkAt)));
  }

  private frames(): void {
    const { view, model } = this;
    view.beforeDraw = (moved) => {
      this.marks.beforeDraw(view.camera, view.canvas.clientHeight);
      return model.update(moved);
    };
    view.afterDraw = () => {
      if (model.firstPicture !== null) element('waiting').hidden = true;
      drawScale(view.metresPerPixel(), view.northAngle());
    };
    view.onSettled = () => {
      this.changed();
      const half = view.metresPerPixel() * Math.hypot(view.canvas.clientWidth, view.canvas.clientHeight) * 0.6;
      const { north, east } = toNav(view.focus);
      void this.layers?.refine({ north0: north - half, north1: north + half, east0: east - half, east1: east + half }, view.metresPerPixel());
    };
    setInterval(() => this.drawHud(), HUD_INTERVAL);
  }

  private drawHud(): void {
    const { view, model } = this;
    const s = model.stats;
    const held = s.bytes + this.look.bytes;
    element('hud').replaceChildren(
      row('Held', `${bytes(s.bytes)} in ${count(s.tiles)} tiles`), row('Drawn', `${count(view.triangles)} triangles, ${view.calls} calls`),
      row('Main thread', `${view.frameTime.toFixed(1)} ms a frame`), row('Loading', s.loading > 0 ? `${s.loading} tiles` : s.failed > 0 ? `done, ${s.failed} broken` : 'done'));
    const bar = element('limit-bar');
    bar.style.width = `${Math.min(100, (100 * s.bytes) / s.limit)}%`;
    bar.classList.toggle('tight', s.factor > 1);
    const badge = element('badge');
    badge.hidden = s.factor <= 1;
    if (s.factor > 1) badge.textContent = `Resolution reduced ${s.factor.toFixed(1)}×: the view needs more than ${bytes(s.limit)}`;
    Object.assign(document.body.dataset, {
      ready: String(s.visible > 0 && s.loading === 0 && !view.flying), tiles: String(s.tiles), visible: String(s.visible), loading: String(s.loading), failed: String(s.failed), bytes: String(s.bytes), held: String(held), limit: String(s.limit),
      calls: String(view.calls), triangles: String(view.triangles), frame: view.frameTime.toFixed(2), factor: s.factor.toFixed(2), flying: String(view.flying),
      eye: view.camera.position.toArray().map((v) => v.toFixed(3)).join(','), distance: length(view.focusDistance()),
      ...(model.firstPicture !== null ? { first: model.firstPicture.toFixed(0) } : {}),
    });
  }
}

export type { Tile };
