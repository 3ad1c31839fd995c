// What the address keeps, so that another person sees the same: camera, layers, selection.

export interface Permalink {
  eye?: [number, number, number]; // scene [m]
  look?: [number, number, number]; // the point looked at
  surface?: string; // texture | plain | wire
  layer?: string;
  opacity?: number;
  show?: string[]; // track, footprints, labels...
  select?: [number, number, number]; // north, east, depth
  image?: string;
  time?: number; // [s]
}

const triple = (text: string | null): [number, number, number] | undefined => {
  const v = (text ?? '').split(',').map(Number);
  return v.length === 3 && v.every(Number.isFinite) && text ? [v[0]!, v[1]!, v[2]!] : undefined;
};
const single = (text: string | null): number | undefined => (text !== null && text !== '' && Number.isFinite(Number(text)) ? Number(text) : undefined);
const round = (v: number[]): string => v.map((x) => Number(x.toFixed(3))).join(',');

export function writePermalink(p: Permalink): string {
  const q = new URLSearchParams();
  if (p.eye) q.set('eye', round(p.eye));
  if (p.look) q.set('look', round(p.look));
  if (p.surface) q.set('surface', p.surface);
  if (p.layer) q.set('layer', p.layer);
  if (p.opacity !== undefined) q.set('opacity', String(p.opacity));
  if (p.show) q.set('show', p.show.join(','));
  if (p.select) q.set('select', round(p.select));
  if (p.image) q.set('image', p.image);
  if (p.time !== undefined) q.set('time', p.time.toFixed(3));
  return `#${q.toString().replaceAll('%2C', ',')}`;
}

export function readPermalink(hash: string): Permalink {
  const q = new URLSearchParams(hash.replace(/^#/, ''));
  const out: Permalink = {
    eye: triple(q.get('eye')), look: triple(q.get('look')), select: triple(q.get('select')), opacity: single(q.get('opacity')), time: single(q.get('time')),
    surface: q.get('surface') ?? undefined, layer: q.get('layer') ?? undefined, image: q.get('image') ?? undefined,
    show: q.has('show') ? q.get('show')!.split(',').filter((s) => s !== '') : undefined,
  };
  for (const key of Object.keys(out) as (keyof Permalink)[]) if (out[key] === undefined) delete out[key];
  return out;
}
