import type { MonitorState } from './api';
import { bytes, count, dateAndClock, duration, number, position } from '#kit/format';
import { transverseMercator } from '#kit/geodesy';
import { element, make, row } from '#kit/overlay';

// The numbers of the side panel. Built once; afterwards only texts that differ are written, so that an update costs
// little and never takes the focus from a field. Every value has a data-name for tests.

type Row = [label: string, name: string];

const VEHICLE: Row[] = [
  ['Depth', 'depth'], ['Altitude', 'altitude'], ['Heading', 'heading'], ['Speed', 'speed'],
  ['Roll, pitch', 'tilt'], ['Pos. 1 σ', 'sigma'], ['North', 'north'], ['East', 'east'],
];
const SURVEY: Row[] = [['Received here', 'area'], ['Mapped on board', 'area-onboard'], ['Seen, not received', 'pending'],
  ['Moved, last 10 min', 'changed'], ['Stereo pairs', 'pairs'], ['Blocks held', 'blocks']];
const LINK: Row[] = [['Rate', 'rate'], ['Loss, 5 min', 'recent-loss'], ['Frames', 'accepted'],
  ['Lost', 'lost'], ['Bytes', 'bytes'], ['Repaired', 'repaired'], ['Rejected', 'rejected'], ['Said', 'said']];
const COUNTERS: Row[] = [['Late cycles', 'slipped'], ['Work given up', 'shed'], ['Pools refused', 'refused']];

function rows(list: Row[], className = 'rows'): HTMLElement {
  const box = make('div', className);
  for (const [label, name] of list) {
    const line = row(label, '–');
    line.querySelector('b')!.dataset.name = name;
    box.append(line);
  }
  return box;
}

const values = new Map<string, HTMLElement>();

export function buildPanel(): void {
  element('vehicle-rows').append(rows(VEHICLE, 'rows two'));
  element('survey-rows').append(rows(SURVEY));
  element('health-rows').append(rows(COUNTERS));
  element('link-rows').append(rows(LINK, 'rows two'));
  for (const node of document.querySelectorAll<HTMLElement>('[data-name]')) values.set(node.dataset.name!, node);
}

export function write(name: string, text: string, warn = false): void {
  const node = values.get(name);
  if (!node) return;
  if (node.textContent !== text) node.textContent = text;
  node.classList.toggle('warn', warn);
}

function bar(id: string, ...shares: number[]): void {
  const parts = element(id).children;
  shares.forEach((share, i) => ((parts[i] as HTMLElement).style.width = `${Math.min(Math.max(share, 0), 1) * 100}%`));
}

// Latitude and longitude of a place in nav.
export const positionOf = (mission: NonNullable<MonitorState['mission']>, north: number, east: number): string =>
  position(transverseMercator({ latitude: mission.origin_latitude_deg, longitude: mission.origin_longitude_deg }).toGeodetic({ north, east }));

export type Word = 'fresh' | 'late' | 'silent' | 'none';

// How long since the last word, and how bad that is: late after three periods of the usual ten seconds.
export const LATE_AFTER = 30; // [s]

export function wordOf(age: number | null, silence: number): Word {
  if (age === null) return 'none';
  return age > silence ? 'silent' : age > LATE_AFTER ? 'late' : 'fresh';
}

export function drawPanel(state: MonitorState, age: number | null, silence: number): void {
  const s = state.status;
  write('vehicle', state.mission?.vehicle_name || (state.identity ? `vehicle ${state.identity.vehicle_id}` : 'no vehicle yet'));
  const source = state.recorded ? 'recording' : 'live';
  write('dive', state.identity ? `dive ${state.identity.dive_id} · ${source}` : `${source} · waiting for frames`);
  const word = element('word');
  word.dataset.word = state.recorded ? 'recorded' : wordOf(age, silence);
  write('age', state.recorded ? dateAndClock(state.now_utc_s).slice(11) : age === null ? 'none yet' : duration(age));
  write('age-label', state.recorded ? `Recording, ${dateAndClock(state.now_utc_s).slice(0, 10)} UTC` : 'Since last word');
  write('time', s ? `${dateAndClock(s.utc_s)} UTC` : '–');

  if (s) {
    write('depth', number(s.depth_m, 1, 'm'));
    write('altitude', number(s.altitude_m, 1, 'm'));
    write('heading', `${number(s.heading_deg, 0)}°`);
    write('speed', number(s.speed_mps, 1, 'm/s'));
    write('tilt', `${number(s.roll_deg, 0)}°, ${number(s.pitch_deg, 0)}°`);
    write('sigma', number(s.position_sigma_m, s.position_sigma_m !== null && s.position_sigma_m < 1 ? 2 : 1, 'm'));
    write('north', number(s.north_m, 1, 'm'));
    write('east', number(s.east_m, 1, 'm'));
    const m = state.mission;
    write('position', m ? positionOf(m, s.north_m, s.east_m) : 'origin not received yet');
    write('battery', s.battery_percent === null ? 'unknown' : `${s.battery_percent.toFixed(0)} %`);
    bar('battery-bar', (s.battery_percent ?? 0) / 100);
    write('progress', s.mission_progress === null ? 'no plan' : `${Math.round(s.mission_progress * 100)} %`);
    bar('progress-bar', s.mission_progress ?? 0);
    write('area-onboard', `${count(Math.round(s.map_area_m2))} m²`);
    write('pairs', `${count(s.pairs_seen)}, ${count(s.pairs_dropped)} unused`);
    const counter = (name: string, n: number): void => write(name, count(n), n > 0);
    counter('slipped', s.slipped_cycles);
    counter('shed', s.shed_work);
    counter('refused', s.pool_refusals);
  }
  const map = state.map;
  const whole = Math.max(map.area_m2 + map.pending_m2, s?.map_area_m2 ?? 0, 1);
  write('area', `${count(Math.round(map.area_m2))} m²`);
  write('pending', `about ${count(map.pending_m2)} m²`);
  write('changed', `${count(Math.round(map.changed_m2))} m²`);
  write('blocks', map.evicted > 0 ? `${count(map.blocks)}, ${count(map.evicted)} dropped` : count(map.blocks), map.evicted > 0);
  bar('coverage-bar', (map.area_m2 - map.changed_m2) / whole, map.changed_m2 / whole, map.pending_m2 / whole);

  const l = state.link;
  const rejected = Object.entries(l.rejected).filter(([, n]) => n > 0);
  write('rate', number(l.rate_bps, 0, 'bit/s'));
  write('recent-loss', l.recent_loss === null ? '–' : `${Math.round(100 * l.recent_loss)} %`);
  write('accepted', count(l.accepted));
  write('lost', l.accepted + l.lost > 0 ? `${count(l.lost)} (${((100 * l.lost) / (l.accepted + l.lost)).toFixed(0)} %)` : '0');
  write('repaired', count(l.repaired));
  write('rejected', count(rejected.reduce((sum, [, n]) => sum + n, 0)), rejected.length > 0);
  values.get('rejected')!.title = rejected.map(([reason, n]) => `${reason.replaceAll('-', ' ')}: ${n}`).join('\n');
  write('bytes', bytes(l.bytes));
  write('said', `${count(state.downlink.frames_sent)} frames`);
}
