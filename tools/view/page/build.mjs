// SPDX-License-Identifier: Apache-2.0
//
// Makes the page: one HTML text with script and style inline, split where the data document goes,
// as a C++ source. Usage: node build.mjs OUTPUT.cc, in a folder with the sources and node_modules.
import {createHash} from 'node:crypto';
import {existsSync, readFileSync, writeFileSync} from 'node:fs';
import {build} from 'esbuild';

const bundled = await build({
  entryPoints: ['main.ts', 'style.css'],
  bundle: true,
  minify: true,
  target: 'es2022',
  charset: 'ascii',
  format: 'iife',
  legalComments: 'none',
  metafile: true,
  outdir: 'out',
  write: false,
});

// Inline text is what its hash in the policy allows, and nothing in it may end its element.
function inline(extension) {
  const text = bundled.outputFiles.find((file) => file.path.endsWith(extension)).text.trim();
  if (/<\/(script|style)|<!--/i.test(text)) throw new Error(`${extension}: ends its element`);
  return text;
}
const hash = (text) => `'sha256-${createHash('sha256').update(text).digest('base64')}'`;
const escapeHtml = (text) =>
  text.replace(/&/g, '&amp;').replace(/</g, '&lt;').replace(/>/g, '&gt;');

function licenses() {
  const names = new Set();
  for (const input of Object.keys(bundled.metafile.inputs)) {
    const match = /node_modules\/((?:@[^/]+\/)?[^/]+)\//.exec(input);
    if (match) names.add(match[1]);
  }
  return [...names].sort().map((name) => {
    const folder = `node_modules/${name}`;
    const {version, license} = JSON.parse(readFileSync(`${folder}/package.json`, 'utf8'));
    const file = ['LICENSE', 'LICENSE.md', 'LICENSE.txt'].find((f) => existsSync(`${folder}/${f}`));
    if (!file) throw new Error(`${name}: no license text`);
    return `${name} ${version}, ${license}\n\n${readFileSync(`${folder}/${file}`, 'utf8').trim()}`;
  }).join('\n\n\n');
}

const script = inline('.js');
const style = inline('.css');
const policy = [
  "default-src 'none'",
  `script-src ${hash(script)}`,
  `style-src ${hash(style)}`,
  "base-uri 'none'",
  "form-action 'none'",
].join('; ');
const parts = {POLICY: policy, STYLE: style, LICENSES: escapeHtml(licenses()), SCRIPT: script};
const page = readFileSync('index.html', 'utf8')
  .replace(/\{\{(\w+)\}\}/g, (whole, name) => parts[name] ?? whole);
const [head, tail, ...rest] = page.split('{{DATA}}');
if (tail === undefined || rest.length > 0) throw new Error('index.html: one {{DATA}} expected');

// Compilers bound the length of one literal.
function literal(text) {
  const pieces = text.match(/[\s\S]{1,8000}/gu) ?? [];
  return pieces.map((piece) => `R"~page~(${piece})~page~"s`).join(' +\n') || '""s';
}
writeFileSync(process.argv[2], `// Made by build.mjs.
#include "tools/view/page_template.h"

namespace shiftmap {

using std::string_literals::operator""s;

const PageTemplate& ViewPageTemplate() {
  static const auto* const page = new PageTemplate{
      ${literal(head)},
      ${literal(tail)},
      ${literal(policy)}};
  return *page;
}

}  // namespace shiftmap
`);
