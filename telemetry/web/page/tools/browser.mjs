// What the pages' browser tests, screenshots and measurements share: Chromium without a screen, and a program that serves a page.
import { spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import process from 'node:process';
import { createInterface } from 'node:readline';
import { chromium } from 'playwright-core';

const CHROMIUM = '/usr/bin/chromium';
const SKIPPED = 77;

export const launch = (path = CHROMIUM) =>
  chromium.launch({ executablePath: path, args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--enable-precise-memory-info'] });

// Ends the test as skipped where there is no browser.
export function needBrowser(path = CHROMIUM) {
  if (existsSync(path)) return;
  console.log(`SKIPPED: ${path} is absent`);
  process.exit(SKIPPED);
}

// Words first, then `--name value` for each of `defaults`. Exits 2 on bad usage.
export function readOptions(usage, words, defaults) {
  const options = { size: '1400x860', chromium: CHROMIUM, ...defaults };
  const all = [...Object.keys(options)].map((name) => `[--${name} ${options[name] === '' ? name.toUpperCase() : options[name]}]`).join(' ');
  const fail = (why) => {
    console.error(`${why}\nusage: node ${usage} ${all}`);
    process.exit(2);
  };
  const given = process.argv.slice(2);
  const found = Object.fromEntries(words.map((word) => [word, given.shift() ?? fail(`${word} is missing`)]));
  for (let i = 0; i < given.length; i += 2) {
    const name = given[i].replace(/^--/, '');
    if (!(name in options) || given[i + 1] === undefined) fail(`unknown or unfinished option ${given[i]}`);
    options[name] = given[i + 1];
  }
  const [width, height] = options.size.split('x').map(Number);
  if (!width || !height) fail(`--size ${options.size} is none`);
  if (!existsSync(options.chromium)) fail(`${options.chromium} is absent`);
  return { ...found, options, width, height };
}

// Starts a program and gives it with the address that it prints.
export async function serve(program, ...args) {
  const child = spawn(program, args);
  const address = await new Promise((found, failed) => {
    createInterface(child.stdout).on('line', (line) => {
      const match = /http:\/\/\S+/.exec(line);
      if (match) found(match[0]);
    });
    child.on('exit', (code) => failed(new Error(`${program} exited with ${code}`)));
  });
  child.removeAllListeners('exit');
  return { child, address };
}

// Opens an address in a new tab. `problems` gets the page's errors, what its policy forbids it and what it fetches from elsewhere.
export async function openPage(browser, address, problems, options = {}) {
  const page = await browser.newPage(options);
  page.on('pageerror', (error) => problems.push(String(error)));
  page.on('console', (message) => {
    if (/Content.Security.Policy/i.test(message.text())) problems.push(message.text());
  });
  page.on('request', (request) => {
    if (!/^(http:\/\/127\.0\.0\.1:|data:|blob:)/.test(request.url())) problems.push(`fetches ${request.url()}`);
  });
  await page.goto(address, { waitUntil: 'domcontentloaded' });
  return page;
}

// Waits until a condition, of the page's own, holds. Playwright's waitForFunction evaluates text in the page, which its policy forbids.
export async function until(page, condition, argument, { timeout = 150000 } = {}) {
  const end = Date.now() + timeout;
  while (!(await page.evaluate(condition, argument))) {
    if (Date.now() > end) throw new Error(`after ${timeout} ms there is not: ${condition}`);
    await page.waitForTimeout(20);
  }
}

// Runs a test with a browser, prints what failed with the messages of each open page, and always cleans up.
export async function runTest(browserPath, test, cleanUp) {
  const browser = await launch(browserPath);
  try {
    await test(browser);
  } catch (error) {
    console.error(String(error.stack ?? error).split('\n').slice(0, 16).join('\n'));
    for (const page of browser.contexts().flatMap((context) => context.pages()))
      console.error(await page.evaluate(() => JSON.stringify(document.body.dataset)).catch(() => 'page gone'));
    process.exitCode = 1;
  } finally {
    await browser.close();
    cleanUp();
  }
}

// Has a page note, in each animation frame, its own work and how much of it the GL driver's calls took: window.frames_ holds
// [ms, ms of GL]. Long tasks go to window.tasks_ [ms].
export const noteWork = (page) =>
  page.addInitScript(() => {
    Object.assign(window, { frames_: [], tasks_: [], gl_: 0 });
    new PerformanceObserver((list) => window.tasks_.push(...list.getEntries().map((e) => e.duration))).observe({ entryTypes: ['longtask'] });
    const proto = WebGL2RenderingContext.prototype;
    for (const name of Object.getOwnPropertyNames(proto)) {
      const call = Object.getOwnPropertyDescriptor(proto, name).value;
      if (typeof call !== 'function') continue;
      proto[name] = function (...args) {
        const begun = performance.now();
        const result = call.apply(this, args);
        window.gl_ += performance.now() - begun;
        return result;
      };
    }
    const request = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (callback) =>
      request((time) => {
        const [begun, gl] = [performance.now(), window.gl_];
        callback(time);
        window.frames_.push([performance.now() - begun, window.gl_ - gl]);
      });
  });

export const nextFrame = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => done())));

export function percentiles(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const at = (share) => Number((sorted[Math.floor(share * (sorted.length - 1))] ?? 0).toFixed(2));
  return { median: at(0.5), p95: at(0.95), most: at(1) };
}
