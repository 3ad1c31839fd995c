// Takes pictures of the viewer's page once a dive is open and its tiles are loaded.
//   node screenshot.mjs URL OUT.png [--size 1400x860] [--do "STEP; STEP"] [--timeout S] [--chromium PATH]
// Steps: key K, press SELECTOR, check SELECTOR, choose SELECTOR=VALUE, at X,Y (click), double X,Y, drag X0,Y0,X1,Y1, turn X0,Y0,X1,Y1,
// wheel X,Y,DELTA, files SELECTOR=PATH[,PATH], shot PATH, wait MS. Exits 0 with the pictures written, 1 otherwise, 2 on bad usage.
import { existsSync } from 'node:fs';
import process from 'node:process';
import { chromium } from 'playwright-core';

const [url, out, ...rest] = process.argv.slice(2);
const options = { size: '1400x860', do: '', timeout: '60', chromium: '/usr/bin/chromium' };
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
  console.error('usage: screenshot.mjs URL OUT.png [--size WxH] [--do STEPS] [--timeout S] [--chromium PATH]');
  process.exit(2);
}

const browser = await chromium.launch({
  executablePath: options.chromium,
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
});
try {
  const page = await browser.newPage({ viewport: { width, height } });
  page.on('pageerror', (error) => console.error(`screenshot: page error: ${error}`));
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  const rest = async () => {
    await page.waitForFunction(() => Number(document.body.dataset.visible) > 0 && document.body.dataset.loading === '0' && document.body.dataset.flying === 'false', null, { timeout: Number(options.timeout) * 1000 });
    await page.waitForTimeout(900);
    await page.waitForFunction(() => document.body.dataset.loading === '0', null, { timeout: Number(options.timeout) * 1000 });
  };
  await rest();
  const steps = {
    key: (k) => page.keyboard.press(k),
    press: (s) => page.click(s),
    check: (s) => page.check(s),
    choose: (s) => { const [selector, value] = s.split('='); return page.selectOption(selector, value); },
    at: (a) => page.mouse.click(...a.split(',').map(Number)),
    double: (a) => page.mouse.dblclick(...a.split(',').map(Number)),
    drag: (a) => sweep(a, 'left'),
    turn: (a) => sweep(a, 'right'),
    wheel: async (a) => {
      const [x, y, delta] = a.split(',').map(Number);
      await page.mouse.move(x, y);
      for (let i = 0; i < 10; ++i) {
        await page.mouse.wheel(0, delta / 10);
        await page.waitForTimeout(40);
      }
    },
    files: (s) => { const at = s.indexOf('='); return page.setInputFiles(s.slice(0, at), s.slice(at + 1).split(',')); },
    shot: async (path) => { await rest(); await page.screenshot({ path }); },
    wait: (ms) => page.waitForTimeout(Number(ms)),
  };
  async function sweep(a, button) {
    const [x0, y0, x1, y1] = a.split(',').map(Number);
    await page.mouse.move(x0, y0);
    await page.mouse.down({ button });
    await page.mouse.move((x0 + x1) / 2, (y0 + y1) / 2, { steps: 6 });
    await page.mouse.move(x1, y1, { steps: 6 });
    await page.mouse.up({ button });
  }
  for (const step of options.do.split(';').map((s) => s.trim()).filter((s) => s !== '')) {
    const [verb, ...what] = step.split(' ');
    if (!steps[verb]) throw new Error(`no step ${verb}`);
    await steps[verb](what.join(' '));
  }
  await rest();
  await page.screenshot({ path: out });
  const d = await page.evaluate(() => ({ ...document.body.dataset }));
  console.log(`screenshot: ${out} (${d.visible} tiles, ${d.triangles} triangles, ${d.calls} calls, ${d.bytes} bytes, ${d.frame} ms a frame, ${d.troubles ?? 0} troubles)`);
} catch (error) {
  console.error(`screenshot: ${String(error.message ?? error).split('\n')[0]}`);
  process.exitCode = 1;
} finally {
  await browser.close();
}
