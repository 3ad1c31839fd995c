import type { ProfilePoint } from '#kit/charts';
import { measure } from '#kit/measure';
import type { Place } from '#kit/place';

// What fathom-monitor serves. Absent values are null.

export interface VehicleStatus {
  utc_s: number;
  north_m: number;
  east_m: number;
  depth_m: number;
  roll_deg: number;
  pitch_deg: number;
  heading_deg: number;
  altitude_m: number | null;
  speed_mps: number;
  position_sigma_m: number | null;
  battery_percent: number | null;
  pairs_seen: number;
  pairs_dropped: number;
  map_area_m2: number;
  mission_progress: number | null;
  health: string[];
  slipped_cycles: number;
  shed_work: number;
  pool_refusals: number;
}

export interface LinkState {
  frames: number;
  bytes: number;
  accepted: number;
  lost: number;
  repaired: number;
  reordered: number;
  rejected: Record<string, number>;
  types: Record<string, number>;
  rate_bps: number;
  recent_loss: number | null;
  last_utc_s: number | null;
  age_s: number | null;
  tiles_open: number;
  tiles_undecodable: number;
}

export interface MapState {
  chunks: number;
  blocks: number;
  levels: { spacing_m: number; blocks: number }[];
  area_m2: number;
  pending_m2: number;
  changed_m2: number;
  changed_blocks: number;
  refused: number;
  evicted: number;
}

export interface PlaybackState {
  first_utc_s: number;
  last_utc_s: number;
  at_utc_s: number;
  speed: number;
  playing: boolean;
}

export interface SentRequest {
  id: number;
  text: string;
  state: 'queued' | 'sent' | 'taken' | 'done' | 'refused' | 'no answer';
  times_sent: number;
  utc_s: number; // of the state
  rectangle: [north_min: number, north_max: number, east_min: number, east_max: number] | null;
}

export interface DownlinkState {
  enabled: boolean;
  reason: string | null; // why not
  frames_sent: number;
  paused: boolean; // the vehicle sends no map, as it was asked to
  vehicle_rate_bps: number | null; // that it sends at, by its last report
  requests: SentRequest[]; // newest first
}

export interface MonitorState {
  epoch: string;
  version: number;
  map_version: number;
  track_points: number;
  recorded: boolean;
  finished: boolean;
  now_utc_s: number;
  not_kept: string | null;
  clocks_apart_s: number | null;
  playback: PlaybackState | null;
  identity: { vehicle_id: number; dive_id: number } | null;
  mission: {
    vehicle_name: string;
    origin_latitude_deg: number;
    origin_longitude_deg: number;
    start_utc_s: number;
    schema_differs: boolean;
  } | null;
  status: VehicleStatus | null;
  link: LinkState;
  map: MapState;
  downlink: DownlinkState;
}

export type TrackPoint = [utc_s: number, north_m: number, east_m: number, depth_m: number];

export interface History {
  start_utc_s: number;
  step_s: number;
  steps: [bps: number, accepted: number, lost: number, rejected: number][];
}

export class Refused extends Error {
  constructor(readonly status: number, message: string) {
    super(message);
  }
}

async function get(path: string): Promise<Response> {
  const response = await fetch(path, { cache: 'no-store' });
  if (!response.ok) throw new Refused(response.status, (await response.text()).trim() || `${path}: ${response.status}`);
  return response;
}

export const fetchState = async (): Promise<MonitorState> => (await get('api/state')).json();
export const fetchTrack = async (): Promise<TrackPoint[]> => (await (await get('api/track')).json()).points;
export const fetchHistory = async (): Promise<History> => (await get('api/history')).json();
export const fetchSquares = async (): Promise<ArrayBuffer> => (await get('api/coverage')).arrayBuffer();
// The map along a line.
export async function fetchProfile(a: Place, b: Place): Promise<ProfilePoint[]> {
  const answer = await get(`api/profile?n0=${a.north}&e0=${a.east}&n1=${b.north}&e1=${b.east}`);
  const points = ((await answer.json()) as { points: ([along_m: number, depth_m: number, sigma_m: number] | null)[] }).points;
  const step = measure(a, b).horizontal / (points.length - 1);
  return points.map((p, i) => ({ along: i * step, depth: p?.[1] ?? NaN, sigma: p?.[2] ?? NaN }));
}

export async function fetchMap(since: number): Promise<{ epoch: string; batch: ArrayBuffer }> {
  const response = await get(`api/map?since=${since}`);
  return { epoch: response.headers.get('X-Epoch') ?? '', batch: await response.arrayBuffer() };
}

// Throws Refused with the server's reason.
export async function post(path: 'api/request' | 'api/playback', body: unknown): Promise<void> {
  const response = await fetch(path, { method: 'POST', headers: { 'X-Fathom': 'page' }, body: JSON.stringify(body) });
  if (!response.ok) throw new Refused(response.status, (await response.text()).trim() || `refused (${response.status})`);
}

// Calls `changed` when the server says that something grew. Where the event stream is refused or lost, the
// caller's own slow polling carries on and the browser tries the stream again.
export function onGrowth(changed: () => void): void {
  const events = new EventSource('api/events');
  events.onmessage = changed;
  events.onopen = changed;
}
