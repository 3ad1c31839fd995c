import type { MonitorState } from './api';
import { duration } from '#kit/format';

// The alarms for the watch on the ship, and which of them are acknowledged. Pure: the panel draws them.

export interface Thresholds {
  silence_s: number; // no frame for so long
  battery_percent: number; // less left
  loss_percent: number; // more of the frames of the last minutes lost
  sigma_m: number; // position worse known
  altitude_m: number; // lower above the seafloor
}

export const DEFAULT_THRESHOLDS: Thresholds = {
  silence_s: 120,
  battery_percent: 25,
  loss_percent: 60,
  sigma_m: 5,
  altitude_m: 1,
};

export const THRESHOLD_LABELS: Record<keyof Thresholds, [label: string, unit: string]> = {
  silence_s: ['Silent for more than', 's'],
  battery_percent: ['Battery below', '%'],
  loss_percent: ['Frames lost above', '%'],
  sigma_m: ['Position 1 σ above', 'm'],
  altitude_m: ['Altitude below', 'm'],
};

const UNREADABLE_FRAMES = 5; // before any that can be read
const CLOCKS_APART_S = 120; // more than any frame is in transit

export interface Alarm {
  id: string;
  severe: boolean;
  text: string;
}

export function findAlarms(state: MonitorState, age: number | null, t: Thresholds): Alarm[] {
  const alarms: Alarm[] = [];
  const raise = (id: string, severe: boolean, text: string): void => void alarms.push({ id, severe, text });
  if (!state.recorded && age !== null && age > t.silence_s) raise('silence', true, `No word for ${duration(age)}`);
  const s = state.status;
  if (s) {
    if (s.battery_percent !== null && s.battery_percent < t.battery_percent)
      raise('battery', true, `Battery at ${s.battery_percent.toFixed(0)} %`);
    if (s.altitude_m !== null && s.altitude_m < t.altitude_m)
      raise('altitude', true, `Altitude ${s.altitude_m.toFixed(1)} m`);
    if (s.position_sigma_m !== null && s.position_sigma_m > t.sigma_m)
      raise('sigma', false, `Position known to ${s.position_sigma_m.toFixed(1)} m only`);
    for (const flag of s.health) raise(`health:${flag}`, false, flag);
  }
  if (state.link.recent_loss !== null && 100 * state.link.recent_loss > t.loss_percent)
    raise('loss', false, `${Math.round(100 * state.link.recent_loss)} % of the frames are lost`);
  const rejected = state.link.rejected;
  if (state.link.accepted === 0 && (rejected['unkeyed'] ?? 0) > 0)
    raise('unkeyed', true, 'The vehicle sends without the key that this program was given: start it without --key, or give the vehicle the key');
  else if (state.link.accepted === 0 && (rejected['bad-tag'] ?? 0) >= UNREADABLE_FRAMES)
    raise('key', true, 'Frames come that cannot be proven: the vehicle has another key, or they are damaged');
  if ((rejected['old'] ?? 0) > 0)
    raise('old', false, 'Frames of an earlier dive arrive: played again, or the vehicle\'s clock was set back (then give another --out)');
  if (state.downlink.paused) raise('paused', false, 'The map is paused, as asked');
  if (state.not_kept) raise('disk', true, `This computer does not store what it receives: ${state.not_kept}`);
  if (!state.recorded && state.clocks_apart_s !== null && Math.abs(state.clocks_apart_s) > CLOCKS_APART_S)
    raise('clocks', true, `The vehicle's clock and this computer's are ${duration(Math.abs(state.clocks_apart_s))} apart`);
  if (state.mission?.schema_differs)
    raise('schema', true, 'The vehicle speaks other fields than this monitor: values may be wrong');
  return alarms;
}

// An acknowledged alarm is quiet until it has gone and come back.
export class AlarmBook {
  private acknowledged = new Set<string>();
  private alarms: Alarm[] = [];

  update(alarms: Alarm[]): void {
    this.alarms = alarms;
    const standing = new Set(alarms.map((a) => a.id));
    for (const id of this.acknowledged) if (!standing.has(id)) this.acknowledged.delete(id);
  }
  acknowledge(id: string): void {
    if (this.alarms.some((a) => a.id === id)) this.acknowledged.add(id);
  }
  // Those not yet acknowledged first, the severe before the others.
  get standing(): (Alarm & { acknowledged: boolean })[] {
    const rank = (a: Alarm & { acknowledged: boolean }): number => Number(a.acknowledged) * 2 + Number(!a.severe);
    return this.alarms
      .map((a) => ({ ...a, acknowledged: this.acknowledged.has(a.id) }))
      .sort((a, b) => rank(a) - rank(b));
  }
  get open(): number {
    return this.alarms.filter((a) => !this.acknowledged.has(a.id)).length;
  }
}

export function readThresholds(text: string | null): Thresholds {
  const thresholds = { ...DEFAULT_THRESHOLDS };
  try {
    const saved: unknown = JSON.parse(text ?? '{}');
    for (const key of Object.keys(thresholds) as (keyof Thresholds)[]) {
      const value = (saved as Record<string, unknown> | null)?.[key];
      if (typeof value === 'number' && Number.isFinite(value) && value >= 0) thresholds[key] = value;
    }
  } catch {
    // what a browser has kept may be anything
  }
  return thresholds;
}
