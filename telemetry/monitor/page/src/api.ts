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
  pairs_seen: number;
  pairs_used: number;
  pairs_dropped: number;
  map_tiles: number;
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
  reordered: number;
  rejected: Record<string, number>;
  types: Record<string, number>;
  rate_bps: number;
  last_utc_s: number | null;
  age_s: number | null;
  tiles_open: number;
  tiles_evicted: number;
  tiles_undecodable: number;
}

export interface MonitorState {
  version: number;
  map_version: number;
  track_points: number;
  recorded: boolean;
  finished: boolean;
  now_utc_s: number;
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
  map: { tiles: number; area_m2: number; refused: number };
}

export type TrackPoint = [utc_s: number, north_m: number, east_m: number, depth_m: number];

async function get(path: string): Promise<Response> {
  const response = await fetch(path, { cache: 'no-store' });
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return response;
}

export const fetchState = async (): Promise<MonitorState> => (await get('api/state')).json();
export const fetchTrack = async (): Promise<TrackPoint[]> => (await (await get('api/track')).json()).points;
export const fetchTiles = async (since: number): Promise<ArrayBuffer> =>
  (await get(`api/tiles?since=${since}`)).arrayBuffer();

// Calls `changed` when the server says that something grew. Where the event stream is refused or lost, the
// caller's own slow polling carries on and the browser tries the stream again.
export function onGrowth(changed: () => void): void {
  const events = new EventSource('api/events');
  events.onmessage = changed;
}
