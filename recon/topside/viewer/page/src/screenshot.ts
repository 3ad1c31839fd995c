import { save, scaleLength } from '#kit/overlay';
import type { View } from './view';

// The picture with a scale bar, north and what it shows, as PNG.

const PAD = 16; // [px]
const LONGEST_SCALE = 180; // [px]

export async function picture(view: View, lines: string[]): Promise<Blob> {
  view.renderer.render(view.scene, view.camera);
  const source = view.canvas;
  const ratio = source.width / source.clientWidth;
  const canvas = new OffscreenCanvas(source.width, source.height);
  const c = canvas.getContext('2d')!;
  c.drawImage(source, 0, 0);
  c.scale(ratio, ratio);
  const [width, height] = [source.clientWidth, source.clientHeight];
  c.shadowColor = '#000';
  c.shadowBlur = 4;
  c.fillStyle = c.strokeStyle = '#fff';
  c.font = '14px system-ui, "DejaVu Sans", sans-serif';
  const { pixels, text } = scaleLength(view.metresPerPixel(), LONGEST_SCALE);
  c.fillRect(PAD, height - PAD - 5, pixels, 5);
  c.fillText(text, PAD + pixels + 8, height - PAD);
  lines.forEach((line, i) => c.fillText(line, PAD, PAD + 12 + 19 * i));
  c.translate(width - PAD - 24, height - PAD - 24);
  c.rotate((view.northAngle() * Math.PI) / 180);
  c.beginPath();
  c.moveTo(0, -22);
  c.lineTo(9, 12);
  c.lineTo(0, 6);
  c.lineTo(-9, 12);
  c.closePath();
  c.fill();
  c.textAlign = 'center';
  c.font = '600 13px system-ui, "DejaVu Sans", sans-serif';
  c.fillText('N', 0, 28);
  return canvas.convertToBlob({ type: 'image/png' });
}

export async function savePicture(view: View, name: string, lines: string[]): Promise<void> {
  save(`${name.replace(/[^\w.-]+/g, '_')}.png`, await picture(view, lines));
}
