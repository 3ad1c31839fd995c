import * as THREE from 'three';
import { LongLine, OVER, Polyline } from '#kit/lines';
import type { DiveImage } from './cameras';
import type { Track } from './dive';
import { toScene, type Place } from '#kit/place';

// What is drawn beside the seafloor: the vehicle's track, footprints, the vehicle at a time, points and measured lines. Each is
// one draw call, and none hides behind the ground it belongs to.

const TRACK_COLOUR = 0xf0b95e;
const FOOTPRINT_COLOUR = 0x9fd8e6;
const FOOTPRINTS = 400; // of images that follow each other, drawn at once
const CROWDED = 24; // [px] footprints smaller than this are thinned out: of a long dive more would cover each other
const MARK_SIZE = 15; // [px]
const LINE_ORDER = 5; // after the ground, before points and the vehicle
const VEHICLE_SIZE = 0.035; // of the distance to the camera

function disc(fill: string, ring: string): THREE.Texture {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 64;
  const c = canvas.getContext('2d')!;
  c.beginPath();
  c.arc(32, 32, 22, 0, 7);
  c.fillStyle = fill;
  c.fill();
  c.lineWidth = 7;
  c.strokeStyle = ring;
  c.stroke();
  return new THREE.CanvasTexture(canvas);
}

// So many numbers from 0 in an order of which every beginning is spread evenly over all.
export function spreadOrder(count: number): number[] {
  const bits = Math.ceil(Math.log2(Math.max(count, 2)));
  const turned = (i: number): number => {
    let out = 0;
    for (let b = 0; b < bits; ++b) out |= ((i >> b) & 1) << (bits - 1 - b);
    return out;
  };
  return Array.from({ length: 2 ** bits }, (_, i) => turned(i)).filter((i) => i < count);
}

export class Marks {
  readonly group = new THREE.Group();
  readonly track = new LongLine({ color: TRACK_COLOUR, opacity: 0.75, ...OVER }, LINE_ORDER);
  readonly measured = new Polyline({ color: 0xff8f6b, linewidth: 2.5, ...OVER }, LINE_ORDER);
  readonly seen = new Polyline({ color: 0xffffff, linewidth: 2, ...OVER }, LINE_ORDER);
  private footprints: THREE.Group | null = null;
  private footprintSize = 0; // [m]
  private measuredPoints = this.points('#ff8f6b', '#2a0f06', MARK_SIZE * 0.8);
  private annotated = this.points('#f7d35c', '#241d05', MARK_SIZE);
  private selected = this.points('rgba(111,183,201,0.45)', '#ffffff', MARK_SIZE * 1.5);
  private vehicle: THREE.Mesh;

  constructor() {
    const shape = new THREE.Shape([new THREE.Vector2(0, 1), new THREE.Vector2(0.55, -0.8), new THREE.Vector2(0, -0.45), new THREE.Vector2(-0.55, -0.8)]);
    const flat = new THREE.ShapeGeometry(shape).rotateX(-Math.PI / 2); // points north, seen from above
    this.vehicle = new THREE.Mesh(flat, new THREE.MeshBasicMaterial({ color: 0xffe08a, side: THREE.DoubleSide, ...OVER }));
    this.vehicle.renderOrder = 8;
    this.vehicle.visible = false;
    this.group.add(this.track.object, this.measured.object, this.seen.object, this.measuredPoints, this.annotated, this.selected, this.vehicle);
  }

  private points(fill: string, ring: string, size: number): THREE.Points {
    const material = new THREE.PointsMaterial({ map: disc(fill, ring), size, sizeAttenuation: false, ...OVER });
    const points = new THREE.Points(new THREE.BufferGeometry(), material);
    points.renderOrder = 7;
    points.frustumCulled = false;
    points.visible = false;
    return points;
  }
  private place(points: THREE.Points, at: Place[]): void {
    points.geometry.dispose();
    points.geometry = new THREE.BufferGeometry();
    points.geometry.setAttribute('position', new THREE.Float32BufferAttribute(at.flatMap((p) => toScene(p).toArray()), 3));
    points.visible = at.length > 0;
  }

  setTrack(track: Track): void {
    this.track.set(track.north.map((north, i) => {
      const [east, depth] = [track.east[i], track.depth[i]];
      return north !== null && east !== null && east !== undefined ? { north, east, depth: depth ?? 0 } : null;
    }));
  }
  setFootprints(images: DiveImage[], shown: boolean): void {
    if (this.footprints || !shown) {
      if (this.footprints) this.footprints.visible = shown;
      return;
    }
    this.footprints = new THREE.Group();
    const material = new THREE.LineBasicMaterial({ color: FOOTPRINT_COLOUR, opacity: 0.45, ...OVER });
    for (let first = 0; first < images.length; first += FOOTPRINTS) {
      const some = images.slice(first, first + FOOTPRINTS);
      const positions: number[] = [];
      for (const i of spreadOrder(some.length)) {
        const { footprint } = some[i]!;
        footprint.forEach((corner, k) => {
          for (const [north, east, depth] of [corner, footprint[(k + 1) % footprint.length]!]) positions.push(east, -depth, -north);
        });
      }
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions, 3));
      geometry.computeBoundingSphere();
      const lines = new THREE.LineSegments(geometry, material);
      lines.renderOrder = 4;
      this.footprints.add(lines);
    }
    const sizes = images.map(({ footprint: [a, b] }) => (a && b ? Math.hypot(a[0] - b[0], a[1] - b[1]) : 0)).sort((a, b) => a - b);
    this.footprintSize = sizes[sizes.length >> 1] ?? 0;
    this.group.add(this.footprints);
  }
  setMeasured(points: Place[], closed: boolean): void {
    this.measured.set(points, closed);
    this.place(this.measuredPoints, points);
  }
  setAnnotations(points: Place[]): void {
    this.place(this.annotated, points);
  }
  setSelected(point: Place | null): void {
    this.place(this.selected, point ? [point] : []);
  }
  setSeen(image: DiveImage | null): void {
    this.seen.set(image ? image.footprint.map(([north, east, depth]) => ({ north, east, depth })) : [], true);
  }
  setVehicle(place: Place | null, headingDeg: number | null): void {
    this.vehicle.visible = place !== null;
    if (!place) return;
    this.vehicle.position.copy(toScene(place));
    this.vehicle.rotation.y = -THREE.MathUtils.degToRad(headingDeg ?? 0);
  }
  beforeDraw(camera: THREE.PerspectiveCamera, height: number): void {
    this.track.look(camera, height);
    if (this.footprints?.visible) {
      const scale = (this.footprintSize * height) / (2 * Math.tan(THREE.MathUtils.degToRad(camera.fov / 2)));
      for (const lines of this.footprints.children as THREE.LineSegments[]) {
        const { center, radius } = lines.geometry.boundingSphere!;
        const pixels = scale / Math.max(camera.position.distanceTo(center) - radius, 1e-3);
        const share = Math.min((pixels / CROWDED) ** 2, 1);
        const all = lines.geometry.getAttribute('position').count;
        lines.geometry.setDrawRange(0, 2 * Math.ceil((all / 2) * share));
      }
    }
    if (this.vehicle.visible) this.vehicle.scale.setScalar(VEHICLE_SIZE * camera.position.distanceTo(this.vehicle.position));
  }
}
