// Measures how light the page is with a whole dive open: turns the map and reports the main thread's work.
//   node monitor/measure.mjs URL [--size 1400x860] [--frames 120] [--chromium PATH]
// Prints JSON: ms a frame of the page's own work, with and without the GL driver's, and of everything on the main thread,
// triangles, bytes the map holds, JavaScript heap, and the longest task while the map was loading.
import { launch, nextFrame, noteWork, percentiles, readOptions } from '#tools/browser';

const LEAST_DRAWN = 0.05; // of a frame in which something was drawn [ms]
const { url, options, width, height } = readOptions('monitor/measure.mjs URL', ['url'], { frames: '120' });
const browser = await launch(options.chromium);
try {
  const page = await browser.newPage({ viewport: { width, height } });
  await noteWork(page);
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  await page.waitForSelector('body[data-ready=true]:not([data-finished=false])', { timeout: 120000 });
  await page.waitForTimeout(6000);
  const loading = await page.evaluate(() => { window.frames_.length = 0; return window.tasks_; });
  const client = await page.context().newCDPSession(page);
  await client.send('Performance.enable');
  const metric = async () => Object.fromEntries((await client.send('Performance.getMetrics')).metrics.map((m) => [m.name, m.value]));
  const before = await metric();
  await page.mouse.move(width * 0.3, height * 0.5);
  await page.mouse.down();
  for (let i = 0; i < Number(options.frames); ++i) {
    await page.mouse.move(width * 0.3 + 2 * i, height * 0.5 + 20 * Math.sin(i / 10));
    await nextFrame(page);
  }
  await page.mouse.up();
  const after = await metric();
  const result = await page.evaluate(() => ({ frames: window.frames_, data: { ...document.body.dataset }, heap: performance.memory?.usedJSHeapSize }));
  const drawn = result.frames.filter(([all]) => all > LEAST_DRAWN);
  console.log(JSON.stringify({
    frames: drawn.length, frame_ms: percentiles(drawn.map(([all, gl]) => all - gl)), frame_with_gl_ms: percentiles(drawn.map(([all]) => all)),
    main_thread_ms_a_frame: Number((((after.TaskDuration - before.TaskDuration) * 1000) / Number(options.frames)).toFixed(2)),
    script_ms_a_frame: Number((((after.ScriptDuration - before.ScriptDuration) * 1000) / Number(options.frames)).toFixed(2)),
    triangles: Number(result.data.triangles), vertices: Number(result.data.vertices), chunks: Number(result.data.chunks),
    map_bytes: Number(result.data.bytes), heap_bytes: result.heap,
    longest_task_while_loading_ms: Math.round(Math.max(0, ...loading)),
  }));
} finally {
  await browser.close();
}
