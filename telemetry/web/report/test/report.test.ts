import assert from 'node:assert/strict';
import { test } from 'node:test';
import { logRangeOf, mapFrame, rangeOf } from '../src/plot';

test('a range has room around its points, and one point has a range too', () => {
  assert.deepEqual(rangeOf([0, 100]), [-4, 104]);
  assert.deepEqual(rangeOf([3]), [2.5, 3.5]);
  assert.deepEqual(rangeOf([]), [0, 1]);
  assert.deepEqual(rangeOf([null, 0, null, 100]), [-4, 104]);
  const [low, high] = logRangeOf([1, null, 100]);
  assert.ok(low > 0.8 && low < 1 && high > 100 && high < 125);
});

test('on a map a metre is as long to the north as to the east, whatever the shape of the dive', () => {
  for (const [e, n] of [[100, 60], [100, 1], [1, 100]] as const) {
    const { height, x, y } = mapFrame([0, e], [0, n], 800);
    assert.ok(height >= 200 && height <= 800);
    const [across, up] = [(x[1] - x[0]) / 800, (y[1] - y[0]) / height];
    assert.ok(Math.abs(across - up) < 1e-9 * up);
    assert.ok(x[0] <= 0 && x[1] >= e && y[0] <= 0 && y[1] >= n);
  }
});
