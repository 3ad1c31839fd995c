// Measures the viewer over a dive against its targets: first picture, main-thread time a frame while flying, bytes held, draw
// calls. Opens the page, flies from the whole dive to single images at places spread over it and back, pans and turns there.
//   node viewer/measure.mjs URL [--size 1400x860] [--places 5] [--limit BYTES] [--json yes] [--chromium PATH]
import { launch, nextFrame, noteWork, percentiles, readOptions, until } from '#tools/browser';

const { url, options, width, height } = readOptions('viewer/measure.mjs URL', ['url'], { places: '5', limit: '', json: '' });
const browser = await launch(options.chromium);
const TARGETS = { first_picture_ms: 2000, frame_ms: 10, calls: 300 };
try {
  const page = await browser.newPage({ viewport: { width, height } });
  await noteWork(page);
  await page.addInitScript((limit) => limit && localStorage.setItem('fathom limit', limit), options.limit);
  await page.goto(url, { waitUntil: 'domcontentloaded' });
  await page.waitForSelector('body[data-ready=true]', { timeout: 120000 });
  await page.waitForTimeout(600);
  const first = await page.evaluate(() => Number(document.body.dataset.first));
  // The most of what the page tells of itself, looked at in every frame from here on.
  await page.evaluate(() => {
    window.most_ = { bytes: 0, held: 0, calls: 0, triangles: 0, factor: 1 };
    const look = () => {
      const { stats } = window.fathom.model;
      const { calls, triangles } = window.fathom.view;
      const now = { bytes: stats.bytes, held: stats.bytes + window.fathom.look.bytes, calls, triangles, factor: stats.factor };
      for (const key of Object.keys(now)) window.most_[key] = Math.max(window.most_[key], now[key]);
      setTimeout(look, 8);
    };
    look();
  });
  await page.evaluate((places) => {
    window.frames_.length = 0;
    const { view } = window.fathom;
    const { min, max } = view.home;
    window.goals_ = Array.from({ length: places }, (_, i) => {
      const [s, t] = [(i + 0.5) / places, ((i * 0.618) % 1) * 0.8 + 0.1];
      return [min.x + (max.x - min.x) * s, min.z + (max.z - min.z) * t];
    });
  }, Number(options.places));
  const flight = async (make) => {
    await page.evaluate(make);
    await page.waitForTimeout(120);
    await until(page, () => !window.fathom.view.flying, null, { timeout: 60000 });
  };
  const [cx, cy] = [Math.round((width - 390) / 2), Math.round(height / 2.4)];
  for (let i = 0; i < Number(options.places); ++i) {
    await flight(`{
      const { view } = window.fathom;
      const [x, z] = window.goals_[${i}];
      const y = view.heightAt(x, z) ?? (view.home.min.y + view.home.max.y) / 2;
      const at = view.home.min.clone().set(x, y, z);
      view.flyTo(at.clone().add({ x: 0.3, y: 2.2, z: 1.1 }), at);
    }`);
    await page.waitForTimeout(500);
    for (const button of ['left', 'right']) {
      await page.mouse.move(cx, cy);
      await page.mouse.down({ button });
      for (let k = 0; k < 25; ++k) {
        await page.mouse.move(cx + 6 * k, cy + 3 * k);
        await nextFrame(page);
      }
      await page.mouse.up({ button });
    }
    await flight('{ const { view } = window.fathom; const w = view.wholeView(false); view.flyTo(w.eye, w.look, w.up); }');
  }
  const result = await page.evaluate(() => ({ frames: window.frames_, most: window.most_, limit: window.fathom.model.limit, heap: performance.memory?.usedJSHeapSize }));
  const own = result.frames.map(([all, gl]) => all - gl);
  const frame = percentiles(own);
  const report = {
    first_picture_ms: Math.round(first), frames: own.length,
    frame_ms: frame, frame_with_gl_ms: percentiles(result.frames.map(([all]) => all)),
    most_bytes: result.most.bytes, limit: result.limit, layers_too: result.most.held, most_calls: result.most.calls, most_triangles: result.most.triangles, most_factor: result.most.factor, heap_bytes: result.heap,
  };
  if (options.json) console.log(JSON.stringify(report));
  else {
    const line = (what, value, target, good) => console.log(`| ${what} | ${value} | ${target} | ${good ? 'met' : 'not met'} |`);
    console.log('| what | measured | target | |\n| --- | --- | --- | --- |');
    line('first picture', `${report.first_picture_ms} ms`, 'under 2 s', report.first_picture_ms < TARGETS.first_picture_ms);
    line('main thread a frame while flying, without the GL driver', `median ${frame.median}, 95 % ${frame.p95}, most ${frame.most} ms (${own.length} frames)`, 'at most 10 ms', frame.p95 <= TARGETS.frame_ms);
    line('bytes held by tiles, most', `${(report.most_bytes / 1e6).toFixed(0)} MB of ${(report.limit / 1e6).toFixed(0)} MB`, 'inside the limit', report.most_bytes <= report.limit);
    line('draw calls, most', report.most_calls, 'at most 300', report.most_calls <= TARGETS.calls);
  }
} finally {
  await browser.close();
}
