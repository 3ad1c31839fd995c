// Takes a picture of the monitor's page once the map shows something.
//   node screenshot.mjs URL OUT.png [--chunks N] [--mode depth|photo|sigma|age|coverage] [--view fit|top]
//                       [--size 1400x860] [--height FACTOR] [--contours yes] [--measure X0,Y0,X1,Y1]
//                       [--timeout S] [--chromium PATH]
// Exits 0 with the picture written, 1 when the page did not come to show the map in time, 2 on bad usage.
import { existsSync } from 'node:fs';
import process from 'node:process';
import { chromium } from 'playwright-core';

const [url, out, ...rest] = process.argv.slice(2);
const options = { chunks: '1', mode: 'depth', view: '', size: '1400x860', timeout: '60', height: '', contours: '', measure: '', chromium: '/usr/bin/chromium' };
for (let i = 0; i < rest.length; i += 2) {
  const name = rest[i]?.replace(/^--/, '');
  if (!name || !(name in options) || rest[i + 1] === undefined) {
    console.error(`screenshot: unknown or unfinished option ${rest[i]}`);
    process.exit(2);
  }
  options[name] = rest[i + 1];
}
const [width, height] = options.size.split('x').map(Number);
if (!url || !out || !width || !height || !existsSync(options.chromium)) {
  console.error('usage: screenshot.mjs URL OUT.png [--chunks N] [--mode M] [--view V] [--size WxH] [--timeout S] [--chromium PATH]');
  process.exit(2);
}

const browser = await chromium.launch({
  executablePath: options.chromium,
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
try {
  const page = await browser.newPage({ viewport: { width, height } });
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  await page.waitForFunction((chunks) => Number(document.body.dataset.chunks ?? 0) >= chunks, Number(options.chunks), {
    timeout: Number(options.timeout) * 1000,
  });
  await page.click(`#modes button[data-value=${options.mode}]`);
  if (options.view) await page.click(`#views button[data-value=${options.view}]`);
  if (options.height) await page.fill('#exaggeration', options.height);
  if (options.contours) await page.check('#contours');
  if (options.measure) {
    const [x0, y0, x1, y1] = options.measure.split(',').map(Number);
    await page.click('#tools button[data-value=measure]');
    await page.mouse.move(x0, y0);
    await page.mouse.down();
    await page.mouse.move((x0 + x1) / 2, (y0 + y1) / 2, { steps: 3 });
    await page.mouse.move(x1, y1, { steps: 3 });
    await page.mouse.up();
  }
  // Two frames: one to take the change, one to have it drawn.
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  await page.waitForTimeout(500);
  await page.screenshot({ path: out });
  const d = await page.evaluate(() => ({ ...document.body.dataset }));
  console.log(`screenshot: ${out} (${d.chunks} chunks, ${d.triangles} triangles, ${d.bytes} bytes, ${d.frame} ms a frame)`);
} catch (error) {
  console.error(`screenshot: ${String(error.message ?? error).split('\n')[0]}`);
  process.exitCode = 1;
} finally {
  await browser.close();
}
