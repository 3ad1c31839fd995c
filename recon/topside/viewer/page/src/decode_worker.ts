import { fromArrayBuffer } from 'geotiff';
import { pictureOf } from './demosaic';
import { imageSize } from './image_size';
import { isDeepPng, readDeepPng, type Raw } from './image_samples';

// Decodes one original image off the main thread.

export interface DecodeRequest {
  id: number;
  from: Blob;
  format: string; // scene.json's image_format
  edge: number; // the longer edge wanted [px]; 0: all pixels
}
export type DecodeAnswer = { id: number; width: number; height: number; bitmap: ImageBitmap } | { id: number; error: string };

// As the file has it: what a camera's or a viewer's program would turn or recolour stays as the lens model has it.
const AS_IT_IS: ImageBitmapOptions = { imageOrientation: 'none', colorSpaceConversion: 'none', premultiplyAlpha: 'none' };

async function readTiff(buffer: ArrayBuffer): Promise<Raw> {
  const image = await (await fromArrayBuffer(buffer)).getImage();
  const samples = (await image.readRasters({ interleave: true })) as unknown as Uint16Array;
  return { width: image.getWidth(), height: image.getHeight(), bands: image.getSamplesPerPixel(), samples, bits: samples instanceof Uint8Array ? 8 : 16 };
}

// A mosaic of 8 bits that a browser's decoder gives as grey.
function greyOf(bitmap: ImageBitmap): Raw {
  const { width, height } = bitmap;
  const c = new OffscreenCanvas(width, height).getContext('2d', { willReadFrequently: true })!;
  c.drawImage(bitmap, 0, 0);
  const { data } = c.getImageData(0, 0, width, height);
  return { width, height, bands: 1, samples: Uint8Array.from({ length: width * height }, (_, i) => data[4 * i]!), bits: 8 };
}

async function decode({ from, format, edge }: DecodeRequest): Promise<{ width: number; height: number; bitmap: ImageBitmap }> {
  const buffer = await from.arrayBuffer();
  const bytes = new Uint8Array(buffer);
  const size = imageSize(bytes); // of what a browser decodes by itself
  let raw: Raw;
  if (isDeepPng(bytes)) raw = await readDeepPng(bytes);
  else if (size) {
    const { width, height, type } = size;
    const mosaic = format.startsWith('bayer');
    const shrink = edge > 0 && !mosaic ? edge / Math.max(width, height) : 1;
    const small: ImageBitmapOptions = shrink < 1 ? { resizeWidth: Math.max(1, Math.round(width * shrink)), resizeQuality: 'high' } : {};
    const bitmap = await createImageBitmap(new Blob([buffer], { type }), { ...AS_IT_IS, ...small });
    if (!mosaic) return { width, height, bitmap };
    raw = greyOf(bitmap);
    bitmap.close();
  } else raw = await readTiff(buffer);
  const shrink = edge > 0 ? Math.max(1, Math.floor(Math.max(raw.width, raw.height) / edge)) : 1;
  const picture = pictureOf(raw, format, shrink);
  return { width: raw.width, height: raw.height, bitmap: await createImageBitmap(new ImageData(picture.rgba, picture.width, picture.height)) };
}

self.onmessage = async ({ data }: MessageEvent<DecodeRequest>) => {
  try {
    const decoded = await decode(data);
    postMessage({ id: data.id, ...decoded } satisfies DecodeAnswer, { transfer: [decoded.bitmap] });
  } catch (error) {
    postMessage({ id: data.id, error: error instanceof Error ? error.message : String(error) } satisfies DecodeAnswer);
  }
};
