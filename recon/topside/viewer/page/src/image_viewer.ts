import type { ControlMarks } from './control_marks';
import { element, input } from '#kit/overlay';

// One original image, all its pixels, with a cross where the point is: drag moves it, the wheel zooms, a click marks the surveyed point
// whose name is written above.

const MOST_ZOOM = 16;
const CLICK_SLOP = 3; // [px] the pointer may move between down and up
const MARK_COLOUR = '#7fe0a8';

export class ImageViewer {
  private canvas = element('viewer-canvas') as HTMLCanvasElement;
  private bitmap: ImageBitmap | null = null;
  private mark: [number, number] | null = null;
  private image = '';
  private marks: ControlMarks | null = null;
  private moved = 0; // since the pointer went down [px]
  private zoom = 1;
  private left = 0; // of the image on the canvas [px]
  private top = 0;

  constructor() {
    const { canvas } = this;
    element('viewer-close').onclick = () => this.close();
    element('viewer-fit').onclick = () => this.fit();
    element('viewer-one').onclick = () => this.zoomTo(1 / devicePixelRatio, canvas.clientWidth / 2, canvas.clientHeight / 2);
    canvas.addEventListener('wheel', (e) => {
      e.preventDefault();
      this.zoomTo(this.zoom * 1.0015 ** -e.deltaY, e.offsetX, e.offsetY);
    }, { passive: false });
    canvas.addEventListener('pointerdown', (e) => {
      canvas.setPointerCapture(e.pointerId);
      this.moved = 0;
    });
    canvas.addEventListener('pointerup', (e) => {
      if (e.button === 0 && this.moved <= CLICK_SLOP) this.click(e.offsetX, e.offsetY);
    });
    element('mark-remove').onclick = () => this.marks?.remove(input('mark-point').value.trim(), this.image);
    input('mark-point').oninput = () => this.draw();
    canvas.addEventListener('pointermove', (e) => {
      if (!(e.buttons & 1)) return;
      this.moved += Math.abs(e.movementX) + Math.abs(e.movementY);
      this.left += e.movementX;
      this.top += e.movementY;
      this.draw();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  get open(): boolean {
    return !element('viewer').hidden;
  }
  markIn(marks: ControlMarks): void {
    this.marks = marks;
    marks.onChange = () => this.draw();
  }
  show(bitmap: ImageBitmap, mark: [number, number] | null, text: string, image: string): void {
    if (this.bitmap !== bitmap) this.bitmap?.close();
    this.bitmap = bitmap;
    this.mark = mark;
    this.image = image;
    element('viewer').hidden = false;
    element('viewer-text').textContent = text;
    this.fit();
    document.body.dataset.viewer = `${bitmap.width}x${bitmap.height}`;
  }
  close(): void {
    element('viewer').hidden = true;
    this.bitmap?.close();
    this.bitmap = null;
  }

  private click(x: number, y: number): void {
    const point = input('mark-point').value.trim();
    const [u, v] = [(x - this.left) / this.zoom - 0.5, (y - this.top) / this.zoom - 0.5];
    if (!this.bitmap || point === '' || u < -0.5 || v < -0.5 || u > this.bitmap.width - 0.5 || v > this.bitmap.height - 0.5) return;
    this.marks?.set({ point, image: this.image, u, v });
  }
  private fit(): void {
    const { bitmap, canvas } = this;
    if (!bitmap) return;
    this.zoom = Math.min(canvas.clientWidth / bitmap.width, canvas.clientHeight / bitmap.height);
    this.left = (canvas.clientWidth - bitmap.width * this.zoom) / 2;
    this.top = (canvas.clientHeight - bitmap.height * this.zoom) / 2;
    this.draw();
  }
  private zoomTo(zoom: number, x: number, y: number): void {
    const to = Math.min(Math.max(zoom, 0.1), MOST_ZOOM);
    this.left = x - ((x - this.left) * to) / this.zoom;
    this.top = y - ((y - this.top) * to) / this.zoom;
    this.zoom = to;
    this.draw();
  }
  private draw(): void {
    const { canvas, bitmap } = this;
    if (!bitmap) return;
    const ratio = devicePixelRatio;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const c = canvas.getContext('2d')!;
    c.scale(ratio, ratio);
    c.imageSmoothingEnabled = this.zoom < 3;
    c.imageSmoothingQuality = 'high';
    c.drawImage(bitmap, this.left, this.top, bitmap.width * this.zoom, bitmap.height * this.zoom);
    const at = (u: number, v: number): [number, number] => [this.left + (u + 0.5) * this.zoom, this.top + (v + 0.5) * this.zoom];
    if (this.mark) cross(c, ...at(...this.mark), 18);
    const chosen = input('mark-point').value.trim();
    const here = this.marks?.of(this.image) ?? [];
    c.font = '13px system-ui, sans-serif';
    for (const { point, u, v } of here) {
      const [x, y] = at(u, v);
      cross(c, x, y, 14, MARK_COLOUR);
      c.fillStyle = 'rgb(11 18 23 / 80%)';
      c.fillRect(x + 11, y - 24, c.measureText(point).width + 8, 18);
      c.fillStyle = MARK_COLOUR;
      c.fillText(point, x + 15, y - 11);
    }
    element('mark-remove').hidden = !here.some((m) => m.point === chosen);
  }
}

export function cross(c: CanvasRenderingContext2D, x: number, y: number, size: number, colour = '#ffe08a'): void {
  for (const [stroke, width] of [['rgb(11 18 23 / 80%)', 3.5], [colour, 1.6]] as const) {
    c.strokeStyle = stroke;
    c.lineWidth = width;
    c.beginPath();
    c.arc(x, y, size * 0.45, 0, 7);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
      c.moveTo(x + dx * size * 0.25, y + dy * size * 0.25);
      c.lineTo(x + dx * size, y + dy * size);
    }
    c.stroke();
  }
}
