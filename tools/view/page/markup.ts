// SPDX-License-Identifier: Apache-2.0
//
// Elements and texts. Names of the data document become text nodes only, never markup.

type Child = Node | string | null | false;

export function element<K extends keyof HTMLElementTagNameMap>(
    tag: K, attributes: Record<string, string> = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  for (const child of children) if (child) made.append(child);
  return made;
}

/** Puts these in the place of all that an element has. */
export function fill(place: HTMLElement, ...children: Child[]): void {
  place.replaceChildren(...children.filter((child): child is Node | string => Boolean(child)));
}

export function byId<T extends HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`no element ${id}`);
  return found as T;
}

/** UTC, to the second; to the day where a place is narrow. */
export function timeText(seconds: number): string {
  const date = new Date(seconds * 1000);
  return isNaN(date.getTime()) ? '–' : date.toISOString().slice(0, 19).replace('T', ' ');
}

export function dayText(seconds: number): string { return timeText(seconds).slice(0, 10); }

export function percent(p: number): string {
  // Tracks are rounded to 1/10000: neither 0 nor 1 is certain.
  if (p < 0.001) return '< 0.1 %';
  if (p > 0.999) return '> 99.9 %';
  return `${(100 * p).toFixed(1)} %`;
}

/** Whether a state is more probable than all others together, by more than three digits tell. */
export function isDecided(p: number): boolean { return p > 0.5005; }

export function metres(value: number): string {
  const size = Math.abs(value);
  return size < 0.1 ? `${(1000 * value).toFixed(0)} mm` : `${value.toFixed(size < 10 ? 2 : 1)} m`;
}

/** A probability ratio from its logarithm. */
export function oddsText(nat: number): string {
  const odds = Math.exp(nat);
  if (odds < 10) return `${odds.toFixed(1)} : 1`;
  if (odds < 1e4) return `${Number(odds.toPrecision(2))} : 1`;
  const digits = [...(nat / Math.LN10).toFixed(0)].map((digit) => '⁰¹²³⁴⁵⁶⁷⁸⁹'[Number(digit)]);
  return `10${digits.join('')} : 1`;
}

export function durationText(seconds: number): string {
  if (seconds < 120) return `${seconds.toFixed(0)} s`;
  if (seconds < 7200) return `${(seconds / 60).toFixed(0)} min`;
  if (seconds < 172800) return `${(seconds / 3600).toFixed(1)} h`;
  return `${(seconds / 86400).toFixed(1)} d`;
}

export function modeName(number: number): string { return number === 0 ? 'absent' : `mode ${number}`; }

/** A row of cells; those after the first are right-aligned numbers where marked. */
export function row(cells: Child[], attributes: Record<string, string> = {}): HTMLTableRowElement {
  return element('tr', attributes, ...cells.map((cell) => element('td', {}, cell)));
}

export function table(head: string[], rows: HTMLTableRowElement[], caption: string): HTMLTableElement {
  return element(
      'table', {}, element('caption', {class: 'hidden'}, caption),
      element('thead', {}, element('tr', {}, ...head.map((h) => element('th', {scope: 'col'}, h)))),
      element('tbody', {}, ...rows));
}
