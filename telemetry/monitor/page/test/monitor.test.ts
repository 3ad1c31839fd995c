import assert from 'node:assert/strict';
import { test } from 'node:test';
import { AlarmBook, DEFAULT_THRESHOLDS, findAlarms, readThresholds } from '../src/alarms';
import type { MonitorState } from '../src/api';
import { decodeChunks, decodeSquares, positionsOf } from '../src/chunks';
import { linkSeries, thinned } from '../src/link_series';

// One chunk of three vertices and a triangle, at north -16 m, east 32 m.
function batch(): ArrayBuffer {
  const buffer = new ArrayBuffer(24 + 24 + 3 * 28 + 8);
  const view = new DataView(buffer);
  [...'FMAP'].forEach((c, i) => view.setUint8(i, c.charCodeAt(0)));
  view.setUint32(4, 77, true);
  view.setUint32(8, 1, true);
  view.setFloat64(16, 1.79e9, true);
  view.setInt32(24, -1, true);
  view.setInt32(28, 2, true);
  view.setUint32(32, 3, true);
  view.setUint32(36, 1, true);
  view.setFloat32(40, 0.5, true);
  const body = 48;
  for (let v = 0; v < 3; ++v) {
    view.setUint16(body + 4 * v, v === 2 ? 128 : 0, true); // north
    view.setUint16(body + 4 * v + 2, v === 1 ? 256 : 0, true); // east
    view.setFloat32(body + 12 + 4 * v, 20 + v, true);
    view.setInt8(body + 24 + 4 * v + 2, 127);
    view.setUint8(body + 24 + 4 * v + 3, 5);
    view.setUint8(body + 36 + 4 * v + 3, 1);
    view.setUint16(body + 48 + 4 * v, 25, true);
    view.setFloat32(body + 60 + 8 * v, 100 + v, true);
    view.setFloat32(body + 64 + 8 * v, NaN, true);
    view.setUint16(body + 84 + 2 * v, v, true);
  }
  return buffer;
}

test('a map batch decodes field by field', () => {
  const { version, baseUtc, chunks } = decodeChunks(batch());
  assert.equal(version, 77);
  assert.equal(baseUtc, 1.79e9);
  const chunk = chunks[0]!;
  assert.deepEqual([chunk.key, chunk.north, chunk.east, chunk.vertices, chunk.triangles], ['-1/2', -16, 32, 3, 1]);
  assert.deepEqual([...chunk.depths], [20, 21, 22]);
  assert.deepEqual([...chunk.indices], [0, 1, 2]);
  assert.equal(chunk.bounds[4], 25);
  assert.equal(chunk.times[2], 101);
  assert.ok(Number.isNaN(chunk.times[3]));
  assert.deepEqual([...positionsOf(chunk, 20)], [0, 0, -0, 2, -1, -0, 0, -2, -1]);
});

test('a batch cut anywhere, or not a batch, is an error', () => {
  const whole = batch();
  for (let n = 0; n < whole.byteLength; ++n) assert.throws(() => decodeChunks(whole.slice(0, n)));
  assert.throws(() => decodeChunks(new ArrayBuffer(64)));
  assert.throws(() => decodeSquares(new ArrayBuffer(64)));
});

test('loss never goes below nothing, and thinning keeps frames', () => {
  const history = { start_utc_s: 1000, step_s: 10, steps: [[80, 3, 1, 0], [160, 5, -1, 2], [0, 0, 0, 0]] as [number, number, number, number][] };
  const [times, rates, losses] = linkSeries(history);
  assert.deepEqual(times, [1000, 1010, 1020, 1030]);
  assert.deepEqual(rates, [80, 160, 0, 0]);
  assert.deepEqual(losses, [25, 0, null, null]);
  const thin = thinned(history, 2);
  assert.equal(thin.step_s, 20);
  assert.deepEqual(thin.steps, [[120, 8, 0, 2], [0, 0, 0, 0]]);
});

const quiet = {
  recorded: false, not_kept: null, clocks_apart_s: 3, mission: null,
  link: { recent_loss: 0.2, accepted: 5, rejected: {} }, downlink: { paused: false },
  status: { battery_percent: 80, altitude_m: 2, position_sigma_m: 0.4, health: [] },
} as unknown as MonitorState;

test('alarms follow the thresholds, and silence is none in a recording', () => {
  assert.deepEqual(findAlarms(quiet, 10, DEFAULT_THRESHOLDS), []);
  const bad = { ...quiet, link: { ...quiet.link, recent_loss: 0.7 }, status: { battery_percent: 10, altitude_m: 0.4, position_sigma_m: 9, health: ['no depth'] } } as unknown as MonitorState;
  assert.deepEqual(findAlarms(bad, 500, DEFAULT_THRESHOLDS).map((a) => a.id), ['silence', 'battery', 'altitude', 'sigma', 'health:no depth', 'loss']);
  assert.ok(!findAlarms({ ...bad, recorded: true }, 500, DEFAULT_THRESHOLDS).some((a) => a.id === 'silence'));
  const ids = (more: object): string[] => findAlarms({ ...quiet, ...more } as MonitorState, 10, DEFAULT_THRESHOLDS).map((a) => a.id);
  assert.deepEqual(ids({ not_kept: 'received.bin cannot be written' }), ['disk']);
  const received = (accepted: number, rejected: object): object => ({ link: { recent_loss: 0.2, accepted, rejected } });
  assert.deepEqual(ids(received(0, { unkeyed: 3 })), ['unkeyed']);
  assert.deepEqual(ids(received(0, { 'bad-tag': 9 })), ['key']);
  assert.deepEqual(ids(received(5, { 'bad-tag': 9, unkeyed: 3, old: 1 })), ['old']);
  assert.deepEqual(ids({ downlink: { paused: true } }), ['paused']);
  assert.deepEqual(ids({ clocks_apart_s: -600 }), ['clocks']);
  assert.deepEqual(ids({ clocks_apart_s: -600, recorded: true }), []);
  assert.equal(findAlarms(bad, 500, { silence_s: 600, battery_percent: 5, loss_percent: 90, sigma_m: 10, altitude_m: 0.1 }).length, 1);
});

test('an acknowledged alarm is quiet until it has gone and come back', () => {
  const book = new AlarmBook();
  const alarm = { id: 'battery', severe: true, text: '' };
  const other = { id: 'loss', severe: false, text: '' };
  book.update([alarm, other]);
  book.acknowledge('battery');
  book.acknowledge('not there');
  assert.equal(book.open, 1);
  assert.deepEqual(book.standing.map((a) => a.id), ['loss', 'battery']);
  book.update([other]);
  book.update([alarm, other]);
  assert.equal(book.open, 2);
});

test('thresholds that the browser kept may be anything', () => {
  for (const text of [null, '', '{', '[]', 'null', '{"silence_s":"x","sigma_m":-1}']) assert.deepEqual(readThresholds(text), DEFAULT_THRESHOLDS);
  assert.equal(readThresholds('{"silence_s":30}').silence_s, 30);
});

