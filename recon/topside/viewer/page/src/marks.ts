import * as THREE from 'three';
import { OVER, Polyline } from '#kit/lines';
import type { DiveImage } from './cameras';
import type { Track } from './dive';
import { toScene, type Place } from '#kit/place';

// What is drawn beside the seafloor: the vehicle's way, footprints, the vehicle at a time, points and measured lines. Each is
// one draw call, and none hides behind the ground it belongs to.

const TRACK_COLOUR = 0xf0b95e;
const FOOTPRINT_COLOUR = 0x9fd8e6;
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

export class Marks {
  readonly group = new THREE.Group();
  readonly track = new Polyline({ color: TRACK_COLOUR, linewidth: 1.6, opacity: 0.6, ...OVER }, LINE_ORDER);
  readonly measured = new Polyline({ color: 0xff8f6b, linewidth: 2.5, ...OVER }, LINE_ORDER);
  readonly seen = new Polyline({ color: 0xffffff, linewidth: 2, ...OVER }, LINE_ORDER);
  private footprints: THREE.LineSegments | null = null;
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
    const positions: number[] = [];
    for (const { footprint } of images)
      footprint.forEach((corner, i) => {
        for (const [north, east, depth] of [corner, footprint[(i + 1) % footprint.length]!]) positions.push(east, -depth, -north);
      });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions, 3));
    this.footprints = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: FOOTPRINT_COLOUR, opacity: 0.45, ...OVER }));
    this.footprints.renderOrder = 4;
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
  beforeDraw(camera: THREE.Camera): void {
    if (this.vehicle.visible) this.vehicle.scale.setScalar(VEHICLE_SIZE * camera.position.distanceTo(this.vehicle.position));
  }
}
