// End-to-end: fathom-topside serves a small dive, Chromium opens it, flies, clicks, measures and exports.
//   node browser.mjs FATHOM_TOPSIDE DIVE PAGE [CHROMIUM]
// Exits 77 (skipped) where Chromium is absent.
import assert from 'node:assert/strict';
import { cpSync, mkdtempSync, readFileSync, rmSync, unlinkSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import process from 'node:process';
import { needBrowser, openPage, runTest, serve, until } from '#tools/browser';

const [topside, dive, pageFolder, browserPath] = process.argv.slice(2);
needBrowser(browserPath);

const view = (folder) => serve(topside, 'view', folder, '--http', '0', '--page', pageFolder);
const { child: server, address: url } = await view(dive);
const scratch = mkdtempSync(join(tmpdir(), 'topside-page-'));
let second = null;

await runTest(browserPath, async (browser) => {
  const problems = [];
  const open = async (address) => {
    const page = await openPage(browser, address, problems, { viewport: { width: 1100, height: 760 }, acceptDownloads: true });
    page.setDefaultTimeout(150000); // machines that build at the same time are slow
    return page;
  };
  const page = await open(url);
  const data = (of = page) => of.evaluate(() => ({ ...document.body.dataset }));
  const rest = async (of = page) => {
    await of.waitForSelector('body[data-ready=true]');
    await of.waitForTimeout(700);
    await of.waitForSelector('body[data-ready=true]');
  };
  await rest();
  let shown = await data();
  assert.equal(shown.troubles ?? '0', '0', 'a whole dive opens without a complaint');
  assert.equal(await page.textContent('#dive-name'), 'synthetic-hills');
  assert.ok(Number(shown.bytes) > 1e5 && Number(shown.bytes) <= Number(shown.limit));
  assert.ok(Number(shown.calls) > 0 && Number(shown.calls) <= 300);

  // The picture is of the seafloor, from above and as shapes alone.
  const picture = async () => (await page.locator('#scene').screenshot()).toString('base64');
  const oblique = await picture();
  await page.click('#views button[data-value=top]');
  await rest();
  const fromAbove = await picture();
  assert.notEqual(oblique, fromAbove);

  // The compass points where a step to the north goes on the screen, turned by any angle.
  const whole = await page.locator('#scene').boundingBox();
  await page.mouse.move(whole.x + 300, whole.y + 300);
  await page.mouse.down({ button: 'right' });
  await page.mouse.move(whole.x + 400, whole.y + 300, { steps: 4 });
  await page.mouse.up({ button: 'right' });
  await rest();
  const [compass, northward] = await page.evaluate(() => {
    const { camera, focus } = window.fathom.view;
    const [from, to] = [focus.clone().project(camera), focus.clone().add({ x: 0, y: 0, z: -0.5 }).project(camera)];
    const turned = /rotate\((.*)deg\)/.exec(document.querySelector('#compass svg').style.transform);
    return [Number(turned[1]), (Math.atan2((to.x - from.x) * camera.aspect, to.y - from.y) * 180) / Math.PI];
  });
  assert.ok(Math.abs(compass) > 10 && Math.abs(compass - northward) < 2, `the compass shows ${compass} where north is at ${northward}`);
  await page.click('#views button[data-value=top]');
  await page.waitForSelector('body[data-ready=false]');
  await rest();
  await page.click('#surfaces button[data-value=plain]');
  await page.waitForTimeout(300);
  const plain = await picture();
  assert.notEqual(plain, fromAbove);
  await page.click('#surfaces button[data-value=wire]');
  await page.waitForTimeout(300);
  assert.notEqual(await picture(), plain);
  await page.click('#surfaces button[data-value=texture]');

  // Fly to a place by double clicks: finer tiles come, within the limits, and the click finds the same ground as the layer.
  const box = await page.locator('#scene').boundingBox();
  const [cx, cy] = [Math.round(box.x + box.width / 2), Math.round(box.y + box.height / 2)];
  const eye = async () => (await data()).eye.split(',').map(Number);
  const high = (await eye())[1];
  for (let i = 0; i < 2; ++i) {
    const before = (await data()).eye;
    await page.mouse.dblclick(cx, cy);
    await until(page, (from) => document.body.dataset.eye !== from, before);
    await rest();
  }
  assert.ok((await eye())[1] < high - 15, 'the camera came down');
  shown = await data();
  assert.ok(Number(shown.calls) <= 300 && Number(shown.bytes) <= Number(shown.limit));
  await page.mouse.click(cx, cy);
  await until(page, () => Number(document.body.dataset.thumbs) > 0);
  shown = await data();
  const truth = (n, e) => 20 + 1.5 * Math.sin(0.11 * n + 0.3) * Math.cos(0.09 * e) + 0.25 * Math.sin(0.9 * n + 0.7 * e) + 0.05 * Math.sin(5.1 * n) * Math.sin(4.3 * e);
  const [north, east, depth] = [shown.north, shown.east, shown.depth].map(Number);
  assert.ok(Math.abs(depth - truth(north, east)) < 0.02, `clicked ${depth} m deep where the seafloor is at ${truth(north, east)}`);
  assert.match(await page.textContent('#point-rows'), /28° 4[78]\.\d{5}′ S {2}113° 5[34]\.\d{5}′ E/);
  assert.match(await page.textContent('#point-rows'), /Uncertainty \(1 σ\)\d+\.\d mm/);

  // The images that saw it are those whose pinhole has it in the frame, by an independent reckoning.
  const { images, camera } = JSON.parse(readFileSync(join(dive, 'topside', 'images.json'), 'utf8'));
  const saw = images.filter(({ north: n, east: e, depth: d, q: [w, x, y, z] }) => {
    const v = [north - n, east - e, depth - d];
    const R = [[1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]];
    const [X, Y, Z] = R.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
    if (Z <= 0 || Math.hypot(X, Y, Z) > 5) return false;
    const [a, b] = [X / Z, Y / Z];
    const r2 = a * a + b * b;
    if (r2 > 1) return false;
    const k = 1 + r2 * (camera.k1 + r2 * camera.k2);
    const u = camera.fx * (a * k + 2 * camera.p1 * a * b + camera.p2 * (r2 + 2 * a * a)) + camera.cx;
    const t = camera.fy * (b * k + camera.p1 * (r2 + 2 * b * b) + 2 * camera.p2 * a * b) + camera.cy;
    return u >= 0 && t >= 0 && u <= camera.width - 1 && t <= camera.height - 1;
  });
  assert.equal(Number(shown.images), saw.length);
  assert.ok(saw.length > 0);

  // The best image in full, and draped over the model.
  await page.click('#images .thumb');
  await page.click('#image-actions button:has-text("Open")');
  await page.waitForSelector('#viewer:not([hidden])');
  assert.equal((await data()).viewer, `${camera.width}x${camera.height}`);
  await page.click('#viewer-close');
  const before = await picture();
  await page.click('#image-actions button:has-text("On the model")');
  await page.waitForTimeout(800);
  assert.notEqual(await picture(), before);

  // A line, a profile, an area.
  const words = () => page.textContent('#measure-text');
  await page.click('#tools button[data-value=profile]');
  await page.mouse.click(cx - 150, cy);
  await page.mouse.click(cx + 150, cy - 40);
  await page.keyboard.press('Enter');
  await page.waitForSelector('#profile canvas');
  const [, slope, horizontal] = /^([\d.]+) m · horizontal ([\d.]+) m/.exec(await words());
  assert.ok(Number(slope) >= Number(horizontal) && Number(horizontal) > 0.3);
  assert.equal((await data()).profile, '300');
  await page.click('#tools button[data-value=area]');
  for (const [x, y] of [[-120, -80], [120, -80], [120, 80], [-120, 80]]) await page.mouse.click(cx + x, cy + y);
  await page.keyboard.press('Enter');
  await until(page, () => /rugosity/.test(document.body.dataset.measured ?? ''));
  assert.ok(Number(/rugosity ([\d.]+)/.exec(await words())[1]) >= 1);
  assert.match(await words(), /above the corners' plane/);
  const [saved] = await Promise.all([page.waitForEvent('download'), page.click('#measure-save')]);
  const measured = join(scratch, saved.suggestedFilename());
  await saved.saveAs(measured);
  assert.deepEqual(JSON.parse(readFileSync(measured, 'utf8')).features.map((f) => f.geometry.type), ['LineString', 'Polygon']);
  await page.keyboard.press('Escape');

  // Eastings and northings of a system that only the server knows.
  await page.fill('#crs', 'EPSG:28356');
  await page.keyboard.press('Tab');
  await until(page, () => document.body.dataset.crs === '28356');
  await page.mouse.move(cx + 3, cy + 3);
  await until(page, () => / E .* N /.test(document.querySelector('#hover').textContent));

  // Annotate, export, read back into an empty list.
  await page.click('#tools button[data-value=annotate]');
  await page.mouse.click(cx + 20, cy + 30);
  await page.fill('.annotation .class', 'brittle star');
  await page.fill('.annotation .note', 'under a ledge');
  await page.keyboard.press('Tab');
  const download = async (selector) => {
    const [file] = await Promise.all([page.waitForEvent('download'), page.click(selector)]);
    const path = join(scratch, file.suggestedFilename());
    await file.saveAs(path);
    return path;
  };
  const geojson = await download('#export-geojson');
  const csv = await download('#export-csv');
  const [feature] = JSON.parse(readFileSync(geojson, 'utf8')).features;
  assert.equal(feature.properties.class, 'brittle star');
  assert.ok(feature.properties.images.length > 0 && Math.abs(feature.geometry.coordinates[0] - 113.9) < 0.001);
  assert.match(readFileSync(csv, 'utf8'), /brittle star,under a ledge,-28\.79/);
  await page.click('.annotation button[title=Remove]');
  assert.equal((await data()).annotations, '0');
  await page.setInputFiles('#annotations-input', csv);
  await until(page, () => document.body.dataset.annotations === '1');
  assert.equal(await page.inputValue('.annotation .note'), 'under a ledge');
  await page.keyboard.press('Escape');

  // Layers and what people bring: labels, multibeam as a raster and as a surface.
  await page.click('#tools button[data-value=explore]');
  await page.check('#layers input[value=slope]');
  await until(page, () => document.body.dataset.layer === 'slope');
  await page.waitForTimeout(300);
  assert.match(await page.textContent('#legend'), /Slope \[deg\].*0.*40/);
  await page.setInputFiles('#files-input', [join(dive, 'own', 'labels.csv'), join(dive, 'own', 'multibeam.tif')]);
  await until(page, () => document.body.dataset.layer === 'own:multibeam.tif' && document.body.dataset.labels === '3');
  assert.match(await page.textContent('#legend'), /latitude and longitude/);
  await page.click('#meshes button');
  await until(page, () => document.body.dataset.meshes === '1');
  assert.match(await page.textContent('#troubles'), /1 rows name no image/);

  // A layer that is broken says so, and the rest goes on.
  await page.click('#layers input[value=broken]'); // it does not stay chosen
  await until(page, () => /Broken layer: \w/.test(document.getElementById('troubles').textContent));

  // The timeline moves the vehicle.
  const timeline = await page.locator('#timeline .u-over').boundingBox();
  await page.mouse.click(timeline.x + timeline.width * 0.5, timeline.y + 30);
  await until(page, () => document.body.dataset.time !== undefined);
  assert.match(await page.textContent('#timeline-text'), /^14:2\d:\d\d · survey · altitude [12]\.\d\d m/);

  // The picture with its scale bar.
  const png = readFileSync(await download('#screenshot'));
  assert.deepEqual([...png.subarray(1, 4)], [...'PNG'].map((c) => c.charCodeAt(0)));
  await page.waitForTimeout(800);
  const [a, address] = [await data(), await page.evaluate(() => location.href)];

  // In little room the picture loses resolution and says so; it stays within its bytes and goes on.
  await page.keyboard.press('Home');
  await page.selectOption('#limit', '64');
  await page.evaluate(() => window.fathom.model.setLimit(6_000_000));
  await until(page, () => document.body.dataset.flying === 'false' && Number(document.body.dataset.bytes) <= 6_000_000);
  const above = (await data()).eye;
  await page.mouse.dblclick(cx, cy);
  await until(page, (from) => document.body.dataset.eye !== from, above);
  await page.waitForSelector('#badge:not([hidden])');
  await until(page, () => document.body.dataset.flying === 'false' && Number(document.body.dataset.visible) > 0 && Number(document.body.dataset.factor) > 1);
  shown = await data();
  assert.ok(Number(shown.bytes) <= 6_000_000, `${shown.bytes} bytes held of 6000000`);
  await page.close();

  // The address shows the same again.
  const again = await open(address);
  await rest(again);
  const b = await data(again);
  const [ea, eb] = [a, b].map((d) => d.eye.split(',').map(Number));
  assert.ok(Math.hypot(ea[0] - eb[0], ea[1] - eb[1], ea[2] - eb[2]) < 0.01, 'the address keeps the camera');
  await until(again, () => document.body.dataset.north !== undefined);
  assert.ok(Math.abs(Number((await data(again)).north) - Number(a.north)) < 0.01, 'and the selection');
  await again.close();
  assert.deepEqual(problems, []);

  // A dive with a broken and a missing tile: one line for each, and the rest is there.
  const hurt = join(scratch, 'hurt');
  cpSync(join(dive, 'topside'), join(hurt, 'topside'), { recursive: true });
  writeFileSync(join(hurt, 'topside/tiles/1/1_1.glb'), readFileSync(join(hurt, 'topside/tiles/1/1_1.glb')).subarray(0, 700));
  unlinkSync(join(hurt, 'topside/tiles/1/2_2.glb'));
  writeFileSync(join(hurt, 'topside/track.json'), '{"utc_ns":[');
  second = await view(hurt);
  const wounded = await open(second.address);
  await rest(wounded);
  await wounded.keyboard.down('+'); // near enough for the tiles of the middle level
  await until(wounded, () => /1\/2_2\.glb/.test(document.getElementById('troubles').textContent) && /1\/1_1\.glb/.test(document.getElementById('troubles').textContent));
  await wounded.keyboard.up('+');
  await rest(wounded);
  const troubles = await wounded.textContent('#troubles');
  assert.match(troubles, /tile 1\/1_1\.glb/);
  assert.match(troubles, /tile 1\/2_2\.glb: is missing/);
  assert.match(troubles, /track\.json is not whole/);

  // A folder of the user's own, without a server behind it.
  await wounded.goto(`${second.address}?dive=absent/`, { waitUntil: 'domcontentloaded' });
  await wounded.waitForSelector('#opener:not([hidden])');
  assert.match(await wounded.textContent('#troubles'), /scene\.json is missing \(404\)/);
  await wounded.setInputFiles('#folder-input', join(dive, 'topside'));
  await rest(wounded);
  assert.equal(await wounded.textContent('#dive-name'), 'synthetic-hills');
  await wounded.mouse.click(cx, cy);
  await until(wounded, () => Number(document.body.dataset.images) > 0);
  console.log(`browser test passed: ${shown.tiles} tiles, ${shown.calls} calls, first picture after ${a.first} ms`);
}, () => {
  server.kill('SIGTERM');
  second?.child.kill('SIGTERM');
  rmSync(scratch, { recursive: true, force: true });
});
