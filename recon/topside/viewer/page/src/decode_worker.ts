import { fromArrayBuffer } from 'geotiff';
import { pictureOf } from './demosaic';
import { imageSize } from './image_size';
import { isDeepPng, isJpeg, isPng, readDeepPng, type ImageFormat, type Raw } from './image_samples';

// Decodes one original image off the main thread.

export interface DecodeRequest {
  id: number;
  from: string | Blob;
  format: ImageFormat;
  edge: number; // the longer edge wanted [px]; 0: all pixels
}
export type DecodeAnswer = { id: number; width: number; height: number; bitmap: ImageBitmap } | { id: number; error: string };

// As it lies in the file: what a camera's or a viewer's program would turn or recolour stays as the lens model has it.
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
  const blob = typeof from === 'string' ? await fetch(from).then((answer) => {
    if (!answer.ok) throw new Error(answer.status === 404 ? 'is not there' : `cannot be had (${answer.status})`);
    return answer.blob();
  }) : from;
  const buffer = await blob.arrayBuffer();
  const bytes = new Uint8Array(buffer);
  let raw: Raw;
  if (isDeepPng(bytes)) raw = await readDeepPng(bytes);
  else if (isPng(bytes) || isJpeg(bytes)) {
    const type = { type: isPng(bytes) ? 'image/png' : 'image/jpeg' };
    const mosaic = format.format.startsWith('bayer');
    const size = imageSize(bytes);
    const shrink = edge > 0 && size && !mosaic ? Math.min(1, edge / Math.max(size.width, size.height)) : 1;
    const small: ImageBitmapOptions = size && shrink < 1 ? { resizeWidth: Math.max(1, Math.round(size.width * shrink)), resizeQuality: 'high' } : {};
    const bitmap = await createImageBitmap(new Blob([buffer], type), { ...AS_IT_IS, ...small });
    if (!mosaic) return { width: size?.width ?? bitmap.width, height: size?.height ?? bitmap.height, bitmap };
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
