// SPDX-License-Identifier: Apache-2.0
//
// The probabilities that the page of the web view computes, without a browser, against those of
// `shiftmap-inspect show --at`: chains that are uniform, general, and with a rhythm.
// Usage: node page_chain_test.mjs BIN_DIR PAGE_SOURCES NODE_MODULES; exits 77, skipped, without a web view.
import assert from 'node:assert/strict';
import {execFileSync} from 'node:child_process';
import {existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync} from 'node:fs';
import {createRequire} from 'node:module';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {pathToFileURL} from 'node:url';
import {rhythmicMap} from './rhythmic_map.mjs';

const [bin, sources, modules] = process.argv.slice(2);
if (!existsSync(join(modules ?? '', 'esbuild'))) {
  console.log('skipped: no web view in this build');
  process.exit(77);
}
const folder = mkdtempSync(join(tmpdir(), 'shiftmap-chain-'));
const file = (name) => join(folder, name);
const run = (program, ...args) =>
  execFileSync(join(bin, program), args, {encoding: 'utf8', stdio: ['ignore', 'pipe', 'pipe'], maxBuffer: 1 << 28});
const hall = ['--store', file('maps.db'), '--area', 'hall'];

try {
  createRequire(join(modules, 'index.js'))('esbuild').buildSync({
    stdin: {contents: "export * from './chain'; export * from './data';", resolveDir: sources, loader: 'ts'},
    bundle: true, format: 'esm', outfile: file('page.mjs'),
  });
  const {Track, readMap} = await import(pathToFileURL(file('page.mjs')));
  const map = rhythmicMap();
  writeFileSync(file('map.json'), JSON.stringify(map));
  run('shiftmap-mapper', 'import', ...hall, file('map.json'));
  run('shiftmap-inspect', 'export', '--html', ...hall, '--output', file('hall.html'));
  const html = readFileSync(file('hall.html'), 'utf8');
  const source = JSON.parse(/<script type="application\/json" id="data">(.*?)<\/script>/s.exec(html)[1]);
  const groups = readMap(source, source.maps[0]).groups;
  const tracks = new Map(groups.map((group, i) =>
    [group.name, new Track(group, source.tracks[i], source.origin_s)]));
  const begin = Number(map.stamp_ns) / 1e9;
  let largest = 0;
  let compared = 0;
  const [minute, hour, day] = [60, 3600, 86400];
  for (const after of [1, 20 * minute, hour, 5.3 * hour, day, 2.4 * day, 3 * day, 6.99 * day, 7.01 * day,
    20.9 * day, 25 * day, 400 * day]) {
    const shown = JSON.parse(run('shiftmap-inspect', 'show', ...hall, '--at', String(begin + after), '--json'));
    for (const {signature, modes} of shown.groups) {
      const p = tracks.get(signature).at(begin + after);
      assert.equal(p.length, modes.length);
      modes.forEach(({probability}, state) => {
        largest = Math.max(largest, Math.abs(p[state] - probability));
        assert.ok(Math.abs(p[state] - probability) < 2e-4,
          `${signature}, state ${state}, ${after} s later: page ${p[state]}, product ${probability}`);
        ++compared;
      });
    }
  }
  // A rhythm moves them by more than the tolerance, or nothing would be tested.
  const mean = new Track({...groups[2], rhythm: undefined}, source.tracks[2], source.origin_s);
  assert.ok(Math.abs(mean.at(begin + 5 * hour)[1] - tracks.get(groups[2].name).at(begin + 5 * hour)[1]) > 0.02);
  console.log(`ok: ${compared} probabilities, the largest difference ${largest.toExponential(1)}`);
} finally {
  rmSync(folder, {recursive: true});
}
