import * as THREE from 'three';
import { area, length, number, volume } from '#kit/format';
import type { Layers } from './layers';
import type { Marks } from './marks';
import { lineText, measure, pathLength, planArea, sampleGrid, stations, surfaceArea, volumes, type HeightGrid } from '#kit/measure';
import type { Measured } from './measured';
import { element, mark } from '#kit/overlay';
import { ProfileChart, type ProfilePoint } from '#kit/charts';
import { toNav, toScene, type Bounds, type Place } from '#kit/place';
import type { View } from './view';

// What a click on the seafloor means: look at a point, measure a line, an area or a profile, or annotate.

export type Tool = 'explore' | 'distance' | 'area' | 'profile' | 'annotate';
const HINTS: Record<Tool, string> = {
  explore: '', distance: 'Click points along the line; Enter or double click ends it', area: 'Click the corners; Enter or double click closes the area',
  profile: 'Click points along the line; Enter or double click draws depth along it', annotate: 'Click what to mark',
};
const CLICK_SLOP = 5; // [px] the pointer may move between down and up
const STATIONS = 300; // of a profile
const GRID_EDGE = 1200; // nodes across a measured area or profile

export class Tools {
  tool: Tool = 'explore';
  points: Place[] = [];
  kept: Measured[] = []; // what was measured, oldest first
  onSelect: (place: Place) => void = () => undefined;
  onAnnotate: (place: Place) => void = () => undefined;
  onHover: (place: Place | null) => void = () => undefined;
  private done = false;
  private down: { x: number; y: number } | null = null;
  private chart = new ProfileChart(element('profile'));
  private profile: Place[] = [];
  private hoverAt = 0;

  constructor(private view: View, private marks: Marks, private layers: Layers) {
    const { canvas } = view;
    canvas.addEventListener('pointerdown', (e) => { this.down = e.button === 0 && !e.shiftKey ? { x: e.clientX, y: e.clientY } : null; });
    canvas.addEventListener('pointerup', (e) => {
      const down = this.down;
      this.down = null;
      if (down && Math.hypot(e.clientX - down.x, e.clientY - down.y) <= CLICK_SLOP) this.click(e.clientX, e.clientY);
    });
    canvas.addEventListener('dblclick', (e) => {
      if (this.measuring) this.finish();
      else {
        const hit = view.pick(e.clientX, e.clientY);
        if (hit) view.flyAbove(hit, Math.max(view.camera.position.distanceTo(hit) / 4, 1));
      }
    });
    canvas.addEventListener('pointermove', (e) => {
      if (e.buttons !== 0 || performance.now() - this.hoverAt < 60) return;
      this.hoverAt = performance.now();
      const hit = view.pick(e.clientX, e.clientY);
      this.onHover(hit ? toNav(hit) : null);
    });
    canvas.addEventListener('pointerleave', () => this.onHover(null));
    element('measure-close').onclick = () => this.clear();
    this.chart.onHover = (i) => {
      marks.setSelected(i === null ? null : this.profile[i] ?? null);
      view.draw();
    };
  }

  get measuring(): boolean {
    return this.tool === 'distance' || this.tool === 'area' || this.tool === 'profile';
  }

  choose(tool: Tool): void {
    if (this.tool !== tool) this.clear();
    this.tool = tool;
    mark('tools', tool);
    this.view.canvas.classList.toggle('aiming', tool !== 'explore');
    element('hint').hidden = HINTS[tool] === '';
    element('hint').textContent = HINTS[tool];
  }

  clear(): void {
    this.points = [];
    this.done = false;
    this.profile = [];
    this.chart.clear();
    element('measure-card').hidden = true;
    this.marks.setMeasured([], false);
    this.view.draw();
  }

  escape(): void {
    if (this.points.length > 0) this.clear();
    else this.choose('explore');
  }

  private click(x: number, y: number): void {
    const hit = this.view.pick(x, y);
    if (!hit) return;
    const place = toNav(hit);
    if (this.tool === 'explore') return this.onSelect(place);
    if (this.tool === 'annotate') return this.onAnnotate(place);
    if (this.done) this.clear();
    const last = this.points.at(-1);
    if (last && measure(last, place).slope < 1e-6) return; // the second half of a double click
    this.points.push(place);
    this.show();
  }

  finish(): void {
    if (!this.measuring || this.done || this.points.length < 2) return;
    this.done = true;
    const isArea = this.tool === 'area';
    if (!isArea || this.points.length > 2) this.kept.push({ area: isArea, points: [...this.points], text: this.text() });
    this.show();
    if (this.tool === 'profile') void this.drawProfile();
    if (this.tool === 'area') void this.addSurface();
  }

  private show(): void {
    this.marks.setMeasured(this.points, this.tool === 'area');
    element('measure-card').hidden = this.points.length < 2;
    element('measure-text').textContent = this.text();
    document.body.dataset.measured = this.text();
    this.view.draw();
  }

  private text(): string {
    const { points } = this;
    if (points.length < 2) return '';
    if (this.tool === 'area') {
      const round = pathLength([...points, points[0]!]);
      return points.length < 3 ? '' : `${area(planArea(points))} from above · around it ${length(round.slope)}`;
    }
    return lineText(points);
  }

  private around(points: Place[]): Bounds {
    const margin = 0.2;
    return {
      north0: Math.min(...points.map((p) => p.north)) - margin, north1: Math.max(...points.map((p) => p.north)) + margin,
      east0: Math.min(...points.map((p) => p.east)) - margin, east1: Math.max(...points.map((p) => p.east)) + margin,
    };
  }
  private async grid(layer: string, points: Place[]): Promise<HeightGrid | null> {
    const raster = await this.layers.raster(layer);
    return raster ? raster.grid(this.around(points), GRID_EDGE).catch(() => null) : null;
  }

  // From the elevation layer, which has the finest level everywhere; without it, from the tiles as they are shown.
  private async drawProfile(): Promise<void> {
    const points = [...this.points];
    const [elevation, uncertainty] = await Promise.all([this.grid('elevation', points), this.grid('uncertainty', points)]);
    const line = stations(points, STATIONS);
    const data: ProfilePoint[] = line.map(({ along, north, east }) => {
      let up = elevation ? sampleGrid(elevation, north, east) : NaN;
      if (!Number.isFinite(up) && !elevation) up = this.view.heightAt(east, -north) ?? NaN;
      const sigma = uncertainty ? sampleGrid(uncertainty, north, east) : NaN;
      return { along, depth: -up, sigma: Number.isFinite(sigma) ? sigma : 0 };
    });
    this.profile = line.map(({ north, east }, i) => ({ north, east, depth: Number.isFinite(data[i]!.depth) ? data[i]!.depth : points[0]!.depth }));
    this.chart.set(data);
    document.body.dataset.profile = String(data.filter((p) => Number.isFinite(p.depth)).length);
  }

  private async addSurface(): Promise<void> {
    if (this.points.length < 3) return;
    const points = [...this.points];
    const elevation = await this.grid('elevation', points);
    if (!elevation || points.length !== this.points.length) return;
    const { surface, plan } = surfaceArea(elevation, points);
    if (plan <= 0) return;
    const { above, below } = volumes(elevation, points);
    const text = `${this.text()} · seafloor ${area((surface / plan) * planArea(points))}, rugosity ${number(surface / plan, 2)} · ${volume(above)} above the corners' plane, ${volume(below)} below`;
    this.kept.at(-1)!.text = text;
    element('measure-text').textContent = text;
    document.body.dataset.measured = text;
  }
}

export const sceneBox = (b: Bounds, depth: [number, number]): THREE.Box3 =>
  new THREE.Box3().setFromPoints([toScene({ north: b.north0, east: b.east0, depth: depth[1] }), toScene({ north: b.north1, east: b.east1, depth: depth[0] })]);
