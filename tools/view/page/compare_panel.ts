// SPDX-License-Identifier: Apache-2.0
import {compareMaps, drawChanges, type MapChanges, type ModeChange} from './compare';
import type {Document, LandmarkMap} from './data';
import type {Overlay} from './map_view';
import {byId, element, fill, metres, modeName, row, table, timeText} from './markup';

const SHOWN = 200;

/** Two versions: which, and what differs. */
export class ComparePanel {
  readonly from = byId<HTMLSelectElement>('version-from');
  readonly to = byId<HTMLSelectElement>('version-to');
  private readonly place = byId<HTMLElement>('changes');
  changes: MapChanges = {moved: [], fresh: [], gone: [], same: 0};
  onChange: () => void = () => {};
  onPick: (signature: number) => void = () => {};

  constructor(private readonly maps: Map<number, LandmarkMap>, private readonly source: Document) {
    const numbers = [...maps.keys()].sort((a, b) => a - b);
    const shown = source.shown;
    const parent = source.versions.find((v) => v[0] === shown)?.[1];
    const before = parent && maps.has(parent) ? parent : numbers.filter((n) => n < shown).at(-1) ?? shown;
    for (const [selector, chosen] of [[this.from, before], [this.to, shown]] as const) {
      selector.replaceChildren(...numbers.map((number) => {
        const option = element('option', {value: String(number)}, this.describe(number));
        option.selected = number === chosen;
        return option;
      }));
      selector.addEventListener('change', () => this.update());
    }
  }

  get fromMap(): LandmarkMap { return this.maps.get(Number(this.from.value))!; }
  get toMap(): LandmarkMap { return this.maps.get(Number(this.to.value))!; }

  /** Over each of the two maps. */
  readonly overlay: Overlay = (context, frame, theme, labels) =>
    drawChanges(context, frame, theme, labels, this.changes);

  update(): void {
    this.changes = compareMaps(this.fromMap, this.toMap);
    const {moved, fresh, gone, same} = this.changes;
    fill(
        this.place,
        element('p', {}, `${moved.length} moved, ${fresh.length} new, ${gone.length} gone; ` +
            `${same} within what chance explains (p ≥ 0.01).`),
        this.list('Moved', 'moved', moved, (c) => metres(c.distance)),
        this.list('New', 'fresh', fresh, (c) => `${c.to!.x.toFixed(2)}, ${c.to!.y.toFixed(2)}`),
        this.list('Gone', 'gone', gone, (c) => `${c.from!.x.toFixed(2)}, ${c.from!.y.toFixed(2)}`));
    if (this.source.left_out.versions > 0) {
      this.place.append(element('p', {class: 'muted'},
          `${this.source.left_out.versions} other versions are not in this page.`));
    }
    this.onChange();
  }

  private describe(number: number): string {
    const version = this.source.versions.find((v) => v[0] === number);
    const mark = number === this.source.published ? ', published' : '';
    return `${number}${mark} · ${version ? timeText(version[3]).slice(0, 16) : ''}`;
  }

  private list(
      title: string, kind: string, changes: ModeChange[], value: (change: ModeChange) => string): HTMLElement | null {
    if (changes.length === 0) return null;
    const rows = changes.slice(0, SHOWN).map((change) => {
      const pick = element('button', {type: 'button', class: 'link'}, change.name);
      pick.addEventListener('click', () => this.onPick(change.signature));
      return row([pick, modeName((change.to ?? change.from)!.number), value(change)]);
    });
    const unit = kind === 'moved' ? 'By' : 'x, y / m';
    return element(
        'section', {class: kind}, element('h3', {}, `${title} (${changes.length})`),
        element('div', {class: 'scroll'}, table(['Landmark', 'Mode', unit], rows, title)),
        changes.length > SHOWN && element('p', {class: 'muted'}, `The first ${SHOWN} are listed.`));
  }
}
