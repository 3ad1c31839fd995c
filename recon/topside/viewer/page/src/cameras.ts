import type { Place } from '#kit/place';

// The pinhole camera with OpenCV's distortion, and which images of a dive saw a place.

export interface CameraModel {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  k1: number;
  k2: number;
  p1: number;
  p2: number;
  k3: number;
}

export type Quaternion = readonly [w: number, x: number, y: number, z: number];

export interface DiveImage extends Place {
  left: string; // file names
  right?: string;
  utc_ns: string;
  q: Quaternion; // T_nav_cam: turns vectors of the camera (x right, y down, z along the view) into nav
  altitude: number | null; // [m]
  footprint: [north: number, east: number, depth: number][];
}

type Vector = [number, number, number];

export function turn([w, x, y, z]: Quaternion, [a, b, c]: Vector): Vector {
  const [ux, uy, uz] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * ux + y * uz - z * uy, b + w * uy + z * ux - x * uz, c + w * uz + x * uy - y * ux];
}
export const inverse = ([w, x, y, z]: Quaternion): Quaternion => [w, -x, -y, -z];

export function inCamera(image: DiveImage, p: Place): Vector {
  return turn(inverse(image.q), [p.north - image.north, p.east - image.east, p.depth - image.depth]);
}

// Where the sensor would be wider than the lens model is good for, the radial polynomial turns back: nothing there is seen.
const WIDEST = 1.5; // tan of the half angle

export interface Pixel {
  u: number; // [px], 0 is the centre of the first column
  v: number;
  range: number; // from the camera to the place [m]
}

export function project(camera: CameraModel, image: DiveImage, p: Place): Pixel | null {
  const [X, Y, Z] = inCamera(image, p);
  if (!(Z > 0.05)) return null;
  const x = X / Z;
  const y = Y / Z;
  const r2 = x * x + y * y;
  if (r2 > WIDEST * WIDEST) return null;
  const radial = 1 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3));
  const dx = x * radial + 2 * camera.p1 * x * y + camera.p2 * (r2 + 2 * x * x);
  const dy = y * radial + camera.p1 * (r2 + 2 * y * y) + 2 * camera.p2 * x * y;
  return { u: camera.fx * dx + camera.cx, v: camera.fy * dy + camera.cy, range: Math.hypot(X, Y, Z) };
}

export interface Sighting extends Pixel {
  index: number; // of the image
  offAxis: number; // distance from the image's centre over the half diagonal, 0 to 1
}

// Beyond this much of the image's altitude (or of this range where the altitude is unknown) the seabed between would hide it.
const FARTHEST_BY_ALTITUDE = 2.5;
const FARTHEST = 12; // [m]

// The images whose frame holds the place, best first: near and in the middle is sharp and bright. Hidden ones are the
// caller's to drop (it has the mesh).
export function imagesThatSaw(camera: CameraModel, images: DiveImage[], p: Place): Sighting[] {
  const seen: Sighting[] = [];
  images.forEach((image, index) => {
    const reach = image.altitude && image.altitude > 0 ? FARTHEST_BY_ALTITUDE * image.altitude : FARTHEST;
    if (Math.abs(image.north - p.north) > reach || Math.abs(image.east - p.east) > reach) return;
    const pixel = project(camera, image, p);
    if (!pixel || pixel.range > reach) return;
    if (pixel.u < 0 || pixel.v < 0 || pixel.u > camera.width - 1 || pixel.v > camera.height - 1) return;
    const offAxis = Math.hypot(pixel.u - camera.width / 2, pixel.v - camera.height / 2) / (Math.hypot(camera.width, camera.height) / 2);
    seen.push({ ...pixel, index, offAxis });
  });
  return seen.sort((a, b) => a.range * (1 + a.offAxis) - b.range * (1 + b.offAxis) || a.index - b.index);
}

// Half the field of view from the centre to the top edge [rad]: how a camera of the scene must look to show the same.
export const halfHeightAngle = (camera: CameraModel): number => Math.atan(camera.height / 2 / camera.fy);
