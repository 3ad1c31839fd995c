// Measures how light the page is with a whole dive open: turns the map and reports the main thread's work.
//   node measure.mjs URL [--chunks N] [--size 1400x860] [--frames 120] [--chromium PATH]
// Prints JSON: ms a frame (median, 95th percentile) of the page's own work and of everything on the main thread, triangles,
// bytes the map holds, JavaScript heap, and the longest task while the map was loading.
import process from 'node:process';
import { chromium } from 'playwright-core';

const [url, ...rest] = process.argv.slice(2);
const options = { chunks: '1', size: '1400x860', frames: '120', chromium: '/usr/bin/chromium' };
for (let i = 0; i < rest.length; i += 2) options[rest[i].replace(/^--/, '')] = rest[i + 1];
const [width, height] = options.size.split('x').map(Number);
const browser = await chromium.launch({
  executablePath: options.chromium,
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--enable-precise-memory-info'],
});
try {
  const page = await browser.newPage({ viewport: { width, height } });
  await page.addInitScript(() => {
    window.tasks = [];
    new PerformanceObserver((list) => window.tasks.push(...list.getEntries().map((e) => e.duration))).observe({ entryTypes: ['longtask'] });
    // The page's own work in every frame: its animation callbacks.
    window.work = [];
    const request = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (callback) =>
      request((time) => {
        const begun = performance.now();
        callback(time);
        window.work.push(performance.now() - begun);
      });
  });
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  await page.waitForFunction((n) => document.body.dataset.finished !== 'false' && Number(document.body.dataset.chunks ?? 0) >= n, Number(options.chunks), { timeout: 120000 });
  await page.waitForTimeout(6000);
  const loading = await page.evaluate(() => ({ tasks: window.tasks.splice(0), frames: window.work.splice(0).length }));
  const client = await page.context().newCDPSession(page);
  await client.send('Performance.enable');
  const metric = async () => Object.fromEntries((await client.send('Performance.getMetrics')).metrics.map((m) => [m.name, m.value]));
  const before = await metric();
  await page.mouse.move(width * 0.3, height * 0.5);
  await page.mouse.down();
  for (let i = 0; i < Number(options.frames); ++i) {
    await page.mouse.move(width * 0.3 + 2 * i, height * 0.5 + 20 * Math.sin(i / 10));
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => done())));
  }
  await page.mouse.up();
  const after = await metric();
  const result = await page.evaluate(() => {
    const drawn = window.work.filter((ms) => ms > 0.05).sort((a, b) => a - b);
    return { drawn, data: { ...document.body.dataset }, heap: performance.memory?.usedJSHeapSize };
  });
  const at = (share) => Number((result.drawn[Math.floor(share * (result.drawn.length - 1))] ?? 0).toFixed(2));
  console.log(JSON.stringify({
    frames: result.drawn.length,
    page_ms_a_frame: { median: at(0.5), p95: at(0.95) },
    main_thread_ms_a_frame: Number((((after.TaskDuration - before.TaskDuration) * 1000) / Number(options.frames)).toFixed(2)),
    script_ms_a_frame: Number((((after.ScriptDuration - before.ScriptDuration) * 1000) / Number(options.frames)).toFixed(2)),
    triangles: Number(result.data.triangles), vertices: Number(result.data.vertices), chunks: Number(result.data.chunks),
    map_bytes: Number(result.data.bytes), heap_bytes: result.heap,
    longest_task_while_loading_ms: Math.round(Math.max(0, ...loading.tasks)),
  }));
} finally {
  await browser.close();
}
