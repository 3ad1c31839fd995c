import * as THREE from 'three';
import { Line2 } from 'three/examples/jsm/lines/Line2.js';
import { LineGeometry } from 'three/examples/jsm/lines/LineGeometry.js';
import { LineMaterial } from 'three/examples/jsm/lines/LineMaterial.js';
import type { TrackPoint, VehicleStatus } from './api';
import type { Origin } from './seafloor';

// The vehicle, the line down to the seafloor below it, and its track.

const TRACK_COLOUR = 0xe8b36a;
const VEHICLE_COLOUR = 0xffd9a0;
const LENGTH = 2; // of the symbol [m]
const LEAST_SHARE = 0.022; // of the distance to the camera: the symbol never gets too small to see

const toScene = (origin: Origin, north: number, east: number, depth: number): THREE.Vector3 =>
  new THREE.Vector3(east - origin.east, origin.depth - depth, origin.north - north);

// A dart along -z (north), two metres long.
function dart(): THREE.BufferGeometry {
  const shape = new THREE.Shape([
    new THREE.Vector2(0, LENGTH / 2),
    new THREE.Vector2(LENGTH * 0.28, -LENGTH / 2),
    new THREE.Vector2(0, -LENGTH * 0.3),
    new THREE.Vector2(-LENGTH * 0.28, -LENGTH / 2),
  ]);
  return new THREE.ExtrudeGeometry(shape, { depth: LENGTH * 0.12, bevelEnabled: false }).rotateX(-Math.PI / 2);
}

export class Vehicle {
  readonly group = new THREE.Group();
  private symbol = new THREE.Mesh(dart(), new THREE.MeshBasicMaterial({ color: VEHICLE_COLOUR }));
  private plumb = new THREE.Line(
    new THREE.BufferGeometry(),
    new THREE.LineBasicMaterial({ color: VEHICLE_COLOUR, transparent: true, opacity: 0.55 }),
  );
  private track = new Line2(
    new LineGeometry(),
    new LineMaterial({ color: TRACK_COLOUR, linewidth: 2, transparent: true, opacity: 0.9 }),
  );
  readonly position = new THREE.Vector3();

  constructor() {
    this.group.add(this.symbol, this.plumb, this.track);
    this.group.visible = false;
    this.track.frustumCulled = false;
  }

  setStatus(status: VehicleStatus, origin: Origin): void {
    this.group.visible = true;
    this.position.copy(toScene(origin, status.north_m, status.east_m, status.depth_m));
    this.symbol.position.copy(this.position);
    this.symbol.rotation.y = -THREE.MathUtils.degToRad(status.heading_deg);
    const below = this.position.clone();
    below.y -= status.altitude_m ?? 0;
    this.plumb.geometry.dispose();
    this.plumb.geometry = new THREE.BufferGeometry().setFromPoints([this.position, below]);
  }

  setTrack(points: TrackPoint[], origin: Origin): void {
    this.track.visible = points.length > 1;
    if (!this.track.visible) return;
    this.track.geometry.dispose();
    this.track.geometry = new LineGeometry();
    this.track.geometry.setPositions(points.flatMap(([, n, e, d]) => toScene(origin, n, e, d).toArray()));
  }

  // Before each picture.
  scaleTo(camera: THREE.PerspectiveCamera): void {
    const distance = camera.position.distanceTo(this.position);
    this.symbol.scale.setScalar(Math.max(1, (distance * LEAST_SHARE) / LENGTH));
  }
}
