import assert from 'node:assert/strict';
import { test } from 'node:test';
import { duration, niceBelow } from '../src/format';
import { ramp, robustRange, VIRIDIS } from '../src/ramps';
import { decodeTiles, tileTriangles } from '../src/tiles';

// One tile at stride 8: 3 x 3 nodes, the middle one not seen.
function batch(): ArrayBuffer {
  const buffer = new ArrayBuffer(12 + 32 + 9 * 4 + 28);
  const view = new DataView(buffer);
  [...'FTIL'].forEach((c, i) => view.setUint8(i, c.charCodeAt(0)));
  view.setUint32(4, 77, true);
  view.setUint32(8, 1, true);
  view.setInt32(12, -3, true);
  view.setInt32(16, 5, true);
  view.setInt16(20, 3, true);
  view.setUint8(22, 8);
  view.setUint8(23, 3);
  view.setFloat32(24, 4, true);
  view.setUint32(28, 9, true);
  view.setFloat32(32, 0.0125, true);
  view.setFloat64(36, 1.79e9, true);
  for (let n = 0; n < 9; ++n) {
    view.setFloat32(44 + 4 * n, n === 4 ? NaN : 20 + n, true);
    view.setUint8(80 + 3 * n, 10 * n);
  }
  return buffer;
}

test('a tile batch decodes field by field', () => {
  const { version, tiles } = decodeTiles(batch());
  assert.equal(version, 77);
  const tile = tiles[0]!;
  assert.equal(tile.key, '3/-3/5');
  assert.equal(tile.side, 3);
  assert.equal(tile.size, 4);
  assert.ok(Math.abs(tile.sigma - 0.0125) < 1e-6);
  assert.equal(tile.receivedUtc, 1.79e9);
  assert.equal(tile.depths[8], 28);
  assert.equal(tile.colours[3 * 8], 80);
});

test('a batch cut anywhere, or not a batch, is an error', () => {
  const whole = batch();
  for (let n = 0; n < whole.byteLength; ++n) assert.throws(() => decodeTiles(whole.slice(0, n)));
  assert.throws(() => decodeTiles(new ArrayBuffer(64)));
});

test('triangles leave out unseen nodes and face upwards', () => {
  const tile = decodeTiles(batch()).tiles[0]!;
  const triangles = tileTriangles(tile);
  assert.equal(triangles.length / 3, 4); // one in each of the four cells
  assert.ok(!triangles.includes(4));
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = triangles.slice(t, t + 3).map((n) => [n % 3, Math.floor(n / 3)] as const);
    const turn = (b![0] - a![0]) * (c![1] - a![1]) - (b![1] - a![1]) * (c![0] - a![0]);
    assert.ok(turn > 0, 'counter-clockwise with east to the right and north up');
  }
});

test('ramps reach their ends and a flat floor keeps a metre of range', () => {
  assert.deepEqual(ramp(VIRIDIS, -1), VIRIDIS[0]);
  assert.deepEqual(ramp(VIRIDIS, 2), VIRIDIS[VIRIDIS.length - 1]);
  const [low, high] = robustRange([20, 20.01, 20.02], 1);
  assert.ok(Math.abs(high - low - 1) < 1e-9);
});

test('scale bars and durations read well', () => {
  assert.deepEqual([niceBelow(9.9), niceBelow(4.1), niceBelow(0.3), niceBelow(10)], [5, 2, 0.2, 10]);
  assert.deepEqual([duration(119), duration(150), duration(7300)], ['119 s', '2 min 30 s', '2 h 1 min']);
});
