import * as THREE from 'three';
import '#kit/style.css';
import './style.css';
import { ProfileChart } from '#kit/charts';
import { bytes, count, duration, number } from '#kit/format';
import { lineText, measure } from '#kit/measure';
import { drawScale, element, input, mark, segments } from '#kit/overlay';
import { NAV_ORIGIN, areaOf, type Place } from '#kit/place';
import { AlarmBox } from './alarm_box';
import { Refused, fetchHistory, fetchMap, fetchProfile, fetchSquares, fetchState, fetchTrack, onGrowth, type MonitorState } from './api';
import { decodeChunks, decodeSquares } from './chunks';
import { Commands, fillSpacings } from './commands';
import { drawLegend } from './legend';
import { LinkChart } from './link_chart';
import type { ColourMode } from './material';
import { LATE_AFTER, buildPanel, drawPanel, positionOf, write } from './panel';
import { Pending } from './pending';
import { PlaybackBar } from './playback';
import { Seafloor } from './seafloor';
import { Tools, type Tool } from './tools';
import { Vehicle } from './vehicle';
import { View } from './view';

const POLL_INTERVAL = 5000; // where no event stream comes through [ms]
const CLOCK_INTERVAL = 1000; // ages count on between frames [ms]
const SLOW_INTERVAL = 5000; // least time between two looks at the link's history and the squares that are missing [ms]
const VEHICLE_NEAR = 8; // above the highest of the map [m]

// The token that the first address may carry is in the cookie now; it need not stay in sight.
if (new URLSearchParams(location.search).has('token')) history.replaceState(null, '', location.pathname);

let origin = NAV_ORIGIN; // of the scene
let hasOrigin = false;
const view = new View(element('scene') as HTMLCanvasElement);
const seafloor = new Seafloor(() => origin);
const pending = new Pending();
const vehicle = new Vehicle();
const tools = new Tools(view, () => origin);
view.pickable = seafloor.group;
view.world.add(seafloor.group, pending.group, vehicle.group, tools.group);
view.beforeDraw = () => {
  vehicle.scaleTo(view.camera, view.exaggeration);
  drawScale(view.metresPerPixel(), view.northAngle());
};

buildPanel();
fillSpacings();
const alarms = new AlarmBox();
const commands = new Commands();
const playback = new PlaybackBar();
const linkChart = new LinkChart(element('link-chart'));
const profileChart = new ProfileChart(element('profile'));

let mode: ColourMode = 'depth';
let following = false;
let state: MonitorState | null = null;
let stateAt = 0; // performance.now() of it [ms]
let epoch = '';
let mapVersion = 0;
let trackPoints = -1;
let slowAt = -Infinity;
let slowVersion = -1;
let failure: unknown = null;

const sinceState = (): number => (state?.recorded ? 0 : (performance.now() - stateAt) / 1000);
const now = (): number => (state?.now_utc_s ?? 0) + sinceState();

// The map, and the vehicle while it works near it: a dive's descent would make the map small.
function everything(): THREE.Box3 {
  const box = seafloor.bounds();
  if (box.isEmpty()) box.union(vehicle.trackBox);
  const near = box.isEmpty() || vehicle.position.y < box.max.y + VEHICLE_NEAR;
  return vehicle.group.visible && near ? box.expandByPoint(vehicle.position) : box;
}

function showMode(): void {
  seafloor.setMode(mode, now());
  pending.group.visible = mode === 'coverage';
  mark('modes', mode, seafloor.hasColour ? [] : ['photo']);
  const map = state?.map;
  drawLegend(mode, seafloor.ranges, {
    finest: map?.levels.at(-1)?.spacing_m ?? 0.25, received: map?.area_m2 ?? 0, pending: map?.pending_m2 ?? 0, changed: map?.changed_m2 ?? 0,
  });
  view.draw();
}

// Contours at a round interval, ten or so over the range of depths.
function showContours(): void {
  const on = input('contours').checked;
  const [low, high] = seafloor.ranges.depth;
  const interval = [0.1, 0.2, 0.25, 0.5, 1, 2, 5, 10, 20].find((step) => (high - low) / step <= 14) ?? 50;
  seafloor.material.set('contour', on ? interval : 0);
  element('contour-choice').title = `Depth contours every ${interval} m`;
  view.draw();
}

function banner(text: string | null): void {
  element('banner').hidden = text === null;
  element('banner').textContent = text ?? '';
}

function showClock(): void {
  if (!state) return;
  const age = state.link.age_s === null ? null : state.link.age_s + sinceState();
  drawPanel(state, age, alarms.thresholds.silence_s);
  alarms.update(state, age);
  commands.update(state.downlink, now());
  if (failure instanceof Refused && failure.status === 401) banner(failure.message);
  else if (failure) banner('The monitor program does not answer; trying again');
  else if (!state.recorded && age !== null && age > LATE_AFTER) banner(`No frame for ${duration(age)}`);
  else banner(null);
  const { triangles, calls } = view;
  write('work', `${view.frameTime.toFixed(1)} ms a frame · ${count(triangles)} triangles in ${calls} calls · map ${bytes(seafloor.bytes)}`);
  Object.assign(document.body.dataset, { frame: view.frameTime.toFixed(2), triangles: String(triangles), bytes: String(seafloor.bytes) });
}

function restart(next: string): void {
  epoch = next;
  mapVersion = 0;
  trackPoints = slowVersion = -1;
  seafloor.clear();
  pending.clear();
  vehicle.clear();
}

// The map comes in pieces of a megabyte, so that a whole dive does not hold the page up.
async function takeMap(): Promise<void> {
  while (state && state.map_version !== mapVersion) {
    const { epoch: from, batch } = await fetchMap(mapVersion);
    if (from !== epoch) return; // the model has changed since that state: the next state has the new one
    const { version, baseUtc, chunks } = decodeChunks(batch);
    const first = chunks.find((chunk) => chunk.vertices > 0);
    if (first && !hasOrigin) setOrigin({ north: first.north, east: first.east, depth: first.depths[0]! });
    seafloor.baseUtc = baseUtc;
    seafloor.put(chunks);
    element('waiting').hidden = seafloor.size > 0;
    if (version === mapVersion) break;
    mapVersion = version;
    if (mapVersion >= state.map_version) break;
  }
  showMode();
  showContours();
}

function setOrigin(place: Place): void {
  origin = place;
  hasOrigin = true;
}

// What need not be seen at once.
async function refreshSlow(): Promise<void> {
  if (!state || state.version === slowVersion || performance.now() - slowAt < SLOW_INTERVAL) return;
  slowAt = performance.now();
  slowVersion = state.version;
  linkChart.set(await fetchHistory());
  if (hasOrigin) pending.set(decodeSquares(await fetchSquares()), origin);
}

async function refresh(): Promise<void> {
  state = await fetchState();
  stateAt = performance.now();
  if (state.epoch !== epoch) restart(state.epoch);
  playback.update(state.playback);
  const s = state.status;
  if (state.map_version !== mapVersion) await takeMap();
  // Positions hang on the scene's origin; before the first piece of map the vehicle gives it.
  if (s && !hasOrigin) setOrigin({ north: s.north_m, east: s.east_m, depth: s.depth_m });
  if (s) vehicle.setStatus(s, origin);
  if (state.track_points !== trackPoints && hasOrigin) {
    const points = await fetchTrack();
    trackPoints = points.length;
    vehicle.setTrack(points, origin);
  }
  await refreshSlow();
  if (following && s) view.moveTo(view.world.localToWorld(vehicle.position.clone()));
  else if (!view.touched) view.fit(everything());
  view.draw();
  // For tests and the screenshot script: what is on the screen.
  Object.assign(document.body.dataset, {
    chunks: String(seafloor.size), vertices: String(seafloor.vertices), track: String(Math.max(trackPoints, 0)),
    ready: String(seafloor.size > 0 && mapVersion >= state.map_version), finished: String(state.finished), epoch, pending: String(pending.count),
  });
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
      failure = null;
    } catch (error) {
      failure = error;
      console.warn(error);
    }
  } while (again);
  running = false;
  showClock();
}

segments('modes', [
  ['depth', 'Depth'], ['photo', 'Photo', 'Colour from the camera'], ['sigma', 'Sigma', 'Uncertainty of depth'],
  ['age', 'Age', 'Time since received'], ['coverage', 'Coverage', 'Received, changed, not received'],
], (value) => {
  mode = value as ColourMode;
  showMode();
});
segments('views', [['fit', 'Whole map'], ['top', 'From above'], ['follow', 'Follow']], (value) => {
  following = value === 'follow' && !following;
  view.touched = value !== 'fit';
  if (value !== 'follow') view.fit(everything(), value === 'top');
  mark('views', following ? 'follow' : null);
  void update();
});

function chooseTool(tool: Tool): void {
  tools.choose(tool);
  mark('tools', tool);
}
segments('tools', [['turn', 'Turn'], ['measure', 'Measure', 'Drag a line over the map'], ['box', 'Box', 'Drag a box to ask for detail']],
  (value) => chooseTool(value as Tool));
chooseTool('turn');
mark('views', null);

tools.onHover = (place: Place | null) => {
  const box = element('hover');
  box.hidden = place === null;
  if (!place) return;
  const m = state?.mission;
  box.textContent = `${m ? `${positionOf(m, place.north, place.east)}   ` : ''}${number(place.depth, 2, 'm deep')}`;
};
tools.onLine = (a, b, done) => {
  element('measure-card').hidden = false;
  element('measure-text').textContent = lineText([a, b]);
  if (done && measure(a, b).horizontal > 0) void fetchProfile(a, b).then((points) => profileChart.set(points)).catch((error: unknown) => console.warn(error));
};
tools.onBox = (box, done) => {
  if (done && areaOf(box) > 0) commands.setBox(box);
};
commands.onCleared = () => tools.showBox(null, 0);
element('measure-close').onclick = () => {
  element('measure-card').hidden = true;
  tools.clear();
};

const exaggeration = input('exaggeration');
exaggeration.oninput = () => {
  view.exaggeration = Number(exaggeration.value);
  seafloor.material.set('exaggeration', view.exaggeration);
  element('exaggeration-value').textContent = `${view.exaggeration}×`;
};
element('contours').onchange = showContours;
element('track').onchange = () => {
  vehicle.trackShown = input('track').checked;
  view.draw();
};

showMode();
onGrowth(() => void update());
setInterval(() => void update(), POLL_INTERVAL);
setInterval(() => {
  showClock();
  if (mode === 'age' || mode === 'coverage') showMode();
}, CLOCK_INTERVAL);
void update();
