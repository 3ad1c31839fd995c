// Completes the synthetic tiles of `example_tiles FOLDER/topside/tiles` to a dive: scene, track, images, layers, original
// images (12-bit Bayer TIFF) and files to bring along. What the camera sees is the same seafloor that the tiles show.
//   node make_dive.mjs FOLDER
import { mkdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import process from 'node:process';
import { localKeys, writeTiff } from './tiff.mjs';

const folder = process.argv[2];
if (!folder) {
  console.error('usage: make_dive.mjs FOLDER');
  process.exit(2);
}
const ORIGIN = { latitude: -28.8, longitude: 113.9 };
const EDGE = 33.792; // of the model [m]
const CAMERA = { width: 340, height: 256, fx: 431.35, fy: 430.8, cx: 171.7, cy: 126.9, k1: 0.142, k2: 0.655, p1: 0.0021, p2: -0.0013, k3: 0 };
const ALTITUDE = 2; // [m]
const LINES = 22;
const EVERY = 0.8; // metre between images
const PIXELS_WITHIN = { north: [8, 24], east: [13, 21] }; // of the images that are there: the test stays small
const START = 1_790_000_000; // [s]

// The seafloor of the synthetic tiles.
const depth = (n, e) => 20 + 1.5 * Math.sin(0.11 * n + 0.3) * Math.cos(0.09 * e) + 0.25 * Math.sin(0.9 * n + 0.7 * e) + 0.05 * Math.sin(5.1 * n) * Math.sin(4.3 * e);
function colour(n, e) {
  const coarse = Math.sin(0.8 * n) * Math.sin(0.6 * e);
  const fine = Math.sin(31 * n + 9 * e) * Math.sin(27 * e - 11 * n);
  return [130 + 60 * coarse + 25 * fine, 120 + 25 * coarse - 30 * fine, 90 - 50 * coarse + 15 * fine];
}

const product = ([w, x, y, z], [a, b, c, d]) => [w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c, w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a];
const turned = (q, [x, y, z]) => product(product(q, [0, x, y, z]), [q[0], -q[1], -q[2], -q[3]]).slice(1);

// The ray of a pixel: undistorts by fixed-point steps.
function ray(u, v) {
  const { fx, fy, cx, cy, k1, k2, p1, p2 } = CAMERA;
  const [dx, dy] = [(u - cx) / fx, (v - cy) / fy];
  let [x, y] = [dx, dy];
  for (let i = 0; i < 12; ++i) {
    const r2 = x * x + y * y;
    const radial = 1 + r2 * (k1 + r2 * k2);
    [x, y] = [(dx - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial, (dy - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial];
  }
  return [x, y, 1];
}
function ground(image, u, v) {
  const d = turned(image.q, ray(u, v));
  let t = ALTITUDE;
  for (let i = 0; i < 12; ++i) t += (depth(image.north + t * d[0], image.east + t * d[1]) - (image.depth + t * d[2])) / d[2];
  return [image.north + t * d[0], image.east + t * d[1], image.depth + t * d[2]];
}
// Light falls off to the corners and red is lost in water, as an original image has it; linear 12-bit counts.
function photograph(image) {
  const { width, height } = CAMERA;
  const samples = new Uint16Array(width * height);
  for (let v = 0; v < height; ++v)
    for (let u = 0; u < width; ++u) {
      const [n, e, d] = ground(image, u, v);
      const range = Math.hypot(n - image.north, e - image.east, d - image.depth);
      const channel = (v % 2) + (u % 2);
      const value = (Math.max(colour(n, e)[channel], 0) / 255) ** 2.2 * [0.45, 1, 0.9][channel] * (ALTITUDE / range) ** 3;
      samples[v * width + u] = Math.min(4095, Math.round(3000 * value + 60));
    }
  return writeTiff(samples, width, height);
}

const out = join(folder, 'topside');
mkdirSync(join(out, 'layers'), { recursive: true });
mkdirSync(join(folder, 'img'), { recursive: true });
mkdirSync(join(folder, 'own'), { recursive: true });

const images = [];
const track = { utc_ns: [], north: [], east: [], depth: [], heading_deg: [], altitude: [], stage: [], temperature_c: [] };
let seconds = START;
const stamp = (utc) => new Date(utc * 1000).toISOString().replace(/[-:]/g, '').replace('T', '_').slice(0, 15) + `_${String(Math.round((utc % 1) * 1000)).padStart(3, '0')}`;
function pass(n, e, heading, stage) {
  const d = depth(n, e) - ALTITUDE;
  track.utc_ns.push(String(BigInt(Math.round(seconds * 1000)) * 1_000_000n));
  track.north.push(n);
  track.east.push(e);
  track.depth.push(stage === 'survey' ? d : d - 6);
  track.heading_deg.push((heading + 360) % 360);
  track.altitude.push(stage === 'survey' ? ALTITUDE + 0.1 * Math.sin(n) : null);
  track.stage.push(stage);
  track.temperature_c.push(18 + 0.4 * Math.sin(e / 9));
  return d;
}
for (let i = 0; i < 20; ++i, seconds += 1) pass(0.7, 0.7, 0, 'descent');
for (let line = 0; line < LINES; ++line) {
  const e = 0.9 + (line * (EDGE - 1.8)) / (LINES - 1);
  const forth = line % 2 === 0;
  for (let s = 0.9; s <= EDGE - 0.9; s += EVERY, seconds += 1.6) {
    const n = forth ? s : EDGE - s;
    const heading = forth ? 0 : 180;
    const d = pass(n, e, heading, 'survey');
    // The camera looks down, its x to starboard: turned about depth by heading + 90 degrees, and rolling a little.
    const half = ((heading + 90) * Math.PI) / 360;
    const q = product([Math.cos(half), 0, 0, Math.sin(half)], [Math.cos(0.02), Math.sin(0.02) * Math.sin(n), 0, 0]);
    const norm = Math.hypot(...q);
    const name = `PR_${stamp(seconds)}`;
    const image = { left: `${name}_LC16.tif`, right: `${name}_RM16.tif`, utc_ns: track.utc_ns.at(-1), north: n, east: e, depth: d, q: q.map((v) => v / norm), altitude: ALTITUDE };
    const { width, height } = CAMERA;
    image.footprint = [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]].map(([u, v]) => ground(image, u, v));
    images.push(image);
    const within = (v, [low, high]) => v > low && v < high;
    if (within(n, PIXELS_WITHIN.north) && within(e, PIXELS_WITHIN.east)) writeFileSync(join(folder, 'img', image.left), photograph(image));
  }
}
for (let i = 0; i < 15; ++i, seconds += 1) pass(EDGE - 0.9, EDGE - 0.9, 0, 'ascent');
writeFileSync(join(out, 'track.json'), JSON.stringify(track));
writeFileSync(join(out, 'images.json'), JSON.stringify({ images, camera: CAMERA }));

// Layers at 6 cm, with a hole in the middle of the west; an RGB picture, and one raster in degrees.
const STEP = 0.06;
const nodes = Math.round(EDGE / STEP);
const height = (r, c) => -depth(EDGE - (r + 0.5) * STEP, (c + 0.5) * STEP);
function layer(value) {
  const samples = new Float32Array(nodes * nodes);
  for (let r = 0; r < nodes; ++r)
    for (let c = 0; c < nodes; ++c) samples[r * nodes + c] = Math.hypot(EDGE - r * STEP - 17, c * STEP - 4) < 1.5 ? NaN : value(r, c);
  return writeTiff(samples, nodes, nodes, 1, { scale: STEP, north: EDGE, west: 0, keys: localKeys(ORIGIN.latitude, ORIGIN.longitude), noData: 'nan' });
}
const slope = (r, c) => (Math.atan(Math.hypot(height(r, c + 1) - height(r, c - 1), height(r + 1, c) - height(r - 1, c)) / (2 * STEP)) * 180) / Math.PI;
writeFileSync(join(out, 'layers', 'elevation.tif'), layer(height));
writeFileSync(join(out, 'layers', 'slope.tif'), layer(slope));
writeFileSync(join(out, 'layers', 'uncertainty.tif'), layer((r, c) => 0.004 + 0.003 * Math.sin(r / 20) * Math.sin(c / 31)));
const mosaic = new Uint8Array(nodes * nodes * 4);
for (let r = 0; r < nodes; ++r)
  for (let c = 0; c < nodes; ++c) mosaic.set([...colour(EDGE - (r + 0.5) * STEP, (c + 0.5) * STEP).map((v) => Math.min(Math.max(v, 0), 255)), 255], 4 * (r * nodes + c));
writeFileSync(join(out, 'layers', 'orthomosaic.tif'), writeTiff(mosaic, nodes, nodes, 4, { scale: STEP, north: EDGE, west: 0, keys: localKeys(ORIGIN.latitude, ORIGIN.longitude) }));

writeFileSync(join(out, 'scene.json'), JSON.stringify({
  format: 1, name: 'synthetic-hills', vehicle: 'sirius', dive_id: 'synthetic-hills', software: 'make_dive', origin: ORIGIN, tileset: 'tiles/tileset.json',
  levels: [0, 1, 2].map((level) => ({ level, tile_edge_m: 2.112 * 4 ** level, triangles_per_m2: 1000 / 10 ** level, texel_m: 0.004125 * 4 ** level, error_m: 0.033 * 4 ** level })),
  layers: [
    { name: 'orthomosaic', title: 'Orthomosaic', unit: '', file: 'layers/orthomosaic.tif' },
    { name: 'elevation', title: 'Elevation', unit: 'm', file: 'layers/elevation.tif', min: -21.8, max: -18.3, ramp: 'viridis' },
    { name: 'slope', title: 'Slope', unit: 'deg', file: 'layers/slope.tif', min: 0, max: 40, ramp: 'magma' },
    { name: 'uncertainty', title: 'Uncertainty', unit: 'm', file: 'layers/uncertainty.tif', ramp: 'magma' },
    { name: 'broken', title: 'Broken layer', unit: '', file: 'layers/broken.tif' },
  ],
  track: 'track.json', images: 'images.json', image_folder: '../img', bounds: [0, 0, EDGE, EDGE], depth: [18.2, 21.9],
}));
writeFileSync(join(out, 'layers', 'broken.tif'), Buffer.from('II*\0nothing more'));

// Files that a user brings.
const classes = ['Sand', 'Kelp', 'Reef'];
const label = ({ north, east }) => classes[Math.abs(Math.round(north / 9) + Math.round(east / 11)) % 3];
writeFileSync(join(folder, 'own', 'labels.csv'), `image,habitat\n${images.map((i) => `${i.left},${label(i)}`).join('\n')}\nPR_19990101_000000_000_LC16.tif,Sand\n`);
const degree = 1 / 110_840;
const [W, H] = [120, 80];
const bathymetry = Float32Array.from({ length: W * H }, (_, i) => -21 + 2 * Math.sin((i % W) / 15) * Math.cos(Math.floor(i / W) / 11));
writeFileSync(join(folder, 'own', 'multibeam.tif'), writeTiff(bathymetry, W, H, 1, {
  scale: 0.5 * degree, north: ORIGIN.latitude + 38 * degree, west: ORIGIN.longitude - 10 * degree, keys: [[1024, 2], [1025, 1], [2048, 4326]],
}));
console.log(`${images.length} images, ${track.utc_ns.length} track points`);
