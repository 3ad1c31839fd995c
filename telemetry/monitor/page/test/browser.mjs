// End-to-end: fathom-monitor plays a sample dive, Chromium shows it.
//   node browser.mjs FATHOM_MONITOR PACKETS PAGE [CHROMIUM]
// Exits 77 (skipped) where Chromium is absent.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import process from 'node:process';
import { createInterface } from 'node:readline';
import { chromium } from 'playwright-core';

const [monitorPath, packets, pageFolder, browserPath = '/usr/bin/chromium'] = process.argv.slice(2);
if (!existsSync(browserPath)) {
  console.log(`SKIPPED: ${browserPath} is absent`);
  process.exit(77);
}

const monitor = spawn(monitorPath, ['--packets', packets, '--http', '0', '--page', pageFolder]);
const url = await new Promise((found, failed) => {
  createInterface(monitor.stdout).on('line', (line) => {
    const match = /http:\/\/\S+/.exec(line);
    if (match) found(match[0]);
  });
  monitor.on('exit', (code) => failed(new Error(`fathom-monitor exited with ${code}`)));
});

const browser = await chromium.launch({
  executablePath: browserPath,
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
let failure = null;
try {
  const page = await browser.newPage({ viewport: { width: 1000, height: 700 } });
  const problems = [];
  page.on('pageerror', (error) => problems.push(String(error)));
  page.on('request', (request) => {
    if (!request.url().startsWith(url) && !request.url().startsWith('data:')) problems.push(`fetches ${request.url()}`);
  });
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  await page.waitForFunction(() => document.body.dataset.finished === 'true' && Number(document.body.dataset.tiles) > 0, null, {
    timeout: 60000,
  });
  const state = await (await fetch(`${url}api/state`)).json();
  const shown = await page.evaluate(() => ({ ...document.body.dataset }));
  assert.equal(Number(shown.tiles), state.map.tiles, 'every received tile is in the scene');
  assert.equal(Number(shown.track), state.track_points, 'the whole track is drawn');
  assert.ok(state.map.tiles > 50 && state.track_points > 100);

  const text = (name) => page.textContent(`[data-name="${name}"]`);
  assert.equal(await text('vehicle'), 'sirius');
  assert.equal(await text('depth'), `${state.status.depth_m.toFixed(1)} m`);
  assert.equal(await text('heading'), `${state.status.heading_deg.toFixed(0)}°`);
  assert.match(await text('time'), /^2026-09-21 14:3\d:\d\d$/);
  assert.match(await text('health'), /no position fix/);
  assert.equal(Number((await text('accepted')).replaceAll(' ', '')), state.link.accepted);
  assert.ok(state.link.lost > 0);
  assert.match(await text('lost'), new RegExp(`^${state.link.lost} \\(`));
  assert.equal(await page.isVisible('#banner'), false, 'a recording at its end is not a silent link');

  // The map is really drawn: the picture holds many colours, and others in another mode.
  const picture = async () => (await page.locator('#scene').screenshot()).toString('base64');
  const depth = await picture();
  await page.click('#modes button[data-value=sigma]');
  await page.waitForTimeout(300);
  const sigma = await picture();
  assert.ok(depth.length > 20000, 'the picture of the map is not empty');
  assert.notEqual(depth, sigma, 'the map changes colour with the mode');

  // The monitor goes away: the page says so.
  monitor.removeAllListeners('exit');
  const ended = new Promise((done) => monitor.on('exit', done));
  monitor.kill('SIGTERM');
  assert.equal(await ended, 0, 'fathom-monitor exits cleanly on SIGTERM');
  await page.waitForSelector('#banner:not([hidden])', { timeout: 20000 });
  assert.match(await page.textContent('#banner'), /does not answer/);
  assert.deepEqual(problems, []);
  console.log(`browser test passed: ${shown.tiles} tiles, ${shown.track} track points`);
} catch (error) {
  failure = error;
} finally {
  await browser.close();
  monitor.kill('SIGKILL');
}
if (failure) {
  console.error(failure);
  process.exit(1);
}
