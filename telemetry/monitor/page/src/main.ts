import * as THREE from 'three';
import { fetchState, fetchTiles, fetchTrack, onGrowth, type MonitorState } from './api';
import { duration } from './format';
import { banner, drawLegend, drawNorth, drawScale, element, mark, segments } from './overlay';
import { drawPanel } from './panel';
import { Seafloor, type ColourMode } from './seafloor';
import { decodeTiles } from './tiles';
import { Vehicle } from './vehicle';
import { View } from './view';

const STALE_AFTER = 30; // three status periods of the usual ten seconds [s]
const POLL_INTERVAL = 5000; // where no event stream comes through [ms]
const CLOCK_INTERVAL = 1000; // ages count on between frames [ms]

const view = new View(element('scene') as HTMLCanvasElement);
const seafloor = new Seafloor();
const vehicle = new Vehicle();
view.scene.add(seafloor.group, vehicle.group);
view.beforeDraw = () => {
  vehicle.scaleTo(view.camera);
  drawScale(view.metresPerPixel());
  drawNorth(view.northAngle());
};

let mode: ColourMode = 'depth';
let following = false;
let state: MonitorState | null = null;
let stateAt = 0; // performance.now() of it [ms]
let mapVersion = 0;
let trackPoints = -1;
let reachable = true;

const sinceState = (): number => (state?.recorded ? 0 : (performance.now() - stateAt) / 1000);
const now = (): number => (state?.now_utc_s ?? 0) + sinceState();

function everything(): THREE.Box3 {
  const box = seafloor.bounds();
  return vehicle.group.visible ? box.expandByPoint(vehicle.position) : box;
}

function showMode(): void {
  seafloor.setMode(mode, now());
  mark('modes', mode, seafloor.hasColour ? [] : ['photo']);
  drawLegend(mode, seafloor.ranges);
  view.setRelief(mode !== 'photo');
}

function showClock(): void {
  if (!state) return;
  const age = state.link.age_s === null ? null : state.link.age_s + sinceState();
  drawPanel(element('panel'), state, age);
  if (!reachable) banner('The monitor program does not answer');
  else if (!state.recorded && age !== null && age > STALE_AFTER) banner(`No frame for ${duration(age)}`);
  else banner(null);
}

async function refresh(): Promise<void> {
  state = await fetchState();
  stateAt = performance.now();
  if (state.map_version !== mapVersion) {
    const batch = decodeTiles(await fetchTiles(mapVersion));
    mapVersion = batch.version;
    seafloor.put(batch.tiles);
    element('waiting').hidden = seafloor.size > 0;
    showMode();
  }
  // Positions hang on the map's origin; before the first tile the vehicle gives it.
  const s = state.status;
  if (s) seafloor.origin ??= { north: s.north_m, east: s.east_m, depth: s.depth_m };
  if (s && seafloor.origin) vehicle.setStatus(s, seafloor.origin);
  if (state.track_points !== trackPoints && seafloor.origin) {
    const points = await fetchTrack();
    trackPoints = points.length;
    vehicle.setTrack(points, seafloor.origin);
  }
  if (following && s) view.moveTo(vehicle.position);
  else if (!view.touched) view.fit(everything());
  view.draw();
  // For tests and the screenshot script: what is on the screen.
  document.body.dataset.tiles = String(seafloor.size);
  document.body.dataset.track = String(Math.max(trackPoints, 0));
  document.body.dataset.finished = String(state.finished);
}

let running = false;
let again = false;
async function update(): Promise<void> {
  if (running) {
    again = true;
    return;
  }
  running = true;
  do {
    again = false;
    try {
      await refresh();
      reachable = true;
    } catch (error) {
      reachable = false;
      console.warn(error);
    }
  } while (again);
  running = false;
  showClock();
}

segments('modes', [['depth', 'Depth'], ['photo', 'Photo'], ['sigma', 'Sigma'], ['age', 'Age']], (value) => {
  mode = value as ColourMode;
  showMode();
});
segments('views', [['fit', 'Whole map'], ['top', 'From above'], ['follow', 'Follow vehicle']], (value) => {
  following = value === 'follow' && !following;
  view.touched = value !== 'fit';
  if (value !== 'follow') view.fit(everything(), value === 'top');
  mark('views', following ? 'follow' : null);
  void update();
});
mark('views', null);
showMode();
onGrowth(() => void update());
setInterval(() => void update(), POLL_INTERVAL);
setInterval(() => {
  showClock();
  if (mode === 'age') showMode();
}, CLOCK_INTERVAL);
void update();
