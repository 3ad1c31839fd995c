import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';

// Camera and drawing on demand: nothing is drawn while nothing changes.

const FIELD_OF_VIEW = 40; // [deg]
const FILL = 0.86; // of the picture, so that the map does not lie under the buttons
const LEAST_DISTANCE = 3; // [m]
const OBLIQUE = new THREE.Vector3(0.35, 1.05, 0.8).normalize(); // from the south, a little east, looking down
const SMOOTHING = 0.1; // of the time a frame takes, as shown

export class View {
  readonly scene = new THREE.Scene();
  // Everything with a depth hangs here; its vertical scale is the exaggeration.
  readonly world = new THREE.Group();
  readonly camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.1, 20000);
  readonly controls: OrbitControls;
  beforeDraw: () => void = () => undefined;
  touched = false; // the user has chosen a view; do not move it
  frameTime = 0; // the main thread's work for a frame, smoothed [ms]
  frames = 0;
  private renderer: THREE.WebGLRenderer;
  private queued = false;

  constructor(private canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene.background = new THREE.Color(0x0b1217);
    this.scene.add(this.world);
    this.camera.position.copy(OBLIQUE).multiplyScalar(40);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = Math.PI * 0.495;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', () => this.draw());
    this.controls.addEventListener('start', () => (this.touched = true));
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement!);
    this.resize();
  }

  get exaggeration(): number {
    return this.world.scale.y;
  }
  set exaggeration(factor: number) {
    // What the camera looks at stays in the middle.
    const shift = this.controls.target.y * (factor / this.world.scale.y - 1);
    this.world.scale.y = factor;
    this.world.updateMatrixWorld(true);
    this.controls.target.y += shift;
    this.camera.position.y += shift;
    this.controls.update();
    this.draw();
  }

  get drawn(): { triangles: number; calls: number; geometries: number } {
    const { render, memory } = this.renderer.info;
    return { triangles: render.triangles, calls: render.calls, geometries: memory.geometries };
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas.parentElement!;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / Math.max(clientHeight, 1);
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw(): void {
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame(() => {
      this.queued = false;
      const begun = performance.now();
      this.beforeDraw();
      this.renderer.render(this.scene, this.camera);
      const took = performance.now() - begun;
      this.frameTime = this.frames++ === 0 ? took : this.frameTime + SMOOTHING * (took - this.frameTime);
    });
  }

  // Where the ray through a pixel of the canvas meets one of these objects.
  pick(x: number, y: number, objects: THREE.Object3D[]): THREE.Vector3 | null {
    const hit = this.rayAt(x, y).intersectObjects(objects, true)[0];
    return hit ? hit.point : null;
  }

  // Where it meets the level at the height of what the camera looks at.
  pickLevel(x: number, y: number): THREE.Vector3 | null {
    const level = new THREE.Plane(new THREE.Vector3(0, 1, 0), -this.controls.target.y);
    return this.rayAt(x, y).ray.intersectPlane(level, new THREE.Vector3());
  }

  private rayAt(x: number, y: number): THREE.Raycaster {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(((x - left) / width) * 2 - 1, 1 - ((y - top) / height) * 2), this.camera);
    return ray;
  }

  // `box` in the world group's coordinates, without exaggeration.
  fit(box: THREE.Box3, fromAbove = false): void {
    if (box.isEmpty()) return;
    const stretched = box.clone();
    stretched.min.y *= this.exaggeration;
    stretched.max.y *= this.exaggeration;
    const centre = stretched.getCenter(new THREE.Vector3());
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).add(fromAbove ? new THREE.Vector3(0, 1, 0.0001) : OBLIQUE);
    this.camera.lookAt(centre);
    const corners = Array.from({ length: 8 }, (_, corner) => new THREE.Vector3(
      corner & 1 ? stretched.max.x : stretched.min.x,
      corner & 2 ? stretched.max.y : stretched.min.y,
      corner & 4 ? stretched.max.z : stretched.min.z,
    ));
    // The nearest distance from which every corner of the box is inside the picture.
    const turn = this.camera.quaternion.clone().invert();
    const vertical = Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2)) * FILL;
    let distance = LEAST_DISTANCE;
    for (const corner of corners) {
      const p = corner.clone().sub(centre).applyQuaternion(turn);
      distance = Math.max(distance, p.z + Math.abs(p.x) / (vertical * this.camera.aspect), p.z + Math.abs(p.y) / vertical);
    }
    this.camera.position.sub(centre).multiplyScalar(distance).add(centre);
    // The near side looks larger, so that the box is not in the middle yet: slide and come closer.
    for (let round = 0; round < 4; ++round) {
      this.camera.updateMatrixWorld(true);
      const shown = new THREE.Box3().setFromPoints(corners.map((corner) => corner.clone().project(this.camera)));
      const size = shown.getSize(new THREE.Vector3());
      const middle = shown.getCenter(new THREE.Vector3());
      const away = this.camera.position.distanceTo(this.controls.target);
      const half = away * Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2));
      const slide = new THREE.Vector3(middle.x * half * this.camera.aspect, middle.y * half, 0).applyQuaternion(this.camera.quaternion);
      const closer = Math.max(size.x, size.y) / (2 * FILL);
      this.controls.target.add(slide);
      this.camera.position.add(slide).sub(this.controls.target).multiplyScalar(Math.max(closer, LEAST_DISTANCE / away)).add(this.controls.target);
    }
    this.controls.update();
    this.draw();
  }

  moveTo(target: THREE.Vector3): void {
    const shift = target.clone().sub(this.controls.target);
    this.camera.position.add(shift);
    this.controls.target.copy(target);
    this.controls.update();
    this.draw();
  }

  // Metres a screen pixel spans at the point the camera turns about.
  metresPerPixel(): number {
    const distance = this.camera.position.distanceTo(this.controls.target);
    return (2 * distance * Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2))) / Math.max(this.canvas.clientHeight, 1);
  }

  // Angle of north on the screen, clockwise from up [deg].
  northAngle(): number {
    return THREE.MathUtils.radToDeg(this.controls.getAzimuthalAngle());
  }
}
