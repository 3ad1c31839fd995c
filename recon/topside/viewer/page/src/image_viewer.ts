import { element } from '#kit/overlay';

// One original image, all its pixels, with a cross where the point is: drag moves it, the wheel zooms.

const MOST_ZOOM = 16;

export class ImageViewer {
  private canvas = element('viewer-canvas') as HTMLCanvasElement;
  private bitmap: ImageBitmap | null = null;
  private mark: [number, number] | null = null;
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
    canvas.addEventListener('pointerdown', (e) => canvas.setPointerCapture(e.pointerId));
    canvas.addEventListener('pointermove', (e) => {
      if (!(e.buttons & 1)) return;
      this.left += e.movementX;
      this.top += e.movementY;
      this.draw();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  get open(): boolean {
    return !element('viewer').hidden;
  }
  show(bitmap: ImageBitmap, mark: [number, number] | null, text: string): void {
    if (this.bitmap !== bitmap) this.bitmap?.close();
    this.bitmap = bitmap;
    this.mark = mark;
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
    if (this.mark) cross(c, this.left + (this.mark[0] + 0.5) * this.zoom, this.top + (this.mark[1] + 0.5) * this.zoom, 18);
  }
}

export function cross(c: CanvasRenderingContext2D, x: number, y: number, size: number): void {
  for (const [colour, width] of [['rgb(11 18 23 / 80%)', 3.5], ['#ffe08a', 1.6]] as const) {
    c.strokeStyle = colour;
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
