// Takes pictures of either page once it shows all that it has (its body says data-ready="true").
//   node tools/screenshot.mjs URL OUT.png [--size 1400x860] [--do "STEP; STEP"] [--timeout S] [--chromium PATH]
// Steps: key K, press SELECTOR, check SELECTOR, choose SELECTOR=VALUE, fill SELECTOR=VALUE, at X,Y (click), double X,Y,
// drag X0,Y0,X1,Y1, turn X0,Y0,X1,Y1 (right button), wheel X,Y,DELTA, files SELECTOR=PATH[,PATH], shot PATH, wait MS. Exits 0 with
// the pictures written, 1 otherwise, 2 on bad usage.
import process from 'node:process';
import { launch, readOptions } from '#tools/browser';

const { url, out, options, width, height } = readOptions('tools/screenshot.mjs URL OUT.png', ['url', 'out'], { size: '1400x860', do: '', timeout: '60' });
const browser = await launch(options.chromium);
try {
  const page = await browser.newPage({ viewport: { width, height } });
  page.on('pageerror', (error) => console.error(`screenshot: page error: ${error}`));
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  const rest = async () => {
    const ready = () => page.waitForSelector('body[data-ready=true]', { timeout: Number(options.timeout) * 1000 });
    await ready();
    await page.waitForTimeout(900);
    await ready();
  };
  await rest();
  const pair = (s) => [s.slice(0, s.lastIndexOf('=')), s.slice(s.lastIndexOf('=') + 1)];
  const steps = {
    key: (k) => page.keyboard.press(k),
    press: (s) => page.click(s),
    check: (s) => page.check(s),
    choose: (s) => page.selectOption(...pair(s)),
    fill: (s) => page.fill(...pair(s)),
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
    files: (s) => { const [selector, paths] = pair(s); return page.setInputFiles(selector, paths.split(',')); },
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
  console.log(`screenshot: ${out} (${d.triangles} triangles, ${d.bytes} bytes, ${d.frame} ms a frame)`);
} catch (error) {
  console.error(`screenshot: ${String(error.message ?? error).split('\n')[0]}`);
  process.exitCode = 1;
} finally {
  await browser.close();
}
