import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';

// Camera, light and drawing on demand: nothing is drawn while nothing changes.

const FIELD_OF_VIEW = 40; // [deg]
const FILL = 0.86; // of the picture, so that the map does not lie under the buttons
const LEAST_DISTANCE = 3; // [m]
const OBLIQUE = new THREE.Vector3(0.35, 1.05, 0.8).normalize(); // from the south, a little east, looking down

export class View {
  readonly scene = new THREE.Scene();
  readonly camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.1, 20000);
  readonly controls: OrbitControls;
  beforeDraw: () => void = () => undefined;
  touched = false; // the user has chosen a view; do not move it
  private renderer: THREE.WebGLRenderer;
  private queued = false;
  private sun = new THREE.DirectionalLight(0xffffff);
  private sky = new THREE.HemisphereLight(0xffffff, 0xb0bac2);

  constructor(private canvas: HTMLCanvasElement) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene.background = new THREE.Color(0x0d1419);
    this.sun.position.set(-1, 1.1, -1); // from the north-west, as maps are shaded
    this.scene.add(this.sun, this.sky);
    this.setRelief(true);
    this.camera.position.copy(OBLIQUE).multiplyScalar(40);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = Math.PI * 0.495;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener('change', () => this.draw());
    this.controls.addEventListener('start', () => (this.touched = true));
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement!);
    this.resize();
  }

  // Strong hill shading for ramps; little for photographs, which bring their own light.
  setRelief(strong: boolean): void {
    this.sun.intensity = strong ? 2.4 : 0.9;
    this.sky.intensity = strong ? 1.2 : 2.6;
    this.draw();
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
      this.beforeDraw();
      this.renderer.render(this.scene, this.camera);
    });
  }

  fit(box: THREE.Box3, fromAbove = false): void {
    if (box.isEmpty()) return;
    const centre = box.getCenter(new THREE.Vector3());
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).add(fromAbove ? new THREE.Vector3(0, 1, 0.0001) : OBLIQUE);
    this.camera.lookAt(centre);
    // The nearest distance from which every corner of the box is inside the picture.
    const turn = this.camera.quaternion.clone().invert();
    const vertical = Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2)) * FILL;
    let distance = LEAST_DISTANCE;
    for (let corner = 0; corner < 8; ++corner) {
      const p = new THREE.Vector3(
        corner & 1 ? box.max.x : box.min.x, corner & 2 ? box.max.y : box.min.y, corner & 4 ? box.max.z : box.min.z,
      ).sub(centre).applyQuaternion(turn);
      distance = Math.max(distance, p.z + Math.abs(p.x) / (vertical * this.camera.aspect), p.z + Math.abs(p.y) / vertical);
    }
    this.camera.position.sub(centre).multiplyScalar(distance).add(centre);
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
