import { length } from './format';
import type { Place } from './place';

// What can be measured between places in nav.

export interface Measured {
  slope: number; // 3D distance [m]
  horizontal: number; // [m]
  drop: number; // depth of the second minus the first [m]
  bearing: number; // from the first to the second, from true north [deg]
}

export function measure(a: Place, b: Place): Measured {
  const north = b.north - a.north;
  const east = b.east - a.east;
  const drop = b.depth - a.depth;
  const horizontal = Math.hypot(north, east);
  const bearing = ((Math.atan2(east, north) * 180) / Math.PI + 360) % 360;
  return { slope: Math.hypot(horizontal, drop), horizontal, drop, bearing };
}

// Along the points, straight from each to the next.
export function pathLength(points: Place[]): { slope: number; horizontal: number } {
  let slope = 0;
  let horizontal = 0;
  for (let i = 1; i < points.length; ++i) {
    const leg = measure(points[i - 1]!, points[i]!);
    slope += leg.slope;
    horizontal += leg.horizontal;
  }
  return { slope, horizontal };
}

export function lineText(points: Place[]): string {
  const { slope, horizontal } = pathLength(points);
  const { drop, bearing } = measure(points[0]!, points.at(-1)!);
  return `${length(slope)} · horizontal ${length(horizontal)} · ${length(Math.abs(drop))} ${drop >= 0 ? 'deeper' : 'shallower'} · bearing ${bearing.toFixed(0).padStart(3, '0')}°`;
}

// The polygon's area seen from above (shoelace) [m2].
export function planArea(corners: Place[]): number {
  let twice = 0;
  corners.forEach((a, i) => {
    const b = corners[(i + 1) % corners.length]!;
    twice += a.north * b.east - b.north * a.east;
  });
  return Math.abs(twice) / 2;
}

export function inside(corners: Place[], north: number, east: number): boolean {
  let odd = false;
  corners.forEach((a, i) => {
    const b = corners[(i + 1) % corners.length]!;
    if (a.north > north !== b.north > north && east < a.east + ((north - a.north) / (b.north - a.north)) * (b.east - a.east)) odd = !odd;
  });
  return odd;
}

// `count` points along the polyline at equal steps of horizontal distance, ends included.
export function stations(points: Place[], count: number): { along: number; north: number; east: number }[] {
  const total = pathLength(points).horizontal;
  const out: { along: number; north: number; east: number }[] = [];
  let leg = 1;
  let before = 0;
  for (let i = 0; i < count; ++i) {
    const along = (total * i) / (count - 1);
    let size = measure(points[leg - 1]!, points[leg]!).horizontal;
    while (along > before + size && leg < points.length - 1) {
      before += size;
      ++leg;
      size = measure(points[leg - 1]!, points[leg]!).horizontal;
    }
    const a = points[leg - 1]!;
    const b = points[leg]!;
    const t = size > 0 ? Math.min((along - before) / size, 1) : 0;
    out.push({ along, north: a.north + t * (b.north - a.north), east: a.east + t * (b.east - a.east) });
  }
  return out;
}

// A grid of heights (positive up, NaN where there is none), rows from north to south.
export interface HeightGrid {
  values: ArrayLike<number>;
  width: number;
  height: number;
  north: number; // of the centre of the first row [m]
  east: number; // of the centre of the first column [m]
  step: number; // [m]
}

// The seafloor's own area inside the polygon, fold by fold: two triangles a cell whose four heights are known and whose
// centre is inside; `plan` is what those cells cover seen from above. Their ratio is the rugosity.
export function surfaceArea(grid: HeightGrid, corners: Place[]): { surface: number; plan: number } {
  let surface = 0;
  let plan = 0;
  const { values, width, height, step } = grid;
  const triangle = (dx: number, dy: number): number => (step / 2) * Math.sqrt(step * step + dx * dx + dy * dy);
  for (let r = 0; r + 1 < height; ++r)
    for (let c = 0; c + 1 < width; ++c) {
      if (!inside(corners, grid.north - (r + 0.5) * step, grid.east + (c + 0.5) * step)) continue;
      const [a, b, d, e] = [values[r * width + c]!, values[r * width + c + 1]!, values[(r + 1) * width + c]!, values[(r + 1) * width + c + 1]!];
      if (!Number.isFinite(a + b + d + e)) continue;
      surface += triangle(b - a, d - a) + triangle(e - d, e - b);
      plan += step * step;
    }
  return { surface, plan };
}

// What of the seafloor rises above the plane that fits the corners best, and what is below it [m3]: a mound or a pit
// that the corners were put around. Cells as in surfaceArea; those without a height count as the others on the mean.
export function volumes(grid: HeightGrid, corners: Place[]): { above: number; below: number } {
  const mean = (of: (p: Place) => number): number => corners.reduce((sum, p) => sum + of(p), 0) / corners.length;
  const [north, east, up] = [mean((p) => p.north), mean((p) => p.east), mean((p) => -p.depth)];
  let [nn, ne, ee, nu, eu] = [0, 0, 0, 0, 0];
  for (const p of corners) {
    const [n, e, u] = [p.north - north, p.east - east, -p.depth - up];
    nn += n * n; ne += n * e; ee += e * e; nu += n * u; eu += e * u;
  }
  const det = nn * ee - ne * ne;
  const [byNorth, byEast] = det > 0 ? [(nu * ee - eu * ne) / det, (eu * nn - nu * ne) / det] : [0, 0];
  let above = 0;
  let below = 0;
  let plan = 0;
  const { values, width, height, step } = grid;
  for (let r = 0; r + 1 < height; ++r)
    for (let c = 0; c + 1 < width; ++c) {
      const n = grid.north - (r + 0.5) * step;
      const e = grid.east + (c + 0.5) * step;
      if (!inside(corners, n, e)) continue;
      const z = (values[r * width + c]! + values[r * width + c + 1]! + values[(r + 1) * width + c]! + values[(r + 1) * width + c + 1]!) / 4;
      if (!Number.isFinite(z)) continue;
      const over = z - (up + byNorth * (n - north) + byEast * (e - east));
      if (over > 0) above += over * step * step;
      else below -= over * step * step;
      plan += step * step;
    }
  const share = plan > 0 ? planArea(corners) / plan : 0;
  return { above: above * share, below: below * share };
}

// Between the four nodes around a place; NaN outside or beside a hole.
export function sampleGrid(grid: HeightGrid, north: number, east: number): number {
  const row = (grid.north - north) / grid.step;
  const column = (east - grid.east) / grid.step;
  const r = Math.min(Math.max(Math.floor(row), 0), grid.height - 2);
  const c = Math.min(Math.max(Math.floor(column), 0), grid.width - 2);
  const v = row - r;
  const u = column - c;
  if (!(u >= -0.5 && u <= 1.5 && v >= -0.5 && v <= 1.5) || grid.width < 2 || grid.height < 2) return NaN;
  const at = (y: number, x: number): number => grid.values[(r + y) * grid.width + c + x]!;
  return (1 - v) * ((1 - u) * at(0, 0) + u * at(0, 1)) + v * ((1 - u) * at(1, 0) + u * at(1, 1));
}
