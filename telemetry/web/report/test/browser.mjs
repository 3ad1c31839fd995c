// The built report in Chromium, from a file: all of its parts are there, and it fetches nothing.
//   node browser.mjs REPORT.html [CHROMIUM]      a report as report_page_test leaves it
// Exits 77 (skipped) where Chromium is absent.
import assert from 'node:assert/strict';
import { resolve } from 'node:path';
import process from 'node:process';
import { pathToFileURL } from 'node:url';
import { needBrowser, runTest } from '#tools/browser';

const [report, browserPath] = process.argv.slice(2);
needBrowser(browserPath);

await runTest(browserPath, async (browser) => {
  const page = await browser.newPage();
  const problems = [];
  page.on('pageerror', (error) => problems.push(String(error)));
  page.on('request', (request) => { if (!/^(file|data):/.test(request.url())) problems.push(`fetches ${request.url()}`); });
  await page.goto(pathToFileURL(resolve(report)).href);
  await page.waitForSelector('h1');
  assert.equal(await page.textContent('h1'), 'A dive </script> & more');
  assert.deepEqual(await page.locator('h2').allTextContents(), ['Words', 'Figures']);
  assert.deepEqual(await page.locator('td').allTextContents(), ['pairs', '8', 'off [px]', '0.5']);
  assert.equal(await page.locator('li').count(), 2);
  assert.equal(await page.locator('.strong').count(), 1);
  assert.deepEqual(await page.locator('figcaption').allTextContents(), ['A picture', 'Track', 'Decades']);
  assert.equal(await page.evaluate(() => document.querySelector('img').naturalWidth), 1);
  assert.notEqual(await page.evaluate(() => getComputedStyle(document.querySelectorAll('td')[3]).backgroundColor), 'rgba(0, 0, 0, 0)', 'a shaded cell');
  // Line and area are really drawn: their colours are in the canvas; and nothing joins the line's two parts.
  const { red, blue, middle } = await page.evaluate(() => {
    const canvas = document.querySelector('canvas');
    const { data, width, height } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    const rows = new Array(height).fill(0);
    let blue = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i + 3] < 200) continue;
      if (data[i] > 200 && data[i + 1] < 60 && data[i + 2] < 60) ++rows[Math.floor(i / 4 / width)];
      if (data[i + 2] > 200 && data[i] < 60) ++blue;
    }
    const first = rows.findIndex((n) => n > 0);
    const last = rows.findLastIndex((n) => n > 0);
    return { red: rows.reduce((a, b) => a + b), blue, middle: rows[Math.round(first + 0.6 * (last - first))] };
  });
  assert.ok(red > 100, `${red} pixels of the line`);
  assert.ok(blue > 1000, `${blue} pixels of the area`);
  assert.equal(middle, 0, 'nothing joins the two parts of the line');
  assert.deepEqual(problems, []);
  console.log('browser test passed');
}, () => undefined);
