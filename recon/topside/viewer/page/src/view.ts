import { EnvironmentControls } from '3d-tiles-renderer/three';
import * as THREE from 'three';
import { takesKeys } from '#kit/overlay';
import { SceneView, firstHit, type Standpoint } from '#kit/view';
import { Flight } from './flight';

// Camera and controls: drag moves the seafloor under the pointer, the wheel zooms to it, the right button or shift turns and
// tilts about it.

const FIELD_OF_VIEW = 45; // [deg]
const UP = new THREE.Vector3(0, 1, 0);
const NEAREST = 0.15; // of the camera to the seafloor [m]
const KEY_PAN = 0.9; // picture heights a second
const KEY_ZOOM = 2.2; // ratio a second
const KEY_TURN = 1.1; // [rad/s]
const FILL = 0.94; // of the picture by the whole dive
const STEEPEST = 0.02; // from straight down [rad]; exactly down has no heading
const FLATTEST = 1.45; // [rad]

export class View extends SceneView {
  readonly controls: EnvironmentControls;
  // Called in every frame before drawing; gives whether something changed.
  beforeDraw: (moved: boolean) => boolean = () => false;
  onSettled: () => void = () => undefined; // the camera has come to rest
  covered: () => { top: number; bottom: number } = () => ({ top: 0, bottom: 0 }); // by bars over the picture [px]
  home: THREE.Box3 = new THREE.Box3(new THREE.Vector3(-10, -11, -10), new THREE.Vector3(10, -9, 10));
  private flight: { flight: Flight; begun: number; done?: () => void } | null = null;
  private keys = new Set<string>();
  private last = new THREE.Matrix4();
  private lastTime = 0;
  private movedAt = 0;
  private settled = true;

  constructor(canvas: HTMLCanvasElement) {
    super(canvas, FIELD_OF_VIEW, 5000);
    this.scene.add(this.pickable);
    this.camera.position.set(0, 20, 20);
    this.controls = new EnvironmentControls(this.pickable, this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.adjustHeight = false;
    this.controls.minDistance = NEAREST;
    this.controls.maxDistance = 50_000;
    this.controls.cameraRadius = NEAREST;
    this.controls.minAltitude = 0;
    this.controls.maxAltitude = FLATTEST;
    this.controls.addEventListener('start', () => this.stopFlight());
    window.addEventListener('keydown', (e) => this.key(e, true));
    window.addEventListener('keyup', (e) => this.key(e, false));
    window.addEventListener('blur', () => this.keys.clear());
  }

  protected override resized(): void {
    this.last.identity();
  }

  // The height of what is in the middle decides the plane that catches rays beside the model.
  setLevel(y: number): void {
    this.controls.fallbackPlane.set(UP, -y);
  }

  protected prepare(time: number): boolean {
    const seconds = Math.min((time - this.lastTime) / 1000, 0.1);
    this.lastTime = time;
    if (this.flight) this.fly(time);
    else {
      if (this.keys.size > 0) this.steer(seconds);
      this.controls.update(Math.max(seconds, 1e-3));
    }
    this.camera.updateMatrixWorld();
    const moved = !this.camera.matrixWorld.equals(this.last);
    if (moved) {
      this.move(true, time);
      this.last.copy(this.camera.matrixWorld);
      this.movedAt = time;
      this.settled = false;
      this.setClipping();
    } else if (!this.settled && time - this.movedAt > 200) {
      this.settled = true;
      this.move(false, time);
      this.focus = this.centre() ?? this.focus;
      this.onSettled();
      this.draw();
    }
    if (this.beforeDraw(moved) || moved) this.draw();
    return true;
  }

  get height(): number {
    return Math.max(this.camera.position.y + this.controls.fallbackPlane.constant, NEAREST);
  }

  private setClipping(): void {
    const far = this.camera.position.distanceTo(this.home.getCenter(new THREE.Vector3())) + this.home.getSize(new THREE.Vector3()).length();
    this.camera.near = Math.min(Math.max(0.03 * this.focusDistance(), 0.02), 100);
    this.camera.far = Math.max(far * 1.5, this.camera.near * 1000);
    this.camera.updateProjectionMatrix();
  }

  focusDistance(): number {
    return Math.max(Math.min(this.camera.position.distanceTo(this.focus), 4 * this.height + 1), NEAREST);
  }

  private centre(): THREE.Vector3 | null {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    return this.pick(left + width / 2, top + height / 2) ?? this.rayAt(left + width / 2, top + height / 2).ray.intersectPlane(this.controls.fallbackPlane, new THREE.Vector3());
  }

  // The seafloor straight below or above a place, or null.
  heightAt(east: number, south: number): number | null {
    const ray = firstHit(new THREE.Raycaster(new THREE.Vector3(east, this.home.max.y + 100, south), new THREE.Vector3(0, -1, 0)));
    const hits = ray.intersectObject(this.pickable, true);
    return hits.sort((a, b) => a.distance - b.distance)[0]?.point.y ?? null;
  }

  pose(): Standpoint {
    this.focus = this.centre() ?? this.focus;
    return { eye: this.camera.position.clone(), look: this.focus.clone(), up: new THREE.Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion) };
  }

  setPose(eye: THREE.Vector3, look: THREE.Vector3, up = UP): void {
    this.stopFlight();
    this.camera.position.copy(eye);
    this.camera.up.copy(UP);
    this.focus.copy(look);
    this.camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().lookAt(eye, look, up));
    this.controls.resetState();
    this.draw();
  }

  flyTo(eye: THREE.Vector3, look: THREE.Vector3, up: THREE.Vector3 = UP, done?: () => void): void {
    this.flight = { flight: new Flight(this.pose(), { eye, look, up }), begun: performance.now(), done };
    this.controls.enabled = false;
  }
  get flying(): boolean {
    return this.flight !== null;
  }
  private stopFlight(): void {
    this.flight = null;
    this.controls.enabled = true;
  }
  private fly(time: number): void {
    const { flight, begun, done } = this.flight!;
    const t = (time - begun) / 1000 / flight.seconds;
    const { eye, look, turn } = flight.at(t);
    this.camera.position.copy(eye);
    this.camera.quaternion.copy(turn);
    this.focus.copy(look);
    if (t < 1) return;
    this.stopFlight();
    done?.();
  }

  // The whole of `home` in the part of the picture that no bar covers: obliquely from the south, or from above.
  wholeView(fromAbove: boolean): Standpoint {
    const direction = fromAbove ? new THREE.Vector3(0, 1, 0) : new THREE.Vector3(0, 1, 0.6).normalize();
    const { top, bottom } = this.covered();
    const height = Math.max(this.canvas.clientHeight, 1);
    return this.fitted(this.home, direction, fromAbove ? new THREE.Vector3(0, 0, -1) : UP, FILL, -1 + (2 * bottom) / height, 1 - (2 * top) / height);
  }

  flyAbove(point: THREE.Vector3, distance: number): void {
    const away = new THREE.Vector3(0, 0, 1).applyQuaternion(this.camera.quaternion);
    if (away.y < 0.5) away.set(away.x, 1, away.z).normalize();
    this.flyTo(point.clone().addScaledVector(away, distance), point, new THREE.Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion));
  }

  northUp(): void {
    const { eye, look } = this.pose();
    const distance = eye.distanceTo(look);
    this.flyTo(look.clone().add(new THREE.Vector3(0, distance, 0)), look, new THREE.Vector3(0, 0, -1));
  }

  private key(event: KeyboardEvent, down: boolean): void {
    if (down && (takesKeys(event.target) || event.ctrlKey || event.metaKey || event.altKey)) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!/^(Arrow(Up|Down|Left|Right)|PageUp|PageDown|[wasdqerf+\-=])$/.test(key)) return;
    if (down) {
      this.stopFlight();
      this.keys.add(key);
      event.preventDefault();
    } else this.keys.delete(key);
  }

  // Keys: arrows or WASD move, + and - zoom, Q and E turn, R and F tilt.
  private steer(seconds: number): void {
    const any = (...names: string[]): number => (names.some((n) => this.keys.has(n)) ? 1 : 0);
    const camera = this.camera;
    const distance = this.focusDistance();
    const right = new THREE.Vector3(1, 0, 0).applyQuaternion(camera.quaternion).setY(0).normalize();
    const ahead = new THREE.Vector3().crossVectors(UP, right);
    const step = KEY_PAN * seconds * 2 * distance * Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2));
    const slide = right.clone().multiplyScalar(step * (any('ArrowRight', 'd') - any('ArrowLeft', 'a')))
      .addScaledVector(ahead, step * (any('ArrowUp', 'w') - any('ArrowDown', 's')));
    camera.position.add(slide);
    this.focus.add(slide);
    const away = camera.position.clone().sub(this.focus);
    const zoom = KEY_ZOOM ** (seconds * 2 * (any('-', 'PageDown') - any('+', '=', 'PageUp')));
    away.multiplyScalar(zoom);
    if (away.length() < NEAREST) away.setLength(NEAREST);
    const turn = KEY_TURN * seconds * (any('e') - any('q'));
    const spin = new THREE.Quaternion().setFromAxisAngle(UP, turn);
    away.applyQuaternion(spin);
    camera.quaternion.premultiply(spin);
    const tilt = KEY_TURN * seconds * (any('r') - any('f'));
    if (tilt !== 0) {
      const now = Math.acos(THREE.MathUtils.clamp(away.y / away.length(), -1, 1));
      const by = THREE.MathUtils.clamp(now + tilt, STEEPEST, FLATTEST) - now;
      const lean = new THREE.Quaternion().setFromAxisAngle(right.applyQuaternion(spin), by);
      away.applyQuaternion(lean);
      camera.quaternion.premultiply(lean);
    }
    camera.position.copy(this.focus).add(away);
  }
}
