// End-to-end: fathom-monitor plays a sample dive, Chromium shows it.
//   node browser.mjs FATHOM_MONITOR PACKETS PAGE [CHROMIUM]
// Exits 77 (skipped) where Chromium is absent.
import assert from 'node:assert/strict';
import process from 'node:process';
import { needBrowser, openPage, runTest, serve, until } from '#tools/browser';

const [monitorPath, packets, pageFolder, browserPath] = process.argv.slice(2);
needBrowser(browserPath);

const start = (port) => serve(monitorPath, '--packets', packets, '--http', port, '--page', pageFolder);
let { child: monitor, address: url } = await start('0');
const port = new URL(url).port;

await runTest(browserPath, async (browser) => {
  const problems = [];
  const page = await openPage(browser, url, problems, { viewport: { width: 1000, height: 700 } });
  const all = () =>
    until(page, () => document.body.dataset.finished === 'true' && Number(document.body.dataset.chunks) > 0, null, { timeout: 60000 });
  await all();
  const state = await (await fetch(`${url}api/state`)).json();
  const shown = await page.evaluate(() => ({ ...document.body.dataset }));
  assert.equal(Number(shown.chunks), state.map.chunks, 'every received chunk is in the scene');
  assert.equal(Number(shown.track), state.track_points, 'the whole track is drawn');
  assert.ok(state.map.area_m2 > 500 && state.track_points > 100);

  const text = (name) => page.textContent(`[data-name="${name}"]`);
  assert.equal(await text('vehicle'), 'sirius');
  assert.equal(await text('depth'), `${state.status.depth_m.toFixed(1)} m`);
  assert.equal(await text('heading'), `${state.status.heading_deg.toFixed(0)}°`);
  assert.match(await text('time'), /^2026-09-21 14:3\d:\d\d UTC$/);
  assert.equal(Number((await text('accepted')).replaceAll(' ', '')), state.link.accepted);
  assert.ok(state.link.lost > 0);
  assert.match(await text('lost'), new RegExp(`^${state.link.lost} \\(`));
  assert.equal(await page.isVisible('#banner'), false, 'a recording at its end is not a silent link');

  // Nothing is clipped at 1000 pixels: no element of the panel reaches beyond it.
  const beyond = await page.evaluate(() => {
    const right = document.getElementById('panel').getBoundingClientRect().right;
    return [...document.querySelectorAll('#panel *')].filter((e) => e.getBoundingClientRect().right > right + 0.5).map((e) => e.outerHTML.slice(0, 80));
  });
  assert.deepEqual(beyond, []);
  assert.equal(await page.evaluate(() => document.getElementById('panel').scrollWidth <= document.getElementById('panel').clientWidth), true);

  // Alarms are acknowledged; what a recording cannot do says why.
  assert.match(await page.textContent('[data-alarm^="health:"]'), /no position fix/);
  await page.click('[data-alarm^="health:"] button');
  assert.match(await page.getAttribute('[data-alarm^="health:"]', 'class'), /acknowledged/);
  assert.equal(await page.isDisabled('#set-rate'), true);
  assert.match(await page.textContent('#command-reason'), /recording/);

  // The map is really drawn: the picture holds many colours, and others in another mode, without a new chunk.
  const picture = async () => (await page.locator('#scene').screenshot()).toString('base64');
  const depth = await picture();
  await page.click('#modes button[data-value=coverage]');
  await page.waitForTimeout(300);
  const coverage = await picture();
  assert.ok(depth.length > 20000, 'the picture of the map is not empty');
  assert.notEqual(depth, coverage, 'the map changes colour with the mode');

  // A line over the map: its length and its profile.
  await page.click('#tools button[data-value=measure]');
  const onMap = []; // pixels under which there is map: there the pointer's place is shown
  for (let x = 200; x < 480; x += 20) {
    await page.mouse.move(x, 330);
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    if (await page.isVisible('#hover')) onMap.push(x);
  }
  assert.ok(onMap.length > 4, `map under ${onMap.length} of 14 pixels`);
  await page.mouse.move(onMap.at(0), 330);
  await page.mouse.down();
  await page.mouse.move(onMap.at(-1), 330, { steps: 3 });
  await page.mouse.up();
  await page.waitForSelector('#profile canvas', { timeout: 10000 });
  const [, slope, horizontal] = /^([\d.]+) m · horizontal ([\d.]+) m/.exec(await page.textContent('#measure-text'));
  assert.ok(Number(slope) >= Number(horizontal) && Number(horizontal) > 1);
  await page.click('#measure-close');

  // Back to the middle of the recording: less map, an earlier time, and on to the end again.
  const { first_utc_s: first, last_utc_s: last } = state.playback;
  const seek = (utc) =>
    page.evaluate((value) => {
      const slider = document.getElementById('time-slider');
      slider.value = String(value);
      slider.dispatchEvent(new Event('input'));
      slider.dispatchEvent(new Event('change'));
    }, utc);
  await seek((first + last) / 2);
  await until(page, (epoch) => document.body.dataset.epoch !== epoch && document.body.dataset.finished === 'false', shown.epoch, { timeout: 10000 });
  const half = await (await fetch(`${url}api/state`)).json();
  assert.ok(half.map.area_m2 < 0.7 * state.map.area_m2 && half.now_utc_s < last - 100);
  await seek(last);
  await until(page, (vertices) => document.body.dataset.vertices === vertices, shown.vertices, { timeout: 10000 });

  // The monitor goes away: the page says so, and takes the new one's map when it is back.
  const over = new Promise((done) => monitor.on('exit', done));
  monitor.kill('SIGTERM');
  assert.equal(await over, 0, 'fathom-monitor exits cleanly on SIGTERM');
  await page.waitForSelector('#banner:not([hidden])', { timeout: 20000 });
  assert.match(await page.textContent('#banner'), /does not answer/);
  const before = await page.evaluate(() => document.body.dataset.epoch);
  ({ child: monitor } = await start(port));
  await page.waitForSelector('#banner', { state: 'hidden', timeout: 20000 });
  await until(page, (epoch) => document.body.dataset.epoch !== epoch, before, { timeout: 20000 });
  await all();
  assert.equal(await page.evaluate(() => document.body.dataset.vertices), shown.vertices);
  assert.deepEqual(problems, []);
  console.log(`browser test passed: ${shown.chunks} chunks, ${shown.track} track points`);
}, () => monitor.kill('SIGKILL'));
