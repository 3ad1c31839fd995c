import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { SceneView } from '#kit/view';

// The camera turns about a point; the vertical scale can be exaggerated.

const FIELD_OF_VIEW = 40; // [deg]
const FILL = 0.86; // of the picture, so that the map is not under the buttons
const LEAST_DISTANCE = 3; // [m]
const UP = new THREE.Vector3(0, 1, 0);
const OBLIQUE = new THREE.Vector3(0.35, 1.05, 0.8).normalize(); // from the south, a little east, looking down
const ABOVE = new THREE.Vector3(0, 1, 0.0001).normalize(); // exactly above has no heading

export class View extends SceneView {
  // Everything with a depth hangs here; its vertical scale is the exaggeration.
  readonly world = new THREE.Group();
  readonly controls: OrbitControls;
  beforeDraw: () => void = () => undefined;
  touched = false; // the user has chosen a view; do not move it

  constructor(canvas: HTMLCanvasElement) {
    super(canvas, FIELD_OF_VIEW, 20_000);
    this.scene.add(this.world);
    this.camera.position.copy(OBLIQUE).multiplyScalar(40);
    this.controls = new OrbitControls(this.camera, canvas);
    this.focus = this.controls.target;
    this.controls.maxPolarAngle = Math.PI * 0.495;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', () => this.draw());
    this.controls.addEventListener('start', () => (this.touched = true));
  }

  protected prepare(): boolean {
    this.beforeDraw();
    return false;
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

  // Where the ray through a pixel meets the level at the height of what the camera looks at.
  pickLevel(x: number, y: number): THREE.Vector3 | null {
    const level = new THREE.Plane(new THREE.Vector3(0, 1, 0), -this.controls.target.y);
    return this.rayAt(x, y).ray.intersectPlane(level, new THREE.Vector3());
  }

  // `box` in the world group's coordinates, without exaggeration.
  fit(box: THREE.Box3, fromAbove = false): void {
    if (box.isEmpty()) return;
    const stretched = box.clone();
    stretched.min.y *= this.exaggeration;
    stretched.max.y *= this.exaggeration;
    const direction = fromAbove ? ABOVE : OBLIQUE;
    const { eye, look } = this.fitted(stretched, direction, UP, FILL);
    this.controls.target.copy(look);
    this.camera.position.copy(look).addScaledVector(direction, Math.max(eye.distanceTo(look), LEAST_DISTANCE));
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
}
