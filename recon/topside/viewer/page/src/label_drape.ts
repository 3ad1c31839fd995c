import type { DiveImage } from './cameras';
import type { Labels } from './labels';
import { classColour } from '#kit/ramps';
import type { Patch } from './raster';

// Labels as a picture over the seafloor: each labelled image's footprint in its class's colour.

const EDGE = 2048; // of the picture [px]
const MARGIN = 0.5; // around the footprints [m]

export function drapeLabels(labels: Labels, images: DiveImage[]): Patch | null {
  const shown = images.filter((image, i) => labels.ofImage[i]! >= 0 && image.footprint.length > 2);
  if (shown.length === 0) return null;
  let [north0, east0, north1, east1] = [Infinity, Infinity, -Infinity, -Infinity];
  for (const { footprint } of shown)
    for (const [n, e] of footprint) {
      [north0, north1] = [Math.min(north0, n - MARGIN), Math.max(north1, n + MARGIN)];
      [east0, east1] = [Math.min(east0, e - MARGIN), Math.max(east1, e + MARGIN)];
    }
  const scale = EDGE / Math.max(north1 - north0, east1 - east0);
  const [width, height] = [Math.max(1, Math.ceil((east1 - east0) * scale)), Math.max(1, Math.ceil((north1 - north0) * scale))];
  const canvas = new OffscreenCanvas(width, height);
  const c = canvas.getContext('2d')!;
  images.forEach((image, i) => {
    const index = labels.ofImage[i]!;
    if (index < 0 || image.footprint.length < 3) return;
    c.beginPath();
    image.footprint.forEach(([n, e], k) => (k === 0 ? c.moveTo : c.lineTo).call(c, (e - east0) * scale, (north1 - n) * scale));
    c.closePath();
    c.fillStyle = `rgb(${classColour(index).join(',')})`;
    c.fill();
  });
  return {
    values: new Uint8Array(c.getImageData(0, 0, width, height).data.buffer), scalar: false, width, height,
    placement: [0, scale / width, (-east0 * scale) / width, -scale / height, 0, (north1 * scale) / height],
  };
}
