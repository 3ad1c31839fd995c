import * as THREE from 'three';
import { Polyline } from '#kit/lines';
import { toScene, type Place } from '#kit/place';
import type { TrackPoint, VehicleStatus } from './api';

// The vehicle, the line down to the seafloor below it, how well its position is known, and its track. Everything is in
// the exaggerated scene; the symbol undoes the exaggeration for itself.

const TRACK_COLOUR = 0xf0b95e;
const VEHICLE_COLOUR = 0xffe0a8;
const LENGTH = 2; // of the symbol [m]
const LEAST_SHARE = 0.024; // of the distance to the camera: the symbol never gets too small to see
const RING_POINTS = 64;

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

function ring(): THREE.BufferGeometry {
  const points = Array.from({ length: RING_POINTS + 1 }, (_, i) => {
    const angle = (2 * Math.PI * i) / RING_POINTS;
    return new THREE.Vector3(Math.sin(angle), 0, Math.cos(angle));
  });
  return new THREE.BufferGeometry().setFromPoints(points);
}

export class Vehicle {
  readonly group = new THREE.Group();
  private symbol = new THREE.Mesh(dart(), new THREE.MeshBasicMaterial({ color: VEHICLE_COLOUR }));
  private plumb = new THREE.Line(
    new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3(0, -1, 0)]),
    new THREE.LineBasicMaterial({ color: VEHICLE_COLOUR, transparent: true, opacity: 0.55 }),
  );
  // One standard deviation about the vehicle: the link carries one number for both horizontal axes, so it is a circle.
  private sigma = new THREE.Line(ring(), new THREE.LineBasicMaterial({ color: VEHICLE_COLOUR, transparent: true, opacity: 0.9 }));
  private disc = new THREE.Mesh(
    new THREE.CircleGeometry(1, RING_POINTS).rotateX(-Math.PI / 2),
    new THREE.MeshBasicMaterial({ color: VEHICLE_COLOUR, transparent: true, opacity: 0.16, depthWrite: false, side: THREE.DoubleSide }),
  );
  readonly trackBox = new THREE.Box3(); // without exaggeration
  private track = new Polyline({ color: TRACK_COLOUR, linewidth: 1.3, opacity: 0.75 });
  readonly position = new THREE.Vector3(); // without exaggeration

  constructor() {
    this.group.add(this.symbol, this.plumb, this.sigma, this.disc, this.track.object);
    this.group.visible = false;
  }

  setStatus(status: VehicleStatus, origin: Place): void {
    this.group.visible = true;
    this.position.copy(toScene({ north: status.north_m, east: status.east_m, depth: status.depth_m }, origin));
    this.symbol.position.copy(this.position);
    this.symbol.rotation.y = -THREE.MathUtils.degToRad(status.heading_deg);
    this.plumb.position.copy(this.position);
    this.plumb.scale.y = status.altitude_m ?? 0;
    for (const part of [this.sigma, this.disc]) {
      part.visible = status.position_sigma_m !== null;
      part.position.copy(this.position);
      part.scale.setScalar(status.position_sigma_m ?? 1);
    }
  }

  setTrack(points: TrackPoint[], origin: Place): void {
    const places = points.map(([, north, east, depth]) => ({ north, east, depth }));
    this.track.set(places, false, origin);
    this.trackBox.setFromPoints(places.map((place) => toScene(place, origin)));
  }

  set trackShown(shown: boolean) {
    this.track.object.visible = shown;
  }

  clear(): void {
    this.group.visible = false;
    this.track.set([]);
    this.trackBox.makeEmpty();
  }

  // Before each picture.
  scaleTo(camera: THREE.PerspectiveCamera, exaggeration: number): void {
    const distance = camera.position.distanceTo(this.group.localToWorld(this.position.clone()));
    const size = Math.max(1, (distance * LEAST_SHARE) / LENGTH);
    this.symbol.scale.set(size, size / exaggeration, size);
  }
}
