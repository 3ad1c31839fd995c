import * as THREE from 'three';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import type { Place } from './place';
import { rectangle, type Rectangle } from './place';
import type { Seafloor } from './seafloor';
import { fromScene, toScene } from './vehicle';
import type { View } from './view';
import type { Origin } from './place';

// What the pointer does on the map: turn it (no tool), draw a line to measure, draw a box to ask for detail.

export type Tool = 'turn' | 'measure' | 'box';

const MEASURE_COLOUR = 0xff8f6b;
const BOX_COLOUR = 0x7fe0d0;

function line(colour: number): Line2 {
  const object = new Line2(new LineGeometry(), new LineMaterial({ color: colour, linewidth: 3, depthTest: false, transparent: true }));
  object.visible = false;
  object.frustumCulled = false;
  object.renderOrder = 2;
  return object;
}

export class Tools {
  readonly group = new THREE.Group();
  tool: Tool = 'turn';
  onHover: (place: Place | null) => void = () => undefined;
  onLine: (a: Place, b: Place, done: boolean) => void = () => undefined;
  onBox: (box: Rectangle, done: boolean) => void = () => undefined;
  private start: Place | null = null;
  private hoverQueued = false;
  private measured = line(MEASURE_COLOUR);
  private box = line(BOX_COLOUR);

  constructor(private view: View, canvas: HTMLCanvasElement, private seafloor: Seafloor, private origin: () => Origin) {
    this.group.add(this.measured, this.box);
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
    this.measured.visible = this.box.visible = false;
    this.view.draw();
  }

  showBox(r: Rectangle | null, depth: number): void {
    this.box.visible = r !== null;
    if (r) {
      const corners = [[r.northMin, r.eastMin], [r.northMin, r.eastMax], [r.northMax, r.eastMax], [r.northMax, r.eastMin], [r.northMin, r.eastMin]];
      this.draw(this.box, corners.map(([north, east]) => ({ north: north!, east: east!, depth })));
    }
    this.view.draw();
  }

  // On the map where there is one, else on the level that the camera looks at.
  private placeAt(event: PointerEvent, mapOnly = false): Place | null {
    const hit = this.view.pick(event.clientX, event.clientY, [this.seafloor.group]);
    const point = hit ?? (mapOnly ? null : this.view.pickLevel(event.clientX, event.clientY));
    return point ? fromScene(this.origin(), this.view.world.worldToLocal(point.clone())) : null;
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
      this.measured.visible = true;
      this.draw(this.measured, [from, to]);
      this.onLine(from, to, done);
    } else {
      const box = rectangle(from, to);
      this.showBox(box, Math.min(from.depth, to.depth));
      this.onBox(box, done);
    }
    this.view.draw();
  }

  private draw(object: Line2, places: Place[]): void {
    object.geometry.dispose();
    object.geometry = new LineGeometry();
    object.geometry.setPositions(places.flatMap((p) => toScene(this.origin(), p).toArray()));
  }
}
