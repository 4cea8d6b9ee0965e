// SPDX-License-Identifier: Apache-2.0
import type {Group, LandmarkMap} from './data';
import {byId, element} from './markup';

const SHOWN = 12;

/** A text field with the landmarks whose signature has the text, best first. */
export class Search {
  private readonly field = byId<HTMLInputElement>('search');
  private readonly list = byId<HTMLUListElement>('search-list');
  private found: Group[] = [];
  private active = -1;
  onPick: (group: Group) => void = () => {};

  constructor(public map: LandmarkMap) {
    this.field.addEventListener('input', () => this.update());
    this.field.addEventListener('focus', () => this.update());
    this.field.addEventListener('blur', () => setTimeout(() => this.close(), 150));
    this.field.addEventListener('keydown', (event) => this.onKey(event));
  }

  private update(): void {
    const text = this.field.value.trim().toLowerCase();
    this.found = [];
    this.active = -1;
    if (text) {
      const rank = (name: string) => (name === text ? 0 : name.startsWith(text) ? 1 : 2);
      this.found = this.map.groups.filter((group) => group.name.toLowerCase().includes(text))
          .sort((a, b) => rank(a.name.toLowerCase()) - rank(b.name.toLowerCase()) || a.index - b.index)
          .slice(0, SHOWN);
      this.active = this.found.length > 0 ? 0 : -1;
    }
    this.show(text !== '');
  }

  private show(open: boolean): void {
    const items = this.found.map((group, i) => {
      const item = element(
          'li', {role: 'option', id: `found-${i}`, 'aria-selected': String(i === this.active)}, group.name);
      item.addEventListener('mousedown', () => this.take(group));
      return item;
    });
    if (open && items.length === 0) items.push(element('li', {class: 'muted'}, 'no such landmark'));
    this.list.replaceChildren(...items);
    this.list.hidden = !open;
    this.field.setAttribute('aria-expanded', String(open));
    if (this.active >= 0) this.field.setAttribute('aria-activedescendant', `found-${this.active}`);
    else this.field.removeAttribute('aria-activedescendant');
  }

  private take(group: Group): void {
    this.field.value = group.name;
    this.close();
    this.onPick(group);
  }

  private close(): void {
    this.found = [];
    this.active = -1;
    this.show(false);
  }

  private onKey(event: KeyboardEvent): void {
    const group = this.found[this.active];
    if (event.key === 'Enter' && group) this.take(group);
    else if (event.key === 'Escape') this.close();
    else if (event.key === 'ArrowDown' && this.found.length > 0) this.move(1);
    else if (event.key === 'ArrowUp' && this.found.length > 0) this.move(-1);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  private move(by: number): void {
    this.active = (this.active + by + this.found.length) % this.found.length;
    this.show(true);
  }
}
