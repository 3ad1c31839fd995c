import type { Samples } from './demosaic';
import { imageSize } from './image_size';

// What an original image holds, from the bytes of its file: TIFF, PNG and JPEG.

export interface Raw {
  width: number;
  height: number;
  bands: number; // samples of a pixel
  samples: Samples;
  bits: number; // of a sample in the file: 8 or 16
}

const BANDS: Record<number, number> = { 0: 1, 2: 3, 4: 2, 6: 4 }; // of a PNG's colour types

export const isDeepPng = (bytes: Uint8Array): boolean => imageSize(bytes)?.type === 'image/png' && bytes[24] === 16;

// A PNG of 16 bits, of which a browser's own decoder keeps eight (ISO 15948, sections 7 and 9).
export async function readDeepPng(bytes: Uint8Array): Promise<Raw> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const [width, height, bands] = [view.getUint32(16), view.getUint32(20), BANDS[bytes[25]!] ?? 0];
  if (bands === 0 || bytes[28] !== 0) throw new Error('is a PNG of a kind that this page does not read (interlaced, or with a palette)');
  const parts: Uint8Array[] = [];
  for (let at = 8; at + 12 <= bytes.length; at += 12 + view.getUint32(at))
    if (view.getUint32(at + 4) === 0x49444154) parts.push(bytes.slice(at + 8, at + 8 + view.getUint32(at))); // IDAT
  const plain = new Uint8Array(await new Response(new Blob(parts).stream().pipeThrough(new DecompressionStream('deflate'))).arrayBuffer());
  const [pixel, stride] = [2 * bands, 2 * bands * width];
  if (plain.length < height * (stride + 1)) throw new Error('ends too early');
  const samples = new Uint16Array(width * height * bands);
  let above = new Uint8Array(stride);
  for (let y = 0; y < height; ++y) {
    const filter = plain[y * (stride + 1)]!;
    const line = plain.subarray(y * (stride + 1) + 1, (y + 1) * (stride + 1));
    for (let i = 0; i < stride; ++i) {
      const [a, b, c] = [i < pixel ? 0 : line[i - pixel]!, above[i]!, i < pixel ? 0 : above[i - pixel]!];
      const [pa, pb, pc] = [Math.abs(b - c), Math.abs(a - c), Math.abs(a + b - 2 * c)];
      const guess = [0, a, b, (a + b) >> 1, pa <= pb && pa <= pc ? a : pb <= pc ? b : c][filter] ?? 0;
      line[i] = (line[i]! + guess) & 255;
    }
    for (let i = 0; i < width * bands; ++i) samples[y * width * bands + i] = (line[2 * i]! << 8) | line[2 * i + 1]!;
    above = line;
  }
  return { width, height, bands, samples, bits: 16 };
}
