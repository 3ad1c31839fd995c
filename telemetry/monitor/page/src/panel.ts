import type { LinkState, MonitorState, VehicleStatus } from './api';
import { bytes, count, duration, number, utc } from './format';

// The side panel. Rebuilt from the state each time; every value has a data-name for tests.

type Row = [label: string, value: string, name?: string, warn?: boolean];

function section(title: string, ...content: (Node | Row)[]): HTMLElement {
  const box = document.createElement('section');
  const head = document.createElement('h2');
  head.textContent = title;
  box.append(head);
  for (const item of content) {
    if (item instanceof Node) {
      box.append(item);
      continue;
    }
    const [label, value, name, warn] = item;
    const row = document.createElement('div');
    row.className = warn ? 'row warn' : 'row';
    const left = document.createElement('span');
    left.textContent = label;
    const right = document.createElement('b');
    right.textContent = value;
    if (name) right.dataset.name = name;
    row.append(left, right);
    box.append(row);
  }
  return box;
}

function text(className: string, content: string): HTMLElement {
  const div = document.createElement('div');
  div.className = className;
  div.textContent = content;
  return div;
}

function bar(share: number, className: string): HTMLElement {
  const outer = document.createElement('div');
  outer.className = `bar ${className}`;
  const inner = document.createElement('div');
  inner.style.width = `${Math.min(Math.max(share, 0), 1) * 100}%`;
  outer.append(inner);
  return outer;
}

function title(state: MonitorState): HTMLElement {
  const head = document.createElement('header');
  const name = text('name', state.mission?.vehicle_name || (state.identity ? `vehicle ${state.identity.vehicle_id}` : 'no vehicle yet'));
  name.dataset.name = 'vehicle';
  const dive = state.identity ? `dive ${state.identity.dive_id}` : 'waiting for frames';
  const source = state.recorded ? (state.finished ? 'recording, at its end' : 'recording') : 'live';
  head.append(name, text('dive', `${dive} · ${source}`));
  if (state.mission?.schema_differs)
    head.append(text('alert', 'The vehicle speaks other fields than this monitor: values may be wrong'));
  return head;
}

function vehicle(s: VehicleStatus): HTMLElement {
  return section('Vehicle',
    ['Time (UTC)', utc(s.utc_s), 'time'],
    ['North', number(s.north_m, 1, 'm'), 'north'],
    ['East', number(s.east_m, 1, 'm'), 'east'],
    ['Position 1 σ', number(s.position_sigma_m, 1, 'm'), 'sigma'],
    ['Depth', number(s.depth_m, 1, 'm'), 'depth'],
    ['Altitude', number(s.altitude_m, 1, 'm'), 'altitude'],
    ['Heading', `${number(s.heading_deg, 0)}°`, 'heading'],
    ['Roll / pitch', `${number(s.roll_deg, 0)}° / ${number(s.pitch_deg, 0)}°`],
    ['Speed', number(s.speed_mps, 2, 'm/s'), 'speed']);
}

function mission(state: MonitorState, s: VehicleStatus): HTMLElement {
  const progress: (Node | Row)[] = s.mission_progress === null ? [] :
    [['Plan done', `${Math.round(s.mission_progress * 100)} %`, 'progress'], bar(s.mission_progress, 'progress')];
  return section('Mission', ...progress,
    ['Stereo pairs used', `${count(s.pairs_used)} of ${count(s.pairs_seen)}`, 'pairs'],
    ['Pairs dropped', count(s.pairs_dropped), 'dropped', s.pairs_dropped > 0],
    ['Mapped on board', `${count(Math.round(s.map_area_m2))} m²`, 'area-onboard'],
    ['Received here', `${count(Math.round(state.map.area_m2))} m²`, 'area'],
    ['Tiles here / on board', `${count(state.map.tiles)} / ${count(s.map_tiles)}`, 'tiles']);
}

function health(s: VehicleStatus): HTMLElement {
  const flags = text('flags', '');
  flags.dataset.name = 'health';
  for (const flag of s.health) flags.append(text('flag', flag));
  if (s.health.length === 0) flags.append(text('fine', 'no flag set'));
  const counter = (n: number): string => (n >= 1023 ? '≥ 1023' : String(n));
  return section('Health', flags,
    ['Late cycles', counter(s.slipped_cycles), 'slipped', s.slipped_cycles > 0],
    ['Work given up', counter(s.shed_work), 'shed', s.shed_work > 0],
    ['Refused by full pools', counter(s.pool_refusals), 'refused', s.pool_refusals > 0]);
}

function link(l: LinkState, age: number | null): HTMLElement {
  const expected = l.accepted + l.lost;
  const quality = expected > 0 ? l.accepted / expected : 0;
  const rejected = Object.entries(l.rejected).filter(([, n]) => n > 0);
  return section('Acoustic link',
    ['Last frame', age === null ? 'none yet' : `${duration(age)} ago`, 'age'],
    ['Frames received', count(l.accepted), 'accepted'],
    ['Frames lost', expected > 0 ? `${count(l.lost)} (${((100 * l.lost) / expected).toFixed(1)} %)` : '0', 'lost'],
    bar(quality, 'quality'),
    ...rejected.map(([reason, n]): Row => [`Rejected: ${reason.replaceAll('-', ' ')}`, count(n), `rejected-${reason}`, true]),
    ['Received', bytes(l.bytes), 'bytes'],
    ['Rate, last minute', number(l.rate_bps, 0, 'bit/s'), 'rate'],
    ['Tiles in parts', count(l.tiles_open), 'open']);
}

export function drawPanel(panel: HTMLElement, state: MonitorState, age: number | null): void {
  const s = state.status;
  panel.replaceChildren(title(state), ...(s ? [vehicle(s), mission(state, s), health(s)] : []), link(state.link, age));
}
