import assert from 'node:assert/strict';
import { test } from 'node:test';
import * as THREE from 'three';
import { merge, readAnnotations, seenBy, toCsv, toGeoJson, type Annotation } from '../src/annotations';
import { Budget, defaultLimit, halvings } from '../src/budget';
import { imagesThatSaw, inCamera, project, turn, type CameraModel, type DiveImage } from '../src/cameras';
import { marksCsv, readMarks, withMark } from '../src/control_marks';
import { readCsv } from '../src/csv';
import { develop, pictureOf } from '../src/demosaic';
import { deflateSync } from 'node:zlib';
import { openDive, parseImages, parseScene, parseTrack } from '../src/dive';
import { Flight } from '../src/flight';
import { transverseMercator, utm, utmZone } from '#kit/geodesy';
import { imageSize } from '../src/image_size';
import { isDeepPng, readDeepPng } from '../src/image_samples';
import { joinLabels, stem } from '../src/labels';
import { measuredGeoJson } from '../src/measured';
import { LongLine, simplified } from '#kit/lines';
import { spreadOrder } from '../src/marks';
import { readPermalink, writePermalink } from '../src/permalink';
import { boundsOf, crsOfKeys, crsOfWorldFile, gridOfWorldFile, place, placementOf } from '../src/raster';
import { fromFileList, openFolder } from '../src/source';

const near = (a: number, b: number, within: number): void => assert.ok(Math.abs(a - b) <= within, `${a} is not within ${within} of ${b}`);

const CAMERA: CameraModel = { width: 1360, height: 1024, fx: 1725, fy: 1723, cx: 686, cy: 507, k1: 0.142, k2: 0.655, p1: 0.0021, p2: -0.0013, k3: 0 };
const half = Math.PI / 4;
const above = (over: Partial<DiveImage> = {}): DiveImage => ({
  left: 'PR_20260301_020050_914_LC16.tif', utc_ns: '0', north: 10, east: 20, depth: 5, q: [1, 0, 0, 0], altitude: 2, footprint: [], ...over,
});

test('a place straight ahead of the camera falls on its principal point', () => {
  const image = above();
  const pixel = project(CAMERA, image, { north: 10, east: 20, depth: 7 })!;
  near(pixel.u, 686, 1e-9);
  near(pixel.v, 507, 1e-9);
  near(pixel.range, 2, 1e-12);
  assert.equal(project(CAMERA, image, { north: 10, east: 20, depth: 4 }), null, 'what is behind is not seen');
});

test('a camera that is turned about the vertical sees north to its side', () => {
  // Heading 90 degrees: the camera's x (right) looks east before, south after.
  const image = above({ q: [Math.cos(half), 0, 0, Math.sin(half)] });
  const [x, y, z] = inCamera(image, { north: 11, east: 20, depth: 7 });
  near(x, 0, 1e-12);
  near(y, -1, 1e-12);
  near(z, 2, 1e-12);
  const back = turn(image.q, [x, y, z]);
  near(back[0], 1, 1e-12);
});

test('measured lines and areas go out as GeoJSON, rings closed and against the clock', () => {
  const projection = transverseMercator({ latitude: -33.5, longitude: 151.2 });
  const clockwise = [[0, 0], [2, 0], [2, 3], [0, 3]].map(([north, east]) => ({ north: north!, east: east!, depth: 5 }));
  const out = JSON.parse(measuredGeoJson([{ area: true, points: clockwise, text: 'a' }, { area: false, points: clockwise.slice(0, 2), text: 'b' }], projection, 'd'));
  const [ring] = out.features[0].geometry.coordinates;
  assert.equal(ring.length, 5);
  assert.deepEqual(ring[0], ring[4]);
  const twice = ring.slice(1).reduce((sum: number, p: number[], i: number) => sum + ring[i][0] * p[1]! - p[0]! * ring[i][1], 0);
  assert.ok(twice > 0);
  near(ring[0][2], -5, 1e-9);
  assert.equal(out.features[0].properties.plan_area_m2, 6);
  assert.equal(out.features[1].properties.length_m, 2);
  near(out.features[1].geometry.coordinates[0][1], -33.5, 1e-8);
});

test('a long line is drawn with the points that can be distinguished', () => {
  const wave = Array.from({ length: 2001 }, (_, i) => new THREE.Vector3(i / 100, 0, 0.1 * Math.sin(i / 50)));
  const some = simplified(wave, 0.02);
  assert.ok(some.length > 10 && some.length < 120, `${some.length} points`);
  assert.deepEqual(simplified(wave, 0.3), [0, 2000]);
  const line = new LongLine({ color: 0xffffff });
  line.set([...wave.map(({ x, z }) => ({ north: -z, east: x, depth: 0 })), null, { north: 0, east: 0, depth: 0 }, { north: 1, east: 1, depth: 0 }]);
  const camera = new THREE.PerspectiveCamera(50);
  const shown = (height: number): number => {
    camera.position.set(10, height, 0);
    line.look(camera, 800);
    return line.object.children.reduce((sum, child) => sum + (child as THREE.Line).geometry.getAttribute('position').count - 1, 0);
  };
  const [near, far] = [shown(1), shown(400)];
  assert.ok(near > 300 && far < 12, `${near} and ${far} segments`);
});

test('the beginning of a spread order is spread over all', () => {
  const order = spreadOrder(400);
  assert.deepEqual([...order].sort((a, b) => a - b), Array.from({ length: 400 }, (_, i) => i));
  const first = order.slice(0, 25).sort((a, b) => a - b);
  assert.ok(first.every((at, i) => i === 0 || (at - first[i - 1]! > 8 && at - first[i - 1]! < 33)), first.join(' '));
  assert.deepEqual(spreadOrder(1), [0]);
});

test('distortion is OpenCV\'s', () => {
  // cv2.projectPoints([[0.3, -0.2, 1]]) with this camera.
  const p = project(CAMERA, above({ north: 0, east: 0, depth: 0 }), { north: 0.3, east: -0.2, depth: 1 })!;
  const r2 = 0.13;
  const radial = 1 + 0.142 * r2 + 0.655 * r2 * r2;
  near(p.u, 1725 * (0.3 * radial + 2 * 0.0021 * 0.3 * -0.2 - 0.0013 * (r2 + 2 * 0.09)) + 686, 1e-9);
  near(p.v, 1723 * (-0.2 * radial + 0.0021 * (r2 + 2 * 0.04) + 2 * -0.0013 * 0.3 * -0.2) + 507, 1e-9);
});

test('the images that saw a place come best first, and those that did not are left out', () => {
  const images = [above({ north: 10.4, left: 'off axis' }), above({ left: 'above' }), above({ north: 60, left: 'far' }), above({ q: [0, 1, 0, 0], left: 'looks up' }),
    above({ depth: 3, altitude: 4, left: 'higher' })];
  const seen = imagesThatSaw(CAMERA, images, { north: 10, east: 20, depth: 7 });
  assert.deepEqual(seen.map((s) => images[s.index]!.left), ['above', 'off axis', 'higher']);
});

test('a surveyed point has one mark in an image, and marks come back from their table', () => {
  let marks = [{ point: 'P 1, east', image: 'left/1.png', u: 10.126, v: 20 }, { point: 'P2', image: 'left/1.png', u: 5, v: 6 }];
  marks = withMark(marks, { point: 'P 1, east', image: 'left/1.png', u: 11, v: 21.5 });
  marks = withMark(marks, { point: 'P 1, east', image: 'left/2.png', u: 1, v: 2 });
  assert.deepEqual(marks.map((m) => m.u), [5, 11, 1]);
  assert.deepEqual(readMarks(marksCsv(marks)), marks);
  assert.deepEqual(readMarks('point,image,u,v,sigma_px\nA,a.png,1,,2\n,a.png,1,2,2\n'), []);
  assert.throws(() => readMarks('name,image,u,v\n'), /has no columns point/);
});

test('a raster in nav, in degrees and in UTM is placed to a hundredth of a pixel', () => {
  const nav = transverseMercator({ latitude: -28.8, longitude: 113.9 });
  const bounds = { north0: 0, east0: -20, north1: 300, east1: 280 };
  const zone = utmZone(113.9);
  const south = utm(zone, true);
  const cases: [Record<string, number>, (p: { north: number; east: number }) => [number, number]][] = [
    [{ GTModelTypeGeoKey: 1, ProjectedCSTypeGeoKey: 32767, ProjNatOriginLatGeoKey: -28.8, ProjNatOriginLongGeoKey: 113.9 }, (p) => [p.east, p.north]],
    [{ GTModelTypeGeoKey: 2, GeographicTypeGeoKey: 4326 }, (p) => { const g = nav.toGeodetic(p); return [g.longitude, g.latitude]; }],
    [{ GTModelTypeGeoKey: 1, ProjectedCSTypeGeoKey: 32700 + zone }, (p) => { const q = south.toLocal(nav.toGeodetic(p)); return [q.east, q.north]; }],
  ];
  for (const [keys, truth] of cases) {
    const known = crsOfKeys(keys, nav);
    assert.ok(typeof known !== 'string');
    const [x0, y1] = truth({ north: 310, east: -30 });
    const [x1, y0] = truth({ north: -10, east: 300 });
    const size = 2000;
    const grid = { a: (x1 - x0) / size, b: 0, c: x0, d: 0, e: (y0 - y1) / size, f: y1, width: size, height: size };
    const { placement, residual } = placementOf(grid, known.crs, bounds);
    assert.ok(residual < 0.05, `residual ${residual}`);
    const at = { north: 123.4, east: 56.7 };
    const [x, y] = truth(at);
    const [u, v] = place(placement, at.north, at.east);
    near(u * size, (x - grid.c) / grid.a, 0.05);
    near(v * size, (y - grid.f) / grid.e, 0.05);
    const b = boundsOf(placement);
    assert.ok(b.north0 < 0 && b.north1 > 300 && b.east0 < -20 && b.east1 > 280);
  }
  assert.match(crsOfKeys({ GTModelTypeGeoKey: 1, ProjectedCSTypeGeoKey: 2193 }, nav) as string, /EPSG:2193/);
});

test('a world file speaks of pixel centres, and its numbers tell its coordinates', () => {
  const nav = transverseMercator({ latitude: -28.8, longitude: 113.9 });
  const grid = gridOfWorldFile('0.5\n0\n0\n-0.5\n100.25\n199.75\n', 40, 20);
  assert.deepEqual([grid.c, grid.f], [100, 200]);
  assert.equal(crsOfWorldFile(grid, nav).text, 'nav metres');
  assert.match(crsOfWorldFile({ ...grid, c: 392000, f: 6813000 }, nav).text, /^UTM 49S/);
  assert.equal(crsOfWorldFile({ ...grid, a: 1e-6, c: 113.9, f: -28.8 }, nav).text, 'latitude and longitude');
  assert.throws(() => gridOfWorldFile('0.5\n0\n0\n', 1, 1), /six numbers/);
});

test('labels join images by name whatever folder, ending or camera the tool wrote', () => {
  assert.equal(stem('C:\\dive\\PR_20260301_020050_914_LC16.tif'), stem('pr_20260301_020050_914.png'));
  const images = [{ left: 'PR_1_LC16.tif', right: 'PR_2_RM16.tif' }, { left: 'PR_3_LC16.tif', right: 'PR_4_RM16.tif' }, { left: 'PR_5_LC16.tif' }];
  const labels = joinLabels(readCsv('\ufeffdepth;file;"habitat class";habitat\n3;x/PR_1_LC16.png;a;Kelp\n4;PR_4_RM16.tif;b;"Sand; fine"\n5;PR_9_LC16.tif;c;Kelp\n'), images);
  assert.equal(labels.column, 'habitat');
  assert.deepEqual(labels.classes, [{ name: 'Kelp', images: 1 }, { name: 'Sand; fine', images: 1 }]);
  assert.deepEqual([...labels.ofImage], [0, 1, -1]);
  assert.equal(labels.unknown, 1);
  assert.throws(() => joinLabels(readCsv('image,class\nother.tif,Sand\n'), images), /no column names images/);
  assert.throws(() => joinLabels(readCsv(''), images), /no column/);
});

const ANNOTATIONS: Annotation[] = [
  { id: 'a', class: 'brittle star', note: 'two, "on" rock\nunder ledge', utc: '2026-09-21T00:00:00Z', north: 12.3456, east: -7.1, depth: 20.25, images: ['PR_1_LC16.tif', 'PR_3_LC16.tif'] },
  { id: 'b', class: '', note: '', utc: '', north: 0, east: 0, depth: 0, images: [] },
];

test('annotations come back from GeoJSON and from CSV as they went', () => {
  const nav = transverseMercator({ latitude: -28.8, longitude: 113.9 });
  assert.deepEqual(readAnnotations(toGeoJson(ANNOTATIONS, nav, 'dive'), nav), ANNOTATIONS);
  assert.deepEqual(readAnnotations(toCsv(ANNOTATIONS, nav, 'dive'), nav), ANNOTATIONS);
  assert.deepEqual(readAnnotations(toGeoJson(ANNOTATIONS, null, 'dive'), null), ANNOTATIONS);
  assert.equal(merge(ANNOTATIONS, [{ ...ANNOTATIONS[0]!, note: 'new' }]).length, 2);
  assert.deepEqual(seenBy(['PR_3_LC16.tif', 'PR_5_LC16.tif'], ANNOTATIONS).map((a) => a.id), ['a']);
});

test('another tool\'s GeoJSON is placed by latitude and longitude, and what is no annotation file says why', () => {
  const nav = transverseMercator({ latitude: -28.8, longitude: 113.9 });
  const g = nav.toGeodetic({ north: 4, east: 9 });
  const [one] = readAnnotations(JSON.stringify({ type: 'FeatureCollection', features: [null, { type: 'Feature', properties: null, geometry: { type: 'Point', coordinates: [g.longitude, g.latitude, -21] } }] }), nav);
  near(one!.north, 4, 1e-6);
  near(one!.east, 9, 1e-6);
  assert.equal(one!.depth, 21);
  assert.throws(() => readAnnotations('{"features":', nav), /no JSON/);
  assert.throws(() => readAnnotations('{"a":1}', nav), /no features/);
  assert.throws(() => readAnnotations('id,class\n1,Sand\n', nav), /no points/);
});

test('the address keeps the view, and nonsense in it is passed over', () => {
  const link = { eye: [1.5, 20, -3] as [number, number, number], look: [1, -20, 0] as [number, number, number], surface: 'wire', layer: 'slope', opacity: 0.5, show: ['track'], select: [1, 2, 3] as [number, number, number], image: 'PR_1.tif', time: 1790000000.125 };
  assert.deepEqual(readPermalink(writePermalink(link)), link);
  assert.deepEqual(readPermalink('#eye=1,2&look=a,b,c&opacity=x&time='), {});
});

test('too little room coarsens the picture step by step, and it sharpens again with less swing than the step', () => {
  const budget = new Budget();
  assert.equal(budget.update({ used: 50, limit: 100, calls: 20 }, false), false);
  for (let i = 0; i < 3; ++i) assert.equal(budget.update({ used: 95, limit: 100, calls: 20 }, false), true);
  assert.ok(budget.reduced && budget.factor > 1.7);
  assert.equal(budget.update({ used: 70, limit: 100, calls: 20 }, false), false, 'between the two bounds it holds');
  budget.update({ used: 10, limit: 100, calls: 290 }, false);
  assert.ok(budget.factor > 2, 'draw calls count as well');
  const easy = { used: 10, limit: 100, calls: 10 };
  for (let i = 0; i < 200; ++i) budget.update(easy, false);
  assert.equal(budget.factor, 1);
  budget.update(easy, true);
  assert.ok(budget.reduced, 'a refused tile counts as full');
});

test('where sharpening never lasts the tries become rare, until the view changes', () => {
  const budget = new Budget();
  const easy = { used: 10, limit: 100, calls: 10 };
  const waits = (): number => {
    budget.update(easy, true);
    let n = 0;
    while (budget.reduced) { budget.update(easy, false); ++n; }
    return n;
  };
  const first = waits();
  assert.ok(first > 5);
  assert.ok(waits() === 2 * first && waits() === 4 * first);
  budget.moved();
  budget.update(easy, false);
  assert.equal(budget.factor, 1);
});

test('the limit follows the device, within bounds', () => {
  assert.equal(defaultLimit(8), 1024 * 2 ** 20);
  assert.equal(defaultLimit(0.5), 192 * 2 ** 20);
  assert.equal(defaultLimit(undefined), 512 * 2 ** 20);
});

test('a texture is halved as often as its texels stay no larger than pixels, never below a few texels', () => {
  assert.equal(halvings(0.001, 0.001, 2048, 2048), 0);
  assert.equal(halvings(0.001, 0.0039, 2048, 2048), 1);
  assert.equal(halvings(0.001, 0.004, 2048, 2048), 2);
  assert.equal(halvings(0.001, 1, 2048, 2048), 6);
  assert.equal(halvings(0.001, Infinity, 2048, 2048), 6);
  assert.equal(halvings(0.001, 1, 16, 16), 0);
});

test('sizes of PNG, WebP and JPEG come from their first bytes', () => {
  const png = new Uint8Array(40);
  png.set([0x89, 0x50, 0x4e, 0x47], 0);
  new DataView(png.buffer).setUint32(16, 640);
  new DataView(png.buffer).setUint32(20, 480);
  assert.deepEqual(imageSize(png), { width: 640, height: 480, type: 'image/png' });
  const jpeg = new Uint8Array([0xff, 0xd8, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xc2, 0, 11, 8, 1, 0, 2, 0, 3, 0, 0, 0]);
  assert.deepEqual(imageSize(jpeg), { width: 512, height: 256, type: 'image/jpeg' });
  const webp = new Uint8Array(40);
  webp.set([...'RIFF....WEBPVP8X'].map((c) => c.charCodeAt(0)));
  webp.set([0xff, 0x01, 0, 0x3f, 0, 0], 24);
  assert.deepEqual(imageSize(webp), { width: 512, height: 64, type: 'image/webp' });
  assert.equal(imageSize(new Uint8Array([1, 2, 3])), null);
  assert.equal(imageSize(jpeg.subarray(0, 9)), null);
});

test('a flat mosaic develops to one grey, its colours from its own samples', () => {
  const [width, height] = [8, 6];
  const samples = Uint16Array.from({ length: width * height }, (_, i) => 100 + 300 * (((i % width) % 2) + (Math.floor(i / width) % 2)) + (i % 5));
  const full = develop(samples, width, height, [0, 0], 1);
  assert.deepEqual([full.width, full.height], [8, 6]);
  const small = develop(samples, width, height, [0, 0], 2);
  assert.deepEqual([small.width, small.height], [4, 3]);
  // A red ramp from left to right brightens in red alone.
  const ramp = Uint16Array.from({ length: 64 * 64 }, (_, i) => (i % 2 === 0 && Math.floor(i / 64) % 2 === 0 ? 10 * (i % 64) : 500));
  const picture = develop(ramp, 64, 64, [0, 0], 1);
  const at = (x: number, c: number): number => picture.rgba[4 * (32 * 64 + x) + c]!;
  assert.ok(at(8, 0) < at(32, 0) && at(32, 0) < at(56, 0));
  assert.equal(at(8, 1), at(56, 1));
});

test('grey stays grey, colours of 12 bits are bright, and a mosaic may begin with any colour', () => {
  const [width, height] = [64, 48];
  const pixels = width * height;
  const grey = Uint8Array.from({ length: pixels }, (_, i) => i % 251);
  const plain = pictureOf({ width, height, bands: 1, samples: grey, bits: 8 }, 'mono', 1);
  assert.deepEqual([...plain.rgba.subarray(0, 8)], [0, 0, 0, 255, 1, 1, 1, 255]);
  const deep = Uint16Array.from({ length: 3 * pixels }, (_, i) => (i % 3 === 0 ? 40 : 400) + Math.floor(i / 3) % width);
  const rgb = pictureOf({ width, height, bands: 3, samples: deep, bits: 16 }, 'rgb', 1);
  assert.equal(rgb.width, width);
  assert.ok(rgb.rgba[4 * (width - 1)]! > 240 && rgb.rgba[4 * (width - 1) + 1]! > 240);
  // Red rises to the right, blue to the bottom; green is even.
  for (const [format, red] of [['bayer-rggb', [0, 0]], ['bayer-grbg', [1, 0]], ['bayer-gbrg', [0, 1]], ['bayer-bggr', [1, 1]]] as const) {
    const mosaic = Uint16Array.from({ length: pixels }, (_, i) => {
      const [x, y] = [i % width, Math.floor(i / width)];
      const [ofRed, ofBlue] = [x % 2 === red[0] && y % 2 === red[1], x % 2 !== red[0] && y % 2 !== red[1]];
      return ofRed ? 10 * x : ofBlue ? 10 * y : 300;
    });
    const picture = pictureOf({ width, height, bands: 1, samples: mosaic, bits: 16 }, format, 1);
    assert.deepEqual([picture.width, picture.height], [width, height]);
    const at = (x: number, y: number, c: number): number => picture.rgba[4 * (y * width + x) + c]!;
    assert.ok(at(50, 20, 0) > at(10, 20, 0) + 50 && Math.abs(at(50, 20, 0) - at(50, 40, 0)) < 12, format);
    assert.ok(at(30, 40, 2) > at(30, 8, 2) + 50 && Math.abs(at(10, 40, 2) - at(50, 40, 2)) < 12, format);
  }
});

test('a PNG of 16 bits keeps all of them, whatever filters its rows have', async () => {
  const [width, height, bands] = [5, 5, 3];
  const samples = Uint16Array.from({ length: width * height * bands }, (_, i) => (i * 2777) % 65536);
  const pixel = 2 * bands;
  const stride = pixel * width;
  const bytes = new Uint8Array(samples.length * 2);
  samples.forEach((v, i) => { bytes[2 * i] = v >> 8; bytes[2 * i + 1] = v & 255; });
  const plain = new Uint8Array(height * (stride + 1));
  for (let y = 0; y < height; ++y) {
    plain[y * (stride + 1)] = y; // each of the five filters
    for (let i = 0; i < stride; ++i) {
      const get = (row: number, at: number): number => (row < 0 || at < 0 ? 0 : bytes[row * stride + at]!);
      const [a, b, c] = [get(y, i - pixel), get(y - 1, i), get(y - 1, i - pixel)];
      const p = a + b - c;
      const paeth = Math.abs(p - a) <= Math.abs(p - b) && Math.abs(p - a) <= Math.abs(p - c) ? a : Math.abs(p - b) <= Math.abs(p - c) ? b : c;
      plain[y * (stride + 1) + 1 + i] = bytes[y * stride + i]! - [0, a, b, Math.floor((a + b) / 2), paeth][y]!;
    }
  }
  const chunk = (name: string, data: Uint8Array): Buffer => {
    const head = Buffer.alloc(8);
    head.writeUInt32BE(data.length);
    head.write(name, 4, 'latin1');
    return Buffer.concat([head, data, Buffer.alloc(4)]);
  };
  const about = Buffer.alloc(13);
  about.writeUInt32BE(width);
  about.writeUInt32BE(height, 4);
  about.set([16, 2, 0, 0, 0], 8);
  const packed = deflateSync(plain);
  const png = new Uint8Array(Buffer.concat([Buffer.from([0x89, 0x50, 0x4e, 0x47, 13, 10, 26, 10]), chunk('IHDR', about), chunk('IDAT', packed.subarray(0, 20)), chunk('IDAT', packed.subarray(20)), chunk('IEND', Buffer.alloc(0))]));
  assert.ok(isDeepPng(png));
  const read = await readDeepPng(png);
  assert.deepEqual([read.width, read.height, read.bands], [width, height, bands]);
  assert.deepEqual([...(read.samples as Uint16Array)], [...samples]);
});

test('a flight ends where it should, changes its height evenly and keeps the goal in sight', () => {
  const pose = (x: number, distance: number) => ({ eye: new THREE.Vector3(x, distance, 0.001), look: new THREE.Vector3(x, 0, 0), up: new THREE.Vector3(0, 1, 0) });
  const flight = new Flight(pose(0, 200), pose(60, 2));
  assert.ok(flight.at(0).eye.distanceTo(new THREE.Vector3(0, 200, 0)) < 0.1);
  assert.ok(flight.at(1).eye.distanceTo(new THREE.Vector3(60, 2, 0)) < 0.1);
  for (let t = 0; t <= 1; t += 0.05) {
    const { eye, look } = flight.at(t);
    const distance = eye.distanceTo(look);
    assert.ok((60 - look.x) / distance < 0.31, 'the goal stays as far from the middle, in heights, as it was');
  }
  const far = new Flight(pose(0, 2), pose(100, 2));
  assert.ok(far.at(0.5).eye.y > 20, 'a long flight at low height climbs between');
});

test('files of a dive that are not what they should be say so', () => {
  assert.throws(() => parseScene({ format: 2 }), /format 2/);
  assert.throws(() => parseScene({ format: 1 }), /no tileset/);
  const scene = parseScene({ format: 1, tileset: 't.json', origin: { latitude: 'x' }, layers: [{ file: 'a.tif' }, 7, { name: 'n' }], bounds: [1, 2, 3] });
  assert.equal(scene.origin, null);
  assert.equal(scene.bounds, null);
  assert.deepEqual(scene.layers.map((l) => l.title), ['a.tif']);
  assert.throws(() => parseTrack({ utc_ns: ['1', '2'], north: [1], east: [1, 2] }), /differ in length/);
  const track = parseTrack({ utc_ns: ['1000000000', '2000000000'], north: [1, null], east: [1, 2], altitude: [null, 2], salinity_psu: [35, 36], stage: ['survey', null] });
  assert.deepEqual(track.series.map((s) => s.key), ['altitude', 'salinity_psu']);
  assert.deepEqual(track.utc, [1, 2]);
  const { images, dropped, camera } = parseImages({ images: [above(), above({ left: 'left/0001.png' }), { left: '../escape.tif', north: 1, east: 1, depth: 1, q: [1, 0, 0, 0] }, { left: 'x' }, null], camera: { width: 3 } });
  assert.deepEqual([images.length, dropped, camera], [2, 3, null]);
  for (const left of ['/etc/passwd', 'a/../../b.tif', 'a\\b.tif', './a.tif', 'a//b.tif', ''])
    assert.equal(parseImages({ images: [above({ left })] }).dropped, 1, left);
});

test('a folder opens from the dive or from the mission around it', async () => {
  const file = (path: string): File => Object.assign(new File(['{}'], path.split('/').at(-1)!), { webkitRelativePath: path });
  const source = await openFolder('mission', fromFileList([file('mission/topside/scene.json'), file('mission/img/a b.tif')]));
  assert.equal((await source.fetch(new URL('scene.json', source.base).href)).status, 200);
  assert.equal((await source.fetch(new URL('../img/a%20b.tif', source.base).href)).status, 200);
  assert.equal((await source.fetch(new URL('absent.json', source.base).href)).status, 404);
  await assert.rejects(openFolder('other', fromFileList([file('other/readme.txt')])), /holds no scene.json/);
});

test('a dive whose images are not there says so once, and looks for them in the given folder', async () => {
  const scene = new File([JSON.stringify({ format: 1, tileset: 't.json', origin: { latitude: 0, longitude: 0 }, image_folder: '../../dive/img' })], 'scene.json');
  const source = await openFolder('results', fromFileList([Object.assign(scene, { webkitRelativePath: 'results/scene.json' })]));
  const complaints: string[] = [];
  const gone = await openDive(source, (what) => complaints.push(what), null);
  assert.equal(gone.originals, false);
  assert.deepEqual(complaints, ['the original images are not there: the model is shown without them']);
  const served = await openDive(source, (what) => complaints.push(what), 'http://127.0.0.1:1/images/');
  assert.equal(served.originals, true);
  assert.equal(served.imageAddress('a b.tif'), 'http://127.0.0.1:1/images/a%20b.tif');
  assert.equal(served.imageAddress('left/a#1.png'), 'http://127.0.0.1:1/images/left/a%231.png');
  assert.equal(complaints.length, 1);
});
