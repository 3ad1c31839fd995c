import * as THREE from 'three';
import { OVER, Polyline } from '#kit/lines';
import { boundsAbout, toNav, type Bounds, type Place } from '#kit/place';
import type { View } from './view';

// What the pointer does on the map: turn it (no tool), draw a line to measure, draw a box to ask for detail.

export type Tool = 'turn' | 'measure' | 'box';

const MEASURE_COLOUR = 0xff8f6b;
const BOX_COLOUR = 0x7fe0d0;

const line = (colour: number): Polyline => new Polyline({ color: colour, linewidth: 3, ...OVER }, 2);

export class Tools {
  readonly group = new THREE.Group();
  tool: Tool = 'turn';
  onHover: (place: Place | null) => void = () => undefined;
  onLine: (a: Place, b: Place, done: boolean) => void = () => undefined;
  onBox: (box: Bounds, done: boolean) => void = () => undefined;
  private start: Place | null = null;
  private hoverQueued = false;
  private measured = line(MEASURE_COLOUR);
  private box = line(BOX_COLOUR);

  constructor(private view: View, private origin: () => Place) {
    const { canvas } = view;
    this.group.add(this.measured.object, this.box.object);
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    canvas.addEventListener('pointerup', (event) => this.up(event));
    canvas.addEventListener('pointerleave', () => this.onHover(null));
  }

  choose(tool: Tool): void {
    this.tool = tool;
    this.start = null;
    this.view.controls.enabled = tool === 'turn';
  }

  clear(): void {
    this.start = null;
    this.measured.set([]);
    this.box.set([]);
    this.view.draw();
  }

  showBox(r: Bounds | null, depth: number): void {
    const corners = r ? [[r.north0, r.east0], [r.north0, r.east1], [r.north1, r.east1], [r.north1, r.east0]] : [];
    this.box.set(corners.map(([north, east]) => ({ north: north!, east: east!, depth })), true, this.origin());
    this.view.draw();
  }

  // On the map where there is one, else on the level that the camera looks at.
  private placeAt(event: PointerEvent, mapOnly = false): Place | null {
    const hit = this.view.pick(event.clientX, event.clientY);
    const point = hit ?? (mapOnly ? null : this.view.pickLevel(event.clientX, event.clientY));
    return point ? toNav(this.view.world.worldToLocal(point.clone()), this.origin()) : null;
  }

  private down(event: PointerEvent): void {
    if (this.tool === 'turn' || event.button !== 0) return;
    this.start = this.placeAt(event, this.tool === 'measure');
    if (this.start) (event.target as Element).setPointerCapture(event.pointerId);
  }

  private move(event: PointerEvent): void {
    if (this.hoverQueued) return; // once a frame is as often as anyone sees
    this.hoverQueued = true;
    requestAnimationFrame(() => {
      this.hoverQueued = false;
      if (event.buttons !== 0 && this.tool === 'turn') return;
      if (this.start) this.drag(event, false);
      else this.onHover(this.placeAt(event, true));
    });
  }

  private up(event: PointerEvent): void {
    if (!this.start) return;
    this.drag(event, true);
    this.start = null;
  }

  private drag(event: PointerEvent, done: boolean): void {
    const from = this.start;
    const to = this.placeAt(event, this.tool === 'measure');
    if (!from || !to) return;
    if (this.tool === 'measure') {
      this.measured.set([from, to], false, this.origin());
      this.onLine(from, to, done);
    } else {
      const box = boundsAbout(from, to);
      this.showBox(box, Math.min(from.depth, to.depth));
      this.onBox(box, done);
    }
    this.view.draw();
  }
}
