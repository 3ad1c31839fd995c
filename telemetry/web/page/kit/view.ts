import * as THREE from 'three';

// The picture of a page: renderer, camera, and drawing on demand: nothing is drawn while nothing changes.

const SMOOTHING = 0.1; // of the shown frame time
const FIT_ROUNDS = 6;
const SLOW = 60; // [ms] between frames of a moving picture
const SLOW_FRAMES = 4; // in a row, before it is drawn coarser until it stands still
const COARSER = [1, 1 / 2, 1 / 3]; // pixels in each direction

// The tile renderer then looks no further than the nearest tile that is hit.
export const firstHit = (ray: THREE.Raycaster): THREE.Raycaster => Object.assign(ray, { firstHitOnly: true });

export interface Standpoint {
  eye: THREE.Vector3;
  look: THREE.Vector3; // the point looked at
  up: THREE.Vector3;
}

export abstract class SceneView {
  readonly scene = new THREE.Scene();
  readonly camera: THREE.PerspectiveCamera;
  readonly renderer: THREE.WebGLRenderer;
  pickable: THREE.Object3D = new THREE.Group(); // what the pointer can touch
  focus = new THREE.Vector3(); // the point looked at
  afterDraw: () => void = () => undefined;
  frameTime = 0; // the main thread's work for a drawn frame, smoothed [ms]
  calls = 0; // of the last frame
  triangles = 0;
  private frames = 0;
  private dirty = true;
  private moving = false;
  private lastMove = -Infinity; // [ms]
  private slow = 0; // frames in a row
  private coarser = 0; // place in COARSER, of a moving picture
  private queued = false;

  // Angles in degrees, lengths in metres.
  constructor(readonly canvas: HTMLCanvasElement, fieldOfView: number, farthest: number) {
    this.camera = new THREE.PerspectiveCamera(fieldOfView, 1, 0.1, farthest);
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, powerPreference: 'high-performance' });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene.background = new THREE.Color(0x0b1217);
    this.resize();
    new ResizeObserver(() => {
      this.resize();
      this.resized();
    }).observe(canvas.parentElement!);
  }

  // At the beginning of each frame; returns whether frames continue without being asked for.
  protected abstract prepare(time: number): boolean;
  protected resized(): void {}

  draw(): void {
    this.dirty = true;
    this.wake();
  }

  // Said in a frame in which the picture has moved, and once when it stands still. Where no GPU draws it, it is coarse while it moves.
  protected move(moving: boolean, time: number): void {
    if (moving && this.moving && this.coarser < COARSER.length - 1) {
      this.slow = time - this.lastMove > SLOW ? this.slow + 1 : 0;
      if (this.slow === SLOW_FRAMES) {
        this.slow = 0;
        ++this.coarser;
      }
    }
    this.lastMove = time;
    this.moving = moving;
    this.setResolution(COARSER[moving ? this.coarser : 0]!);
  }
  private setResolution(share: number): void {
    const ratio = Math.min(window.devicePixelRatio, 2) * share;
    if (ratio === this.renderer.getPixelRatio()) return;
    this.renderer.setPixelRatio(ratio);
    this.draw();
  }

  private wake(): void {
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame((time) => {
      this.queued = false;
      this.frame(time);
    });
  }

  private frame(time: number): void {
    const begun = performance.now();
    const goesOn = this.prepare(time);
    if (this.dirty) {
      this.dirty = false;
      this.renderer.render(this.scene, this.camera);
      ({ calls: this.calls, triangles: this.triangles } = this.renderer.info.render);
      this.afterDraw();
      const took = performance.now() - begun;
      this.frameTime = this.frames++ === 0 ? took : this.frameTime + SMOOTHING * (took - this.frameTime);
    }
    if (goesOn) this.wake();
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas.parentElement!;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / Math.max(clientHeight, 1);
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  // Through a pixel, in the window's coordinates.
  rayAt(x: number, y: number): THREE.Raycaster {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const ray = firstHit(new THREE.Raycaster());
    ray.setFromCamera(new THREE.Vector2(((x - left) / width) * 2 - 1, 1 - ((y - top) / height) * 2), this.camera);
    return ray;
  }
  pick(x: number, y: number): THREE.Vector3 | null {
    const hits = this.rayAt(x, y).intersectObject(this.pickable, true);
    return hits.sort((a, b) => a.distance - b.distance)[0]?.point ?? null;
  }

  private get tanHalf(): number {
    return Math.tan(THREE.MathUtils.degToRad(this.camera.fov / 2));
  }

  // What a screen pixel spans at the point looked at [m].
  metresPerPixel(): number {
    return (2 * this.camera.position.distanceTo(this.focus) * this.tanHalf) / Math.max(this.canvas.clientHeight, 1);
  }

  // Where north points on the screen, clockwise from up [deg].
  northAngle(): number {
    const right = new THREE.Vector3(1, 0, 0).applyQuaternion(this.camera.quaternion);
    return THREE.MathUtils.radToDeg(Math.atan2(-right.z, right.x));
  }

  // From where, along `direction`, the box fills the share `fill` of the picture between the heights `low` and `high` (-1 is the
  // picture's lower edge, 1 its upper one).
  fitted(box: THREE.Box3, direction: THREE.Vector3, up: THREE.Vector3, fill: number, low = -1, high = 1): Standpoint {
    const look = box.getCenter(new THREE.Vector3());
    const corners = Array.from({ length: 8 }, (_, i) => new THREE.Vector3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z));
    const camera = this.camera.clone();
    let distance = Math.max(box.getSize(new THREE.Vector3()).length(), 2);
    // The near side looks larger, so that the box is not in the middle at once: slide and come closer.
    for (let round = 0; round < FIT_ROUNDS; ++round) {
      camera.position.copy(look).addScaledVector(direction, distance);
      camera.quaternion.setFromRotationMatrix(new THREE.Matrix4().lookAt(camera.position, look, up));
      camera.updateMatrixWorld(true);
      const shown = new THREE.Box3().setFromPoints(corners.map((corner) => corner.clone().project(camera)));
      const middle = shown.getCenter(new THREE.Vector3());
      const slide = new THREE.Vector3(middle.x * camera.aspect, middle.y - (low + high) / 2, 0);
      look.add(slide.multiplyScalar(distance * this.tanHalf).applyQuaternion(camera.quaternion));
      distance *= Math.max((shown.max.x - shown.min.x) / (2 * fill), (shown.max.y - shown.min.y) / ((high - low) * fill));
    }
    return { eye: look.clone().addScaledVector(direction, distance), look, up };
  }
}
