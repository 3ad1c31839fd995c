import { EnvironmentControls } from '3d-tiles-renderer/three';
import * as THREE from 'three';
import { Flight, type Pose } from './flight';

// Camera, controls and drawing on demand: nothing is drawn while nothing changes. Drag moves the seafloor under the pointer,
// the wheel zooms to it, the right button or shift turns and tilts about it.

export const FIELD_OF_VIEW = 45; // [deg]
const UP = new THREE.Vector3(0, 1, 0);
const NEAREST = 0.15; // of the camera to the seafloor [m]
const SMOOTHING = 0.1; // of the shown frame time
const KEY_PAN = 0.9; // picture heights a second
const KEY_ZOOM = 2.2; // ratio a second
const KEY_TURN = 1.1; // [rad/s]
const FILL = 0.94; // of the picture by the whole dive
const STEEPEST = 0.02; // from straight down [rad]; exactly down has no heading
const FLATTEST = 1.45; // [rad]

// The tile renderer then looks no further than the nearest tile that is hit.
const firstHit = (ray: THREE.Raycaster): THREE.Raycaster => Object.assign(ray, { firstHitOnly: true });

export class View {
  readonly scene = new THREE.Scene();
  readonly pickable = new THREE.Group(); // what the pointer can touch
  readonly camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.1, 5000);
  readonly renderer: THREE.WebGLRenderer;
  readonly controls: EnvironmentControls;
  // Called in every frame before drawing; gives whether something changed.
  beforeDraw: (moved: boolean) => boolean = () => false;
  afterDraw: () => void = () => undefined;
  onSettled: () => void = () => undefined; // the camera has come to rest
  covered: () => { top: number; bottom: number } = () => ({ top: 0, bottom: 0 }); // by bars over the picture [px]
  home: THREE.Box3 = new THREE.Box3(new THREE.Vector3(-10, -11, -10), new THREE.Vector3(10, -9, 10));
  frameTime = 0; // the main thread's work for a drawn frame, smoothed [ms]
  workTimes: number[] = []; // of the last frames [ms]
  calls = 0;
  triangles = 0;
  focus = new THREE.Vector3(); // the point looked at
  private dirty = true;
  private flight: { flight: Flight; begun: number; done?: () => void } | null = null;
  private keys = new Set<string>();
  private last = new THREE.Matrix4();
  private lastTime = 0;
  private movedAt = 0;
  private settled = true;

  constructor(readonly canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, powerPreference: 'high-performance' });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene.background = new THREE.Color(0x0b1217);
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
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement!);
    this.resize();
    window.addEventListener('keydown', (e) => this.key(e, true));
    window.addEventListener('keyup', (e) => this.key(e, false));
    window.addEventListener('blur', () => this.keys.clear());
    const loop = (time: number): void => {
      requestAnimationFrame(loop);
      this.frame(time);
    };
    requestAnimationFrame(loop);
  }

  draw(): void {
    this.dirty = true;
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas.parentElement!;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / Math.max(clientHeight, 1);
    this.camera.updateProjectionMatrix();
    this.last.identity();
    this.draw();
  }

  // The height of what lies in the middle decides the plane that catches rays beside the model.
  setLevel(y: number): void {
    this.controls.fallbackPlane.set(UP, -y);
  }

  private frame(time: number): void {
    const begun = performance.now();
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
      this.last.copy(this.camera.matrixWorld);
      this.movedAt = time;
      this.settled = false;
      this.setClipping();
    } else if (!this.settled && time - this.movedAt > 200) {
      this.settled = true;
      this.focus = this.centre() ?? this.focus;
      this.onSettled();
      this.dirty = true;
    }
    const changed = this.beforeDraw(moved);
    if (!moved && !changed && !this.dirty) return;
    this.dirty = false;
    this.renderer.info.autoReset = true;
    this.renderer.render(this.scene, this.camera);
    this.calls = this.renderer.info.render.calls;
    this.triangles = this.renderer.info.render.triangles;
    this.afterDraw();
    const took = performance.now() - begun;
    this.frameTime += SMOOTHING * (took - this.frameTime);
    this.workTimes.push(took);
    if (this.workTimes.length > 600) this.workTimes.splice(0, 300);
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

  rayAt(x: number, y: number): THREE.Raycaster {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const ray = firstHit(new THREE.Raycaster());
    ray.setFromCamera(new THREE.Vector2(((x - left) / width) * 2 - 1, 1 - ((y - top) / height) * 2), this.camera);
    return ray;
  }

  // Where the ray through a pixel (client coordinates) meets the model.
  pick(x: number, y: number): THREE.Vector3 | null {
    const hits = this.rayAt(x, y).intersectObject(this.pickable, true);
    return hits.sort((a, b) => a.distance - b.distance)[0]?.point ?? null;
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

  pose(): Pose {
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
  wholeView(fromAbove: boolean): { eye: THREE.Vector3; look: THREE.Vector3; up: THREE.Vector3 } {
    const look = this.home.getCenter(new THREE.Vector3());
    const size = this.home.getSize(new THREE.Vector3());
    const direction = fromAbove ? new THREE.Vector3(0, 1, 0) : new THREE.Vector3(0, 1, 0.6).normalize();
    const [width, height] = [this.canvas.clientWidth, Math.max(this.canvas.clientHeight, 1)];
    const { top, bottom } = this.covered();
    const up = fromAbove ? new THREE.Vector3(0, 0, -1) : UP;
    const tan = Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2));
    const corners = Array.from({ length: 8 }, (_, i) => new THREE.Vector3(i & 1 ? this.home.max.x : this.home.min.x, i & 2 ? this.home.max.y : this.home.min.y, i & 4 ? this.home.max.z : this.home.min.z));
    const camera = this.camera.clone();
    let distance = Math.max(size.length(), 2);
    // The near side looks larger, so that the box is not in the middle at once: slide and come closer.
    for (let round = 0; round < 6; ++round) {
      camera.position.copy(look).addScaledVector(direction, distance);
      camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().lookAt(camera.position, look, up));
      camera.updateMatrixWorld(true);
      const shown = new THREE.Box3().setFromPoints(corners.map((corner) => corner.clone().project(camera)));
      // The free part of the picture, from -1 to 1.
      const [low, high] = [-1 + (2 * bottom) / height, 1 - (2 * top) / height];
      const middle = shown.getCenter(new THREE.Vector3());
      const slide = new THREE.Vector3(middle.x * (width / height), middle.y - (low + high) / 2, 0).multiplyScalar(distance * tan).applyQuaternion(camera.quaternion);
      look.add(slide);
      distance *= Math.max((shown.max.x - shown.min.x) / (2 * FILL), (shown.max.y - shown.min.y) / ((high - low) * FILL));
    }
    return { eye: look.clone().addScaledVector(direction, distance), look, up };
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
    const inField = event.target instanceof HTMLElement && /^(INPUT|TEXTAREA|SELECT)$/.test(event.target.tagName);
    if (down && (inField || event.ctrlKey || event.metaKey || event.altKey)) return;
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

  // Metres a screen pixel spans at the point looked at.
  metresPerPixel(): number {
    return (2 * this.camera.position.distanceTo(this.focus) * Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2))) / Math.max(this.canvas.clientHeight, 1);
  }

  // Where north points on the screen, clockwise from up [deg].
  northAngle(): number {
    const right = new THREE.Vector3(1, 0, 0).applyQuaternion(this.camera.quaternion);
    return THREE.MathUtils.radToDeg(Math.atan2(-right.z, right.x)) * -1;
  }
}
