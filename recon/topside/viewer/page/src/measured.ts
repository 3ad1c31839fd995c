import { pathLength, planArea } from '#kit/measure';
import type { Projection } from '#kit/geodesy';
import type { Place } from '#kit/place';

// Lines and areas that were measured, as GeoJSON for a GIS.

export interface Measured {
  area: boolean; // else a line
  points: Place[];
  text: string; // as it was shown
}

export function measuredGeoJson(list: Measured[], projection: Projection | null, dive: string): string {
  const features = list.map(({ area, points, text }, i) => {
    const line = points.map((p) => {
      const g = projection?.toGeodetic(p);
      return [Number((g?.longitude ?? p.east).toFixed(9)), Number((g?.latitude ?? p.north).toFixed(9)), Number((-p.depth).toFixed(4))];
    });
    // Rings close, and run against the clock (RFC 7946).
    const twice = points.reduce((sum, p, k) => { const q = points[(k + 1) % points.length]!; return sum + p.east * q.north - q.east * p.north; }, 0);
    const ring = twice < 0 ? [...line].reverse() : line;
    return {
      type: 'Feature', id: i + 1,
      geometry: area ? { type: 'Polygon', coordinates: [[...ring, ring[0]]] } : { type: 'LineString', coordinates: line },
      properties: { dive, kind: area ? 'area' : 'line', text, ...(area ? { plan_area_m2: Number(planArea(points).toFixed(6)) } : { length_m: Number(pathLength(points).slope.toFixed(4)), horizontal_m: Number(pathLength(points).horizontal.toFixed(4)) }) },
    };
  });
  return `${JSON.stringify({ type: 'FeatureCollection', features }, null, 1)}\n`;
}
