import assert from 'node:assert/strict';
import { test } from 'node:test';
import * as THREE from 'three';
import { bytes, dateAndClock, duration, niceBelow, number, position, spacingText } from '#kit/format';
import { projectionOf, transverseMercator, utm, utmZone } from '#kit/geodesy';
import { inside, lineText, measure, pathLength, planArea, sampleGrid, stations, surfaceArea, volumes, type HeightGrid } from '#kit/measure';
import { areaOf, boundsAbout, toNav, toScene, turnToScene } from '#kit/place';
import { VIRIDIS, ramp, robustRange } from '#kit/ramps';

const near = (a: number, b: number, within: number): void => assert.ok(Math.abs(a - b) <= within, `${a} is not within ${within} of ${b}`);

test('UTM agrees with PROJ to a millimetre', () => {
  // proj_trans from OGC:CRS84 to EPSG:32631 and EPSG:32756.
  const paris = utm(31, false).toLocal({ latitude: 48.8583, longitude: 2.2945 });
  near(paris.east, 448251.8983, 1e-3);
  near(paris.north, 5411943.7938, 1e-3);
  const sydney = utm(utmZone(151.2153), true).toLocal({ latitude: -33.8568, longitude: 151.2153 });
  near(sydney.east, 334900.5697, 1e-3);
  near(sydney.north, 6252288.7529, 1e-3);
  assert.ok(projectionOf(32756) && projectionOf(3857) && projectionOf(2193) === null);
});

test('nav coordinates go to latitude and longitude and back to a tenth of a millimetre within 100 km', () => {
  const nav = transverseMercator({ latitude: -23.44, longitude: 151.91 });
  assert.deepEqual(nav.toLocal({ latitude: -23.44, longitude: 151.91 }).north, 0);
  for (const north of [-1e5, -350, 0, 12.5, 1e5])
    for (const east of [-1e5, -1, 0, 77, 1e5]) {
      const back = nav.toLocal(nav.toGeodetic({ north, east }));
      near(back.north, north, 1e-4);
      near(back.east, east, 1e-4);
    }
  // One second of arc of the meridian at this latitude, by the ellipsoid's radius of curvature there.
  const e2 = 0.00669437999014;
  const s = Math.sin((23.44 * Math.PI) / 180);
  const radius = (6378137 * (1 - e2)) / (1 - e2 * s * s) ** 1.5;
  near(nav.toLocal({ latitude: -23.44 + 1 / 3600, longitude: 151.91 }).north, (radius * Math.PI) / 180 / 3600, 1e-3);
});

test('the pose file\'s first place has the latitude and longitude that it states', () => {
  const nav = transverseMercator({ latitude: -23.44, longitude: 151.91 });
  const g = nav.toGeodetic({ north: 5.592736241912595, east: 2.0041416371890417 });
  near(g.latitude, -23.439949501344557, 1e-11);
  near(g.longitude, 151.91001961244046, 1e-11);
});

test('scene and nav are turns of one another', () => {
  const p = { north: 3, east: -4, depth: 17 };
  assert.deepEqual(toNav(toScene(p)), p);
  const origin = { north: 100, east: -50, depth: 20 };
  assert.deepEqual(toScene(p, origin).toArray(), [46, 3, 97]);
  assert.deepEqual(toNav(toScene(p, origin), origin), p);
  const q = new THREE.Quaternion(0.1, -0.3, 0.2, 0.9).normalize(); // of nav
  const inNav = new THREE.Vector3(1, 2, 3).applyQuaternion(q);
  const inScene = toScene({ north: 1, east: 2, depth: 3 }).applyQuaternion(turnToScene([q.w, q.x, q.y, q.z]));
  assert.ok(inScene.distanceTo(toScene({ north: inNav.x, east: inNav.y, depth: inNav.z })) < 1e-12);
});

test('distances, areas and bearings', () => {
  const a = { north: 0, east: 0, depth: 10 };
  const { slope, horizontal, drop, bearing } = measure(a, { north: 3, east: 4, depth: 22 });
  assert.deepEqual([slope, horizontal, drop], [13, 5, 12]);
  near(bearing, 53.1301, 1e-4);
  assert.equal(measure(a, { north: 0, east: -1, depth: 10 }).bearing, 270);
  assert.equal(lineText([a, { north: 3, east: 4, depth: 22 }]), '13.00 m · horizontal 5.00 m · 12.00 m deeper · bearing 053°');
  assert.equal(areaOf(boundsAbout({ north: 4, east: 9, depth: 0 }, { north: 1, east: 11, depth: 9 })), 6);
  const square = [a, { ...a, north: 2 }, { north: 2, east: 3, depth: 9 }, { ...a, east: 3 }];
  assert.equal(planArea(square), 6);
  assert.equal(pathLength(square.slice(0, 2)).slope, 2);
  assert.ok(inside(square, 1, 1) && !inside(square, 1, 3.1) && !inside(square, -0.1, 1));
});

test('stations stand at equal steps of horizontal distance around a corner', () => {
  const line = stations([{ north: 0, east: 0, depth: 0 }, { north: 3, east: 0, depth: 9 }, { north: 3, east: 1, depth: 0 }], 5);
  assert.deepEqual(line.map((s) => [s.along, s.north, s.east]), [[0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 0], [4, 3, 1]]);
});

test('a plane at 45 degrees has root two of its plan area, and holes are left out', () => {
  const [width, height, step] = [41, 41, 0.05];
  const values = Float64Array.from({ length: width * height }, (_, i) => (i % width) * step);
  const grid: HeightGrid = { values, width, height, north: 2, east: 0, step };
  const corners = [[0, 0], [2, 0], [2, 2], [0, 2]].map(([north, east]) => ({ north: north!, east: east!, depth: 0 }));
  const { surface, plan } = surfaceArea(grid, corners);
  near(plan, 4, 1e-9);
  near(surface / plan, Math.SQRT2, 1e-9);
  near(sampleGrid(grid, 1.013, 0.777), 0.777, 1e-9);
  values[20 * width + 20] = NaN;
  near(surfaceArea(grid, corners).plan, 4 - 4 * step * step, 1e-9);
  assert.ok(Number.isNaN(sampleGrid(grid, 1.0, 1.0)) && Number.isNaN(sampleGrid(grid, 9, 1)));
});

test('a mound on a slope has its volume over the plane of the corners', () => {
  const step = 0.02;
  const [width, height] = [101, 101];
  // A cone 0.3 m high and 0.5 m in radius about (1, 1), a pit as deep as a box of 0.2 m square, on ground that rises east.
  const up = (north: number, east: number): number => 0.25 * east + Math.max(0, 0.3 * (1 - Math.hypot(north - 1, east - 1) / 0.5))
    - (Math.abs(north - 0.3) < 0.1 && Math.abs(east - 0.3) < 0.1 ? 0.1 : 0);
  const values = Float64Array.from({ length: width * height }, (_, i) => up(2 - Math.floor(i / width) * step, (i % width) * step));
  const grid: HeightGrid = { values, width, height, north: 2, east: 0, step };
  const corners = [[0, 0], [2, 0], [2, 2], [0, 2]].map(([north, east]) => ({ north: north!, east: east!, depth: -0.25 * east! }));
  const { above, below } = volumes(grid, corners);
  near(above, (Math.PI * 0.25 * 0.3) / 3, 2e-4);
  near(below, 0.1 * 0.04, 4e-4);
});

test('ramps reach their ends and a flat floor keeps a metre of range', () => {
  assert.deepEqual(ramp(VIRIDIS, -1), VIRIDIS[0]);
  assert.deepEqual(ramp(VIRIDIS, 2), VIRIDIS[VIRIDIS.length - 1]);
  const [low, high] = robustRange([20, 20.01, NaN, 20.02], 1);
  near(high - low, 1, 1e-9);
  assert.deepEqual([robustRange([3, 3]), robustRange([3, 3], 0), robustRange([])], [[2.5, 3.5], [3, 3], [0, 1]]);
});

test('numbers are written as people read them', () => {
  assert.deepEqual([niceBelow(9.9), niceBelow(4.1), niceBelow(0.3), niceBelow(10)], [5, 2, 0.2, 10]);
  assert.deepEqual([duration(119), duration(150), duration(7300)], ['119 s', '2 min 30 s', '2 h 1 min']);
  assert.deepEqual([spacingText(0.25), spacingText(0.03125), spacingText(2), spacingText(5000)], ['25 cm', '3.1 cm', '2 m', '5 km']);
  assert.deepEqual([bytes(9999), bytes(12_340), bytes(512 * 2 ** 20)], ['9 999 B', '12.3 kB', '537 MB']);
  assert.deepEqual([number(-1.25, 1, 'm'), number(null, 1), dateAndClock(0), dateAndClock(null)], ['−1.3 m', '–', '1970-01-01 00:00:00', '–']);
  assert.equal(position({ latitude: -23.439949501344557, longitude: 151.91001961244046 }), '23° 26.39697′ S  151° 54.60118′ E');
  assert.equal(position({ latitude: -0.9999999999, longitude: -0.25 }), '01° 00.00000′ S  000° 15.00000′ W');
});
