// SPDX-License-Identifier: Apache-2.0
//
// The page of the web view in headless Chromium, against what shiftmap-inspect says of the same store.
// Usage: node web_view_test.mjs BIN_DIR NODE_MODULES; exits 77, skipped, without Chromium.
import assert from 'node:assert/strict';
import {execFileSync, spawn, spawnSync} from 'node:child_process';
import {existsSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync} from 'node:fs';
import {request} from 'node:http';
import {createRequire} from 'node:module';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {pathToFileURL} from 'node:url';
import {rhythmicMap} from './rhythmic_map.mjs';

const [bin, modules] = process.argv.slice(2);
const chromium = ['/usr/bin/chromium', '/usr/bin/chromium-browser'].find(existsSync);
if (!chromium || !existsSync(join(modules ?? '', 'puppeteer-core'))) {
  console.log('skipped: no Chromium, or no web view in this build');
  process.exit(77);
}
const puppeteer = createRequire(join(modules, 'index.js'))('puppeteer-core');
const folder = mkdtempSync(join(tmpdir(), 'shiftmap-web-'));
const file = (name) => join(folder, name);
const run = (program, ...args) =>
  execFileSync(join(bin, program), args, {encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'], maxBuffer: 1 << 28});
const inspect = (command, ...args) =>
  JSON.parse(run('shiftmap-inspect', command, ...args, '--json', '--quiet'));
const floor = ['--store', file('maps.db'), '--area', 'floor'];

const browser = await puppeteer.launch({
  executablePath: chromium, headless: true,
  args: ['--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'],
});

// A page that notes whatever it asks for and complains of.
async function open(url, {width = 1280, height = 800, scheme = 'light'} = {}) {
  const page = await browser.newPage();
  page.complaints = [];
  page.requests = [];
  page.on('console', (message) => page.complaints.push(message.text()));
  page.on('pageerror', (error) => page.complaints.push(String(error)));
  page.on('dialog', (dialog) => { page.complaints.push('a dialog'); dialog.dismiss(); });
  page.on('request', (r) => { if (r.url() !== url) page.requests.push(r.url()); });
  await page.setViewport({width, height});
  await page.emulateMediaFeatures([{name: 'prefers-color-scheme', value: scheme}]);
  await page.goto(url);
  await settle(page);
  return page;
}
const openFile = (name, options) => open(pathToFileURL(file(name)).href, options);
const settle = (page) =>
  page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
const text = (page, selector) => page.$eval(selector, (element) => element.textContent.trim());
const texts = (page, selector) =>
  page.$$eval(selector, (elements) => elements.map((element) => element.textContent.trim()));

// The number of colours in a picture of the page, which stays in the folder until the end.
async function coloursOf(page, name) {
  const png = await page.screenshot({path: file(`${name}.png`)});
  const reader = await browser.newPage();
  const colours = await reader.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const image = await createImageBitmap(new Blob([bytes], {type: 'image/png'}));
    const canvas = new OffscreenCanvas(image.width, image.height).getContext('2d');
    canvas.drawImage(image, 0, 0);
    return new Set(new Uint32Array(canvas.getImageData(0, 0, image.width, image.height).data.buffer)).size;
  }, Buffer.from(png).toString('base64'));
  await reader.close();
  return colours;
}

async function find(page, signature) {
  await page.$eval('#search', (field) => { field.value = ''; });
  await page.type('#search', signature);
  await page.keyboard.press('Enter');
  await settle(page);
}

async function setTime(page, seconds) {
  await page.$eval('#time-text', (field, value) => {
    field.value = value;
    field.dispatchEvent(new Event('change'));
  }, String(seconds));
}

// The probabilities that the panel shows, by mode.
async function shownProbabilities(page) {
  const rows = await page.$$eval('#landmark .number', (values) =>
    values.map((value) => [value.closest('tr').cells[0].textContent, value.textContent]));
  return rows.map(([mode, value]) => [mode === 'absent' ? 0 : Number(mode.replace('mode ', '')),
    value.startsWith('<') ? 0 : value.startsWith('>') ? 1 : parseFloat(value) / 100]);
}

async function expectProbabilities(page, signature, seconds, area = floor) {
  const group = inspect('show', ...area, '--at', String(seconds)).groups
    .find((g) => g.signature === signature);
  const shown = await shownProbabilities(page);
  assert.equal(shown.length, group.modes.length);
  for (const [mode, value] of shown) {
    const expected = group.modes.find((m) => m.mode === mode).probability;
    // The text has a resolution of 0.1 %, or is cut below that.
    assert.ok(Math.abs(value - expected) <= 1.1e-3,
      `${signature} mode ${mode} at ${seconds}: page ${value}, product ${expected}`);
  }
}

function importMap(store, rows) {
  const quoted = (cell) => `"${String(cell).replaceAll('"', '""')}"`;
  writeFileSync(file('map.csv'), ['signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability',
    ...rows.map((row) => row.map(quoted).join(','))].join('\n') + '\n');
  run('shiftmap-mapper', 'import', '--store', file(store), '--area', 'hall', file('map.csv'));
}

const tests = {
  async 'The page opens from a file, asks for nothing and complains of nothing'() {
    const page = await openFile('floor.html');
    assert.equal(await text(page, '#area'), 'floor');
    assert.deepEqual(page.requests, []);
    assert.deepEqual(page.complaints, []);
    assert.equal(await page.$eval('html', (html) => html.scrollWidth <= innerWidth), true);
  },

  async 'Pages are painted, by day and by night'() {
    for (const name of ['floor', 'replay']) {
      for (const scheme of ['light', 'dark']) {
        const page = await openFile(`${name}.html`, {scheme});
        const colours = await coloursOf(page, `${name}-${scheme}`);
        assert.ok(colours > 20, `${name}, ${scheme}: ${colours} colours`);
      }
    }
    const empty = await browser.newPage();
    assert.equal(await coloursOf(empty, 'empty'), 1);
  },

  async 'A click on a landmark shows its history, every visit in it'() {
    const page = await openFile('floor.html');
    await find(page, 'L07');
    await page.keyboard.press('Escape');
    await page.$eval('#map', (map) => map.focus());
    await page.keyboard.press('Escape');
    assert.equal(await page.$('#landmark h2'), null);
    const box = await (await page.$('#map')).boundingBox();
    // What was found is in the middle of what the rulers leave.
    await page.mouse.click(box.x + box.width / 2 + 14, box.y + box.height / 2 - 10);
    await settle(page);
    assert.equal(await text(page, '#landmark h2'), 'L07');
    const data = await page.$eval('#data', (element) => JSON.parse(element.textContent));
    const group = data.maps[0][1].findIndex((row) => data.signatures[row[0]] === 'L07');
    assert.ok(data.visits[group].length > 5);
    assert.equal((await page.$$('#landmark button.link')).length, data.visits[group].length);
    assert.match((await texts(page, '#landmark button.link'))[0], /^\d\d:\d\d:\d\d$/);
    assert.deepEqual(page.complaints, []);
  },

  async 'The probabilities are those of the product at any time after the build'() {
    const page = await openFile('floor.html');
    const stamp = inspect('show', ...floor, '--at', '1').stamp_s;
    let changes = 0;
    for (const signature of ['L01', 'L05', 'L11', 'L16', 'L20']) {
      await find(page, signature);
      let before = '';
      for (const after of [1, 86000, 86520.5, 86600.25, 172950.5, 400000]) {
        await setTime(page, stamp + after);
        await expectProbabilities(page, signature, stamp + after);
        const now = JSON.stringify(await shownProbabilities(page));
        changes += now !== before ? 1 : 0;
        before = now;
      }
    }
    assert.ok(changes > 15, `${changes}`);
  },

  async 'The probabilities follow the rhythm of a landmark'() {
    const map = rhythmicMap();
    const area = ['--store', file('rhythm.db'), '--area', 'hall'];
    writeFileSync(file('rhythm.json'), JSON.stringify(map));
    run('shiftmap-mapper', 'import', ...area, file('rhythm.json'));
    run('shiftmap-inspect', 'export', '--html', ...area, '--output', file('rhythm.html'));
    const page = await openFile('rhythm.html');
    const stamp = Number(map.stamp_ns) / 1e9;
    for (const [signature, named] of [['day', 'hour of the day'], ['week', 'hour of the week']]) {
      await find(page, signature);
      assert.match(await text(page, '#landmark'), new RegExp(`by a rate for each ${named}`));
      for (const after of [3600, 5.3 * 3600, 2.4 * 86400, 6.99 * 86400, 20.9 * 86400]) {
        await setTime(page, stamp + after);
        await expectProbabilities(page, signature, stamp + after, area);
      }
    }
    assert.deepEqual(page.complaints, []);
  },

  async 'Ellipses are relative until those in the map frame are asked for'() {
    const page = await openFile('floor.html');
    await find(page, 'L11');
    const cell = () => page.$eval('#landmark tbody tr:nth-child(2)', (line) => line.cells[4].textContent);
    const axes = async () => (await cell()).split(' × ').map(Number);
    const relative = await axes();
    const drawn = await page.$eval('#map', (map) => map.toDataURL());
    assert.match(await text(page, '#ellipse-key'), /free network.*\(sd [\d.]+ %\)$/);
    assert.match((await texts(page, '#landmark th')).join(), /rel\. 1σ/);
    await page.select('#ellipses', 'map');
    await settle(page);
    assert.notEqual(await page.$eval('#map', (map) => map.toDataURL()), drawn);
    assert.match(await text(page, '#ellipse-key'), /map frame$/);
    assert.match((await texts(page, '#landmark th')).join(), /map 1σ/);
    const inMap = await axes();
    // In the map frame they are those of `show`, which has their covariance.
    const [xx, xy, yy] = inspect('show', ...floor).groups.find((g) => g.signature === 'L11').modes[1].cov_m2;
    const middle = (xx + yy) / 2;
    const half = Math.hypot((xx - yy) / 2, xy);
    const expected = [middle + half, middle - half].map((variance) => 100 * Math.sqrt(variance));
    inMap.forEach((axis, i) => assert.ok(Math.abs(axis - expected[i]) < 0.06, `${inMap}, ${expected}`));
    assert.ok(relative[0] < inMap[0], `${relative}, ${inMap}`);
    await page.select('#ellipses', 'relative');
    await settle(page);
    assert.equal(await page.$eval('#map', (map) => map.toDataURL()), drawn);
    // A survey states no covariance between positions.
    const survey = await openFile('rhythm.html');
    assert.equal(await survey.$eval('#ellipses', (choice) => choice.hidden), true);
    assert.deepEqual(page.complaints, []);
  },

  async 'The slider moves the probabilities by keyboard'() {
    const page = await openFile('floor.html');
    await find(page, 'L11');
    await page.focus('#time');
    await page.keyboard.press('End');
    for (let i = 0; i < 3; ++i) {
      await page.keyboard.press('ArrowLeft');
      const shown = await text(page, '#selection');
      assert.ok(shown.startsWith('L11'));
    }
    const seconds = Date.parse((await page.$eval('#time-text', (f) => f.value)).replace(' ', 'T') + 'Z') / 1000;
    await expectProbabilities(page, 'L11', seconds);
    const end = JSON.stringify(await shownProbabilities(page));
    await page.keyboard.press('Home');
    assert.notEqual(JSON.stringify(await shownProbabilities(page)), end);
  },

  async 'Versions stand side by side with what moved, is new and is gone'() {
    const page = await openFile('floor.html');
    await page.click('#tab-versions');
    await page.select('#version-from', '1');
    await settle(page);
    const [from, to] = [1, 3].map((version) =>
      new Map(inspect('show', ...floor, '--version', String(version)).groups.flatMap((group) =>
        group.modes.slice(1).map((mode) => [`${group.signature} mode ${mode.mode}`, mode]))));
    const moved = [...to].filter(([key, mode]) => {
      const old = from.get(key);
      if (!old) return false;
      const [xx, xy, yy] = mode.cov_m2.map((value, i) => value + old.cov_m2[i]);
      const [dx, dy] = [mode.x_m - old.x_m, mode.y_m - old.y_m];
      return (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy) > -2 * Math.log(0.01);
    });
    const listed = async (kind) => (await page.$$eval(`#changes .${kind} tbody tr`, (lines) =>
      lines.map((line) => `${line.cells[0].textContent} ${line.cells[1].textContent}`))).sort();
    const fresh = [...to.keys()].filter((key) => !from.has(key)).sort();
    assert.ok(fresh.length > 3);
    assert.deepEqual(await listed('fresh'), fresh);
    assert.deepEqual(await listed('gone'), [...from.keys()].filter((key) => !to.has(key)).sort());
    assert.deepEqual(await listed('moved'), moved.map(([key]) => key).sort());
    assert.match(await text(page, '#map-caption'), /^Version 1, as built 2026/);
    assert.match(await text(page, '#map-2-caption'), /^Version 3/);
    await page.click('#tab-overview');
    assert.equal(await page.$eval('#second', (figure) => figure.hidden), true);
    assert.deepEqual(page.complaints, []);
  },

  async 'The list of uncertain landmarks says of which no state is decided'() {
    const page = await openFile('floor.html');
    const {groups, stamp_s: seconds} = inspect('show', ...floor);
    await setTime(page, seconds);
    await settle(page);
    const rows = await page.$$eval('#overview tbody tr', (lines) =>
      lines.map((line) => [line.cells[0].textContent, line.cells[1].textContent]));
    const decided = rows.filter(([signature, state]) => {
      const best = Math.max(...groups.find((g) => g.signature === signature).modes.map((m) => m.probability));
      assert.equal(state.endsWith(', undecided'), best <= 0.5005, `${signature} ${state} ${best}`);
      return best > 0.5005;
    });
    assert.ok(decided.length > 0 && decided.length < rows.length, String(rows));
    assert.deepEqual(page.complaints, []);
  },

  async 'All of it works by keyboard'() {
    const page = await openFile('floor.html');
    const picture = () => page.$eval('#map', (map) => map.toDataURL());
    await page.keyboard.press('/');
    assert.equal(await page.evaluate(() => document.activeElement.id), 'search');
    await page.keyboard.type('l1');
    await page.keyboard.press('ArrowDown');
    const second = await text(page, '#search-list [aria-selected=true]');
    await page.keyboard.press('Enter');
    await settle(page);
    assert.equal(await text(page, '#landmark h2'), second);
    await page.$eval('#map', (map) => map.focus());
    let before = await picture();
    for (const key of ['ArrowLeft', '+', '-', '0', 'n', 'p']) {
      await page.keyboard.press(key);
      await settle(page);
      const now = await picture();
      assert.notEqual(now, before, key);
      before = now;
    }
    await page.focus('#tab-landmark');
    await page.keyboard.press('ArrowRight');
    assert.equal(await page.$eval('#tab-versions', (tab) => tab.getAttribute('aria-selected')), 'true');
    await page.focus('#help');
    await page.keyboard.press('Enter');
    assert.equal(await page.$eval('#help-dialog', (dialog) => dialog.open), true);
    assert.match(await text(page, '#help-dialog pre'), /d3-zoom .*ISC[\s\S]*uplot .*MIT/);
    await page.keyboard.press('Escape');
    assert.equal(await page.$eval('#help-dialog', (dialog) => dialog.open), false);
    // Every control has a name.
    const nameless = await page.$$eval('button, input, select, canvas[tabindex]', (controls) =>
      controls.filter((c) => !(c.textContent.trim() || c.getAttribute('aria-label') || c.labels?.length))
        .map((c) => c.id));
    assert.deepEqual(nameless.filter((id) => id !== 'map-2'), []);
    assert.deepEqual(page.complaints, []);
  },

  async 'It follows the colours of the system and fits a small screen'() {
    const page = await openFile('floor.html', {width: 390, height: 760, scheme: 'dark'});
    const luminance = () => page.$eval('#map', (map) => {
      const [r, g, b] = map.getContext('2d').getImageData(map.width - 4, 4, 1, 1).data;
      return (r + g + b) / 3;
    });
    assert.ok(await luminance() < 60);
    assert.equal(await page.$eval('html', (html) => html.scrollWidth), 390);
    await page.emulateMediaFeatures([{name: 'prefers-color-scheme', value: 'light'}]);
    await settle(page);
    assert.ok(await luminance() > 200);
  },

  async 'A recorded shift is replayed with states, innovations and hypotheses'() {
    const page = await openFile('replay.html');
    assert.equal(await page.$eval('#tab-replay', (tab) => tab.getAttribute('aria-selected')), 'true');
    const at = async (share) => {
      await page.$eval('#time', (slider, value) => {
        slider.value = String(value);
        slider.dispatchEvent(new Event('input'));
      }, 10000 * share);
      await settle(page);
      return texts(page, '#replay .facts dd');
    };
    const middle = await at(0.5);
    assert.ok(['TRACKING', 'MODE_CHANGED', 'UNKNOWN_CHANGE'].includes(middle[0]), middle[0]);
    const end = await at(1);
    assert.notEqual(end[1], middle[1]);
    const last = readFileSync(file('shift.tum'), 'utf8').trim().split('\n').at(-1).split(' ').map(Number);
    const [x, y] = end[1].split(/[ ,m]+/).map(Number);
    assert.ok(Math.hypot(x - last[1], y - last[2]) < 0.3, `${end[1]}, ${last}`);
    const decisions = JSON.parse(shiftJson).decisions;
    assert.ok(decisions.length > 3);
    const rows = await page.$$eval('#replay tbody', (bodies) =>
      [...bodies.at(-1).rows].map((line) => line.cells[2].textContent));
    assert.equal(rows.filter((mode) => !mode.includes('withdrawn')).length >= decisions.length, true);
    assert.equal((await page.$$('#replay .uplot')).length, 2);
    assert.deepEqual(page.complaints, []);
  },

  async 'Hostile names are text'() {
    const names = [
      '<script>hit=1</script>', '</script><script>hit=1</script>', '<img src=x onerror=hit=1>',
      '=HYPERLINK("http://x")', '\u2028\u2029', '\u001b[31mred', '<!--<script>', '{{DATA}}', "'\"><b>",
    ];
    importMap('hostile.db', names.map((name, i) => [name, 1, i, 0, 0.1, 0.1, 0.9]));
    run('shiftmap-inspect', 'export', '--html', '--store', file('hostile.db'), '--area', 'hall',
      '--output', file('hostile.html'));
    const page = await openFile('hostile.html');
    for (let i = 0; i < names.length; ++i) {
      await page.keyboard.press('n');
      await settle(page);
    }
    await page.type('#search', '<');
    await settle(page);
    const found = await texts(page, '#search-list li');
    assert.ok(found.includes('<script>hit=1</script>') && found.includes('<img src=x onerror=hit=1>'));
    assert.equal(await page.evaluate(() => window.hit), undefined);
    assert.equal((await page.$$('script')).length, 2);
    assert.equal((await page.$$('img, b, aside script')).length, 0);
    assert.deepEqual(page.requests, []);
    assert.deepEqual(page.complaints, []);
  },

  async 'Ten thousand modes'() {
    const rows = [];
    for (let i = 0; i < 10000; ++i) {
      rows.push([`L${Math.floor(i / 2)}`, i % 2 + 1, (i * 7919 % 10007) / 10, (i * 104729 % 9973) / 10,
        0.05, 0.2, 0.3 + 0.2 * (i % 2)]);
    }
    importMap('large.db', rows);
    run('shiftmap-inspect', 'export', '--html', '--store', file('large.db'), '--area', 'hall',
      '--output', file('large.html'));
    const size = statSync(file('large.html')).size;
    assert.ok(size < 5e6, `${size} bytes`);
    const page = await openFile('large.html');
    const box = await (await page.$('#map')).boundingBox();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    const rates = [];
    for (const zooms of [0, 6]) {
      await page.focus('#map');
      for (let i = 0; i < zooms; ++i) await page.keyboard.press('+');
      await page.mouse.move(x, y);
      await page.mouse.down();
      const frames = page.evaluate(() => new Promise((done) => {
        const begin = performance.now();
        let count = 0;
        const tick = (now) => {
          ++count;
          if (now - begin > 1500) done(1000 * count / (now - begin));
          else requestAnimationFrame(tick);
        };
        requestAnimationFrame(tick);
      }));
      let moving = true;
      frames.then(() => { moving = false; });
      for (let i = 0; moving; ++i) await page.mouse.move(x + 150 * Math.sin(i / 9), y + 100 * Math.cos(i / 7));
      rates.push((await frames).toFixed(0));
      await page.mouse.up();
    }
    console.log(`  ${(size / 1e6).toFixed(2)} MB; panning all of it ${rates[0]}, nearer ${rates[1]} frames per second`);
    assert.deepEqual(page.complaints, []);
  },

  async 'The server answers browsers of this machine, and nothing else'() {
    const server = spawn(join(bin, 'shiftmap-inspect'), ['view', ...floor], {stdio: ['ignore', 'pipe', 'pipe']});
    const ended = new Promise((done) => server.on('exit', done));
    const port = await new Promise((done) => {
      let said = '';
      server.stderr.on('data', (chunk) => {
        said += chunk;
        const match = /http:\/\/127\.0\.0\.1:(\d+)\//.exec(said);
        if (match) done(Number(match[1]));
      });
    });
    const ask = (method, path, headers = {}) => new Promise((done, fail) => {
      const sent = request({host: '127.0.0.1', port, method, path, headers, agent: false}, (answer) => {
        let body = '';
        answer.on('data', (chunk) => { body += chunk; });
        answer.on('end', () => done({code: answer.statusCode, headers: answer.headers, body}));
      });
      sent.on('error', fail);
      sent.end();
    });
    const page = await open(`http://127.0.0.1:${port}/`);
    assert.equal(await text(page, '#area'), 'floor');
    assert.deepEqual(page.requests.filter((url) => !url.endsWith('/favicon.ico')), []);
    assert.deepEqual(page.complaints.filter((c) => !c.includes('favicon') && !c.includes('404')), []);
    const got = await ask('GET', '/');
    assert.equal(got.code, 200);
    const policy = /http-equiv="Content-Security-Policy" content="([^"]*)"/.exec(got.body)[1];
    assert.equal(got.headers['content-security-policy'], `${policy}; frame-ancestors 'none'`);
    assert.match(policy, /^default-src 'none'; script-src 'sha256-[^ ]*'; style-src 'sha256-[^ ]*';/);
    assert.equal(got.headers['x-content-type-options'], 'nosniff');
    assert.equal(got.headers['access-control-allow-origin'], undefined);
    const head = await ask('HEAD', '/');
    assert.equal(head.code, 200);
    assert.equal(head.body, '');
    assert.equal((await ask('POST', '/')).code, 405);
    assert.equal((await ask('DELETE', '/')).code, 405);
    assert.equal((await ask('GET', '/../../etc/passwd')).code, 404);
    assert.equal((await ask('GET', '/', {host: `evil.example:${port}`})).code, 421);
    assert.equal((await ask('GET', '/', {host: `localhost:${port}`})).code, 200);
    const large = await ask('GET', '/', {x: 'y'.repeat(20000)}).catch(() => ({code: 431}));
    assert.ok(large.code >= 400);
    const idle = request({host: '127.0.0.1', port, agent: false});
    idle.on('error', () => {});
    idle.flushHeaders();
    server.kill('SIGINT');
    assert.equal(await ended, 0);
    const refused = spawnSync(join(bin, 'shiftmap-inspect'), ['view', ...floor, '--listen', '0.0.0.0:0'], {encoding: 'utf8'});
    assert.equal(refused.status, 2);
    assert.match(refused.stderr, /--any-address/);
  },
};

let shiftJson = '';
let failed = 0;
try {
  run('shiftmap-sim', 'open', file('world'), '--shifts', '6', '--groups', '20', '--modes', '2', '--size-m', '30',
    '--mode-change-probability', '0.25', '--seed', '7');
  const log = (i) => file(`world/run_00${i}.mcap`);
  for (const i of [0, 1, 2]) run('shiftmap-mapper', 'build', ...floor, log(i));
  run('shiftmap-localizer', 'run', ...floor, '--return', log(3));
  run('shiftmap-localizer', 'run', ...floor, '--return', log(4));
  shiftJson = run('shiftmap-localizer', 'run', ...floor, '--json', '--recording', file('shift.mcap'),
    '--trajectory', file('shift.tum'), log(5));
  run('shiftmap-inspect', 'export', '--html', ...floor, '--output', file('floor.html'));
  run('shiftmap-inspect', 'export', '--html', ...floor, '--replay', file('shift.mcap'), '--output', file('replay.html'));
  for (const [name, test] of Object.entries(tests)) {
    if (process.argv[4] && !name.includes(process.argv[4])) continue;
    try {
      await test();
      console.log(`ok: ${name}`);
    } catch (error) {
      ++failed;
      console.log(`failed: ${name}\n${error.stack}`);
    }
  }
} finally {
  await browser.close();
  rmSync(folder, {recursive: true});
}
process.exit(failed > 0 ? 1 : 0);
