// Pictures of a glTF file by three.js in a headless Chromium: `node draw.mjs MODULES CHROMIUM < JOB`.
// JOB is JSON: { environment, width, shift, views: [{ eye, sun }], center, distance, fov, file, out }; eye and sun are unit
// vectors from the asset, y up, sun is null where the environment shines. Into `out` go the views one after the other, width x width
// pixels each, moved by `shift` of them to the left and up, rows from the top: linear premultiplied RGBA as halves.

import { createReadStream, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import http from 'node:http';
import { createRequire } from 'node:module';
import os from 'node:os';
import path from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';

const [modules, chromium] = process.argv.slice(2);
const job = JSON.parse(readFileSync(0, 'utf8'));
const require = createRequire(pathToFileURL(path.resolve(modules, 'package.json')));
const puppeteer = (await import(pathToFileURL(require.resolve('puppeteer-core')).href)).default;

const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.mjs': 'text/javascript', '.wasm': 'application/wasm' };
const own = path.dirname(fileURLToPath(import.meta.url));
const roots = [own, path.resolve(modules, 'node_modules/three'), ...[job.environment, job.file].map((file) => path.dirname(path.resolve(file)))];
const posted = [];

/** The path of a file in the folder of this number. */
function served(folder, file) {
  return `/${folder}/${encodeURIComponent(path.basename(file))}`;
}

const server = http.createServer((request, response) => {
  if (request.method === 'POST') {
    const parts = [];
    request.on('data', (part) => parts.push(part));
    request.on('end', () => {
      posted.push(Buffer.concat(parts));
      response.end();
    });
    return;
  }
  const [, folder, ...rest] = decodeURIComponent(new URL(request.url, 'http://x').pathname).split('/');
  const file = roots[folder] && path.join(roots[folder], path.normalize(`/${rest.join('/')}`));
  if (!file || !statSync(file, { throwIfNoEntry: false })?.isFile()) {
    response.writeHead(404).end();
    return;
  }
  response.writeHead(200, { 'content-type': TYPES[path.extname(file)] ?? 'application/octet-stream' });
  createReadStream(file).pipe(response);
});
await new Promise((done) => server.listen(0, '127.0.0.1', done));

const profile = mkdtempSync(path.join(os.tmpdir(), 'three-'));
const root = process.getuid?.() === 0 ? ['--no-sandbox'] : [];
let browser;
try {
  browser = await puppeteer.launch({
    executablePath: chromium,
    headless: true,
    userDataDir: profile,
    protocolTimeout: 3_600_000,
    // The renderer of every machine, with a graphics card or without.
    args: ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-dev-shm-usage', '--disable-gpu-watchdog', ...root],
  });
  const page = await browser.newPage();
  // A texture that is not read is told there alone.
  const said = [];
  page.on('console', (message) => message.type() === 'error' && said.push(message.text()));
  page.on('pageerror', (error) => said.push(String(error)));
  await page.goto(`http://127.0.0.1:${server.address().port}/0/page.html`);
  await page.waitForFunction('window.draw', { timeout: 60_000 }).catch(() => {
    throw new Error(`the page does not start: ${said.join('; ')}`);
  });
  await page.evaluate((o) => window.draw.begin(o), { environment: served(2, job.environment), width: job.width, shift: job.shift, fov: job.fov });
  said.length = 0;
  await page.evaluate((url) => window.draw.load(url), served(3, job.file));
  for (const view of job.views) {
    await page.evaluate((o) => window.draw.view(o), { ...view, center: job.center, distance: job.distance });
  }
  if (said.length) throw new Error(said.join('; '));
  writeFileSync(job.out, Buffer.concat(posted));
} catch (error) {
  console.error(String(error.message ?? error));
  process.exitCode = 1;
} finally {
  await browser?.close();
  server.close();
  rmSync(profile, { recursive: true, force: true });
}
