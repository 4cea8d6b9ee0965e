// SPDX-License-Identifier: Apache-2.0
import {Track} from './chain';
import {ComparePanel} from './compare_panel';
import {readMap, readRuns, readVisit, type Document, type Group, type LandmarkMap, type Visit} from './data';
import {LandmarkPanel} from './landmark_panel';
import {readTheme} from './layers';
import {boundsOf, MapView, type ViewSettings} from './map_view';
import {byId, element, isDecided, modeName, percent, row, table, timeText} from './markup';
import {Shift} from './replay';
import {ReplayPanel} from './replay_panel';
import {Search} from './search';
import {Timeline, TimeScale, type Span} from './timeline';

type Tab = 'overview' | 'landmark' | 'versions' | 'replay';
const TABS: Tab[] = ['overview', 'landmark', 'versions', 'replay'];

class Page {
  private readonly source: Document;
  private readonly maps = new Map<number, LandmarkMap>();
  private readonly map: LandmarkMap;
  private readonly tracks: Track[];
  private readonly visits: Visit[][];
  private readonly runs;
  private readonly shift: Shift | null;
  private theme = readTheme();
  private readonly settings: ViewSettings = {sigmas: 2.4477, relative: true, runs: true, labels: true};
  private readonly timeline = new Timeline(this.theme);
  private readonly landmark = new LandmarkPanel(this.theme);
  private readonly compare: ComparePanel;
  private readonly search: Search;
  private replayPanel: ReplayPanel | null = null;
  private main: MapView;
  private second: MapView | null = null;
  private tab: Tab = 'overview';
  private selected: Group | null = null;
  /** Of each group of `map` at the time of the slider. */
  private present: number[][] = [];
  private scale: TimeScale;

  constructor(source: Document) {
    this.source = source;
    for (const mapRow of source.maps) this.maps.set(mapRow[0], readMap(source, mapRow));
    this.map = this.maps.get(source.shown)!;
    this.tracks = this.map.groups.map((group, i) => new Track(group, source.tracks[i] ?? [], source.origin_s));
    this.visits = source.visits.map((rows) => rows.map((visit) => readVisit(source, visit)));
    this.runs = readRuns(source);
    this.shift = source.replay ? new Shift(source.replay) : null;
    this.compare = new ComparePanel(this.maps, source);
    this.search = new Search(this.map);
    this.scale = new TimeScale(this.spans(), this.until());
    this.main = this.makeView('map', this.map);
    this.describe();
    this.connect();
    // Of a survey, there is no choice.
    byId('ellipses').hidden = ![...this.maps.values()].some((map) => map.scaleSd !== null);
    this.timeline.onChange = (time) => this.setTime(time);
    this.timeline.setContent(this.spans(), this.events(), this.until());
    this.timeline.setTime(source.at_s);
    this.showEllipses();
    if (this.shift) {
      this.replayPanel = new ReplayPanel(this.shift, source, this.theme);
      this.replayPanel.onTime = (time) => this.timeline.setTime(time);
      this.replayPanel.onPick = (signature) => this.selectSignature(signature);
      byId('tab-replay').hidden = false;
      this.openTab('replay');
    }
  }

  private makeView(id: string, map: LandmarkMap): MapView {
    // A canvas of its own: the one before has listeners.
    const old = byId<HTMLCanvasElement>(id);
    const canvas = old.cloneNode(false) as HTMLCanvasElement;
    old.replaceWith(canvas);
    canvas.setAttribute('aria-label', `Map of ${this.source.area}, version ${map.version}: ` +
        'arrows move it, plus and minus zoom, n and p go from landmark to landmark');
    const runs = this.tab === 'versions' ? [] : this.runs;
    const view = new MapView(canvas, map, boundsOf(map, runs), this.theme, this.settings);
    view.onPick = (group) => (group ? this.selectSignature(group.signature) : this.select(null));
    view.runs = runs;
    return view;
  }

  /** Shifts; the slider gives them room. */
  private spans(): Span[] {
    const first = this.source.left_out.before_s ?? -Infinity;
    const spans: Span[] = this.runs.filter((run) => run.begin >= first)
        .map((run) => ({begin: run.begin, end: run.end}));
    for (const visits of this.visits) {
      for (const visit of visits) spans.push({begin: visit.begin, end: visit.end});
    }
    // Of a map without runs, from its own time on.
    if (spans.length === 0) spans.push({begin: this.map.stamp, end: this.map.stamp});
    return spans;
  }

  private events(): number[] {
    return this.spans().map((span) => span.end);
  }

  /** Now, unless that is so long after everything that nothing else would be seen. */
  private until(): number {
    const times = this.spans().flatMap((span) => [span.begin, span.end]);
    const begin = times.reduce((a, b) => Math.min(a, b), this.map.stamp);
    const end = times.reduce((a, b) => Math.max(a, b), this.map.stamp);
    return Math.max(end + 3600, Math.min(this.source.at_s, end + Math.max(86400, end - begin)));
  }

  private setTime(time: number): void {
    this.present = this.tracks.map((track) => track.at(time));
    this.main.time = time;
    if (this.tab === 'replay') this.replayPanel?.setTime(time);
    // Side by side each version is as it was built.
    if (this.tab !== 'versions') this.main.setProbabilities((group) => this.present[group]!);
    if (this.selected) this.landmark.setTime(time, this.present[this.selected.index]!);
    if (this.tab === 'overview') this.showOverview();
  }

  private describe(): void {
    const {source, map} = this;
    byId('area').textContent = source.area;
    document.title = `${source.area} – shiftmap`;
    const published = source.published === source.shown ? 'published' : 'not published';
    byId('version').textContent = `version ${source.shown}`;
    byId('tool').textContent = `Made by ${source.tool} at ${timeText(source.made_s)} UTC.`;
    const version = source.versions.find((v) => v[0] === source.shown);
    const modes = map.groups.reduce((sum, group) => sum + group.modes.length, 0);
    const facts: [string, string][] = [
      ['Version', `${source.shown}, ${published}`],
      ...(source.known_s === null ? [] :
          [['As known at', `${timeText(source.known_s)} UTC`] as [string, string]]),
      ['Built up to', `${timeText(map.stamp)} UTC`],
      ['Content', (version?.[4] ?? '').slice(0, 12)],
      ['Landmarks', `${map.groups.length}, with ${modes} modes; ${map.anonymous.length} without signature`],
      ['Runs', String(this.runs.length)],
    ];
    byId('facts').replaceChildren(...facts.flatMap(([term, value]) =>
        [element('dt', {}, term), element('dd', {}, value)]));
  }

  /** The landmarks that are least certain now. */
  private showOverview(): void {
    const doubtful = this.map.groups.map((group) => {
      const p = this.present[group.index]!;
      const best = p.indexOf(Math.max(...p));
      return {group, best, probability: p[best]!};
    }).filter(({probability}) => probability < 0.99).sort((a, b) => a.probability - b.probability);
    const rows = doubtful.slice(0, 15).map(({group, best, probability}) => {
      const pick = element('button', {type: 'button', class: 'link'}, group.name);
      pick.addEventListener('click', () => this.selectSignature(group.signature));
      const state = modeName(best === 0 ? 0 : group.modes[best - 1]!.number);
      return row([pick, isDecided(probability) ? state : `${state}, undecided`, percent(probability)]);
    });
    byId('overview').replaceChildren(
        element('h3', {}, `Least certain at this time (${doubtful.length} below 99 %)`),
        rows.length > 0 ? table(['Landmark', 'Most likely', 'Probability'], rows, 'Least certain')
            : element('p', {class: 'muted'}, 'Every landmark is certain.'));
  }

  private select(group: Group | null): void {
    this.selected = group;
    byId('no-landmark').hidden = group !== null;
    if (group) {
      const visits = this.visits[group.index] ?? [];
      this.landmark.show(
          group, this.tracks[group.index]!, visits, this.source.left_out.before_s !== undefined, this.scale,
          this.timeline.time);
      const p = this.present[group.index]!;
      byId('selection').textContent = `${group.name}: ${p.map((value, state) =>
          `${modeName(state === 0 ? 0 : group.modes[state - 1]!.number)} ${percent(value)}`).join(', ')}`;
    } else {
      this.landmark.clear();
      byId('selection').textContent = 'no landmark';
    }
    this.markSelected(group?.signature);
  }

  private markSelected(signature: number | undefined): void {
    for (const view of [this.main, this.second]) {
      if (!view) continue;
      view.selected = signature === undefined ? null : view.map.bySignature.get(signature) ?? null;
      view.draw();
    }
  }

  /** Also of a landmark that only another version has. */
  private selectSignature(signature: number, show = false): void {
    const group = this.map.bySignature.get(signature);
    if (group) this.select(group);
    if (this.tab === 'overview' && group) this.openTab('landmark');
    this.markSelected(signature);
    if (!show && this.tab !== 'versions') return;
    for (const view of [this.main, this.second]) if (view?.selected && show) view.show(view.selected);
  }

  private openTab(tab: Tab): void {
    const before = this.tab;
    this.tab = tab;
    for (const name of TABS) {
      const button = byId(`tab-${name}`);
      button.setAttribute('aria-selected', String(name === tab));
      button.tabIndex = name === tab ? 0 : -1;
      byId(`pane-${name}`).hidden = name !== tab;
    }
    if ((before === 'versions') !== (tab === 'versions')) this.arrangeMaps();
    const replay = tab === 'replay' ? this.shift : null;
    if ((before === 'replay') !== (tab === 'replay')) this.arrangeTime(replay);
    if (tab !== 'versions') {
      this.main.overlay = replay && ((context, frame, theme) =>
          replay.draw(context, frame, theme, this.timeline.time, this.settings.sigmas));
    }
    this.setTime(this.timeline.time);
  }

  private arrangeTime(replay: Shift | null): void {
    if (replay) {
      const events = [replay.begin, ...replay.states, ...replay.decisions].map((event) =>
          (typeof event === 'number' ? event : event.time));
      this.timeline.setContent([{begin: replay.begin, end: replay.end}], events, replay.end);
      this.timeline.setTime(Math.min(Math.max(this.timeline.time, replay.begin), replay.end));
    } else {
      this.timeline.setContent(this.spans(), this.events(), this.until());
      this.timeline.setTime(this.timeline.time);
    }
  }

  private arrangeMaps(): void {
    const pair = this.tab === 'versions';
    byId('second').hidden = !pair;
    byId('maps').setAttribute('data-pair', String(pair));
    document.querySelector('footer')!.hidden = pair;
    if (pair) {
      this.compare.update();
      return;
    }
    this.second = null;
    this.main = this.makeView('map', this.map);
    byId('map-caption').textContent = '';
    this.markSelected(this.selected?.signature);
  }

  private showPair(): void {
    if (this.tab !== 'versions') return;
    const {fromMap, toMap} = this.compare;
    const signature = this.selected?.signature;
    this.main = this.makeView('map', fromMap);
    this.second = this.makeView('map-2', toMap);
    const [left, right] = [this.main, this.second];
    left.onMove = (transform) => right.follow(transform);
    right.onMove = (transform) => left.follow(transform);
    left.overlay = right.overlay = this.compare.overlay;
    left.ringed = right.ringed = true;
    for (const [view, id] of [[left, 'map-caption'], [right, 'map-2-caption']] as const) {
      byId(id).textContent = `Version ${view.map.version}, as built ${timeText(view.map.stamp).slice(0, 16)}`;
    }
    this.markSelected(signature);
  }

  private connect(): void {
    byId<HTMLSelectElement>('sigmas').addEventListener('change', (event) => {
      this.settings.sigmas = Number((event.target as HTMLSelectElement).value);
      this.redraw();
    });
    byId<HTMLSelectElement>('ellipses').addEventListener('change', (event) => {
      this.settings.relative = (event.target as HTMLSelectElement).value === 'relative';
      this.showEllipses();
    });
    for (const [id, key] of [['show-runs', 'runs'], ['show-labels', 'labels']] as const) {
      byId<HTMLInputElement>(id).addEventListener('change', (event) => {
        this.settings[key] = (event.target as HTMLInputElement).checked;
        this.redraw();
      });
    }
    byId('fit').addEventListener('click', () => this.main.fit());
    byId('help').addEventListener('click', () => byId<HTMLDialogElement>('help-dialog').showModal());
    for (const tab of TABS) byId(`tab-${tab}`).addEventListener('click', () => this.openTab(tab));
    document.querySelector('[role=tablist]')!.addEventListener('keydown', (event) =>
        this.onTabKey(event as KeyboardEvent));
    document.addEventListener('keydown', (event) => this.onKey(event));
    this.search.onPick = (group) => {
      if (this.tab !== 'replay') this.openTab('landmark');
      this.selectSignature(group.signature, true);
    };
    this.landmark.onTime = (time) => this.timeline.setTime(time);
    this.compare.onChange = () => this.showPair();
    this.compare.onPick = (signature) => this.selectSignature(signature, true);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.changeTheme());
  }

  /** Which ellipses are drawn: of the map that is shown, and of those side by side. */
  private showEllipses(): void {
    const {relative} = this.settings;
    const {scaleSd} = this.map;
    byId('ellipse-key').textContent = relative && scaleSd !== null
        ? 'ellipse: of a free network, positions to each other without what is common to all, the frame ' +
          `and the scale (sd ${Number((100 * scaleSd).toPrecision(2))} %)`
        : 'ellipse: of the position in the map frame';
    for (const view of [this.main, this.second]) view?.marks.chooseEllipses(relative);
    this.landmark.relative = relative;
    this.redraw();
    if (this.selected) this.select(this.selected);
  }

  private redraw(): void {
    this.main.draw();
    this.second?.draw();
  }

  private changeTheme(): void {
    this.theme = readTheme();
    for (const part of [this.main, this.second, this.timeline, this.landmark]) {
      if (part) part.theme = this.theme;
    }
    this.replayPanel?.setTheme(this.theme);
    this.timeline.draw();
    this.redraw();
    if (this.selected) this.select(this.selected);
  }

  private onTabKey(event: KeyboardEvent): void {
    const by = event.key === 'ArrowRight' ? 1 : event.key === 'ArrowLeft' ? -1 : 0;
    if (by === 0) return;
    const open = TABS.filter((tab) => !byId(`tab-${tab}`).hidden);
    const next = open[(open.indexOf(this.tab) + by + open.length) % open.length]!;
    this.openTab(next);
    byId(`tab-${next}`).focus();
    event.preventDefault();
  }

  private onKey(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    if (event.ctrlKey || event.metaKey || event.altKey || byId<HTMLDialogElement>('help-dialog').open) return;
    if (event.key === 'Escape') this.select(null);
    if (target instanceof HTMLInputElement && target.type !== 'range' && target.type !== 'checkbox') return;
    if (target instanceof HTMLSelectElement) return;
    const actions: Record<string, () => void> = {
      '/': () => byId('search').focus(),
      n: () => this.goTo(1),
      p: () => this.goTo(-1),
      ',': () => this.timeline.step(-1),
      '.': () => this.timeline.step(1),
    };
    const action = actions[event.key];
    if (!action) return;
    action();
    event.preventDefault();
  }

  private goTo(by: number): void {
    const count = this.map.groups.length;
    if (count === 0) return;
    const from = this.selected?.index ?? (by > 0 ? -1 : 0);
    this.selectSignature(this.map.groups[(from + by + count) % count]!.signature, true);
  }
}

new Page(JSON.parse(byId('data').textContent ?? '') as Document);
