// End-to-end: a dive of folders left/ and right/ of PNG, JPEG and TIFF becomes a model, and Chromium shows the images
// that saw a place of it.
//   node folders.mjs FATHOM_TOPSIDE DIVE PAGE [CHROMIUM]
// Exits 77 (skipped) where Chromium is absent.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import process from 'node:process';
import { needBrowser, openPage, runTest, serve, until } from '#tools/browser';

const [topside, dive, pageFolder, browserPath] = process.argv.slice(2);
needBrowser(browserPath);
execFileSync(topside, ['run', dive, '--jobs', '2'], { stdio: ['ignore', 'ignore', 'inherit'] });
const read = (name) => JSON.parse(readFileSync(join(dive, 'topside', name), 'utf8'));
const scene = read('scene.json');
assert.deepEqual([scene.origin, scene.image_format, scene.image_bits, scene.mission], [null, 'rgb', 8, '..'], 'nobody said where the dive was');
const { images } = read('images.json');
assert.ok(images.length >= 28 && images.every((i) => i.utc_ns === null && i.altitude > 1 && i.altitude < 4));
const [head, first] = readFileSync(join(dive, 'topside', 'images.csv'), 'utf8').split('\n').map((line) => line.split(','));
for (const [column, known] of [['utc', false], ['latitude_deg', false], ['altitude_m', true], ['north_m', true]]) assert.equal(first[head.indexOf(column)] !== '', known, column);

const { child, address } = await serve(topside, 'view', dive, '--http', '0', '--page', pageFolder);
await runTest(browserPath, async (browser) => {
  const context = await browser.newContext({ viewport: { width: 1400, height: 860 } });
  const page = await openPage(context, address, []);
  page.setDefaultTimeout(150000);
  await page.waitForSelector('body[data-ready=true]');
  const troubles = () => page.textContent('#troubles');
  assert.match(await troubles(), /nobody says where on the Earth/);
  assert.doesNotMatch(await troubles(), /left out/);
  // Places seen by images of each kind: their names and what was decoded of them.
  const shown = new Set(), marked = [];
  for (const image of images) {
    const kind = image.left.split('.').at(-1);
    if (shown.has(kind)) continue;
    await page.evaluate(({ north, east, depth, altitude }) => {
      document.body.dataset.thumbs = '0';
      window.fathom.select({ north, east, depth: depth + altitude });
    }, image);
    await until(page, () => Number(document.body.dataset.thumbs) >= Math.min(12, Number(document.body.dataset.images)));
    const thumb = page.locator(`#images .thumb[title^="${image.left}"]`);
    if ((await thumb.count()) === 0) continue;
    assert.match(await thumb.getAttribute('title'), /time unknown/);
    const [bright, spread] = await thumb.evaluate((button) => {
      const { data } = button.querySelector('canvas').getContext('2d').getImageData(0, 0, 100, 80);
      const grey = Array.from({ length: data.length / 4 }, (_, i) => (data[4 * i] + data[4 * i + 1] + data[4 * i + 2]) / 3);
      const mean = grey.reduce((a, b) => a + b) / grey.length;
      return [mean, Math.sqrt(grey.reduce((a, b) => a + (b - mean) ** 2, 0) / grey.length)];
    });
    assert.ok(bright > 30 && bright < 225 && spread > 3, `${image.left}: mean ${bright}, spread ${spread}`);
    await thumb.click();
    await page.click('#image-actions button:has-text("Open")');
    await page.waitForSelector('#viewer:not([hidden])');
    const { width, height } = read('images.json').camera;
    assert.equal(await page.evaluate(() => document.body.dataset.viewer), `${width}x${height}`);
    // Its middle marked as two surveyed points, of which one is taken back.
    const middle = await page.locator('#viewer-canvas').boundingBox();
    for (const point of ['P1', 'P2']) {
      await page.fill('#mark-point', point);
      await page.mouse.click(middle.x + middle.width / 2, middle.y + middle.height / 2);
      await page.waitForSelector('#mark-remove:not([hidden])');
    }
    await page.click('#mark-remove');
    await page.click('#viewer-close');
    marked.push([image.left, (width - 1) / 2, (height - 1) / 2]);
    shown.add(kind);
  }
  assert.deepEqual([...shown].sort(), ['jpg', 'png', 'tif']);
  assert.doesNotMatch(await troubles(), /image /);
  const [saved] = await Promise.all([page.waitForEvent('download'), page.click('#export-marks')]);
  assert.equal(saved.suggestedFilename(), 'marks.csv');
  const [columns, ...rows] = readFileSync(await saved.path(), 'utf8').trim().split('\n').map((line) => line.split(','));
  assert.deepEqual(columns, ['point', 'image', 'u', 'v']);
  assert.equal(rows.length, marked.length);
  for (const [k, [image, u, v]] of marked.entries()) {
    assert.deepEqual(rows[k].slice(0, 2), ['P1', image]);
    assert.ok(Math.abs(rows[k][2] - u) < 1.5 && Math.abs(rows[k][3] - v) < 1.5, `${rows[k]}: marked at ${u}, ${v}`);
  }

  // Keys move the view after a box was ticked, too.
  await page.check('#show-contours');
  const before = await page.evaluate(() => document.body.dataset.eye);
  await page.keyboard.down('d');
  await until(page, (eye) => document.body.dataset.eye !== eye, before);
  await page.keyboard.up('d');

  // What is marked in one tab is in the other, and belongs to these images, whatever the dive is called.
  const other = await openPage(context, address, []);
  await other.waitForSelector('body[data-ready=true]');
  await page.evaluate(() => window.fathom.annotations.add({ north: 0, east: 0, depth: 2 }, []));
  await until(other, () => document.body.dataset.annotations === '1');
  await other.evaluate(() => window.fathom.annotations.add({ north: 1, east: 0, depth: 2 }, []));
  await page.evaluate(() => document.activeElement.blur()); // while somebody writes there the list stays as it is
  await until(page, () => document.body.dataset.annotations === '2');
  assert.ok((await page.evaluate(() => Object.keys(localStorage))).includes(`fathom annotations ${scene.id}`));
}, () => child.kill());
