import { fromBlob, fromUrl } from 'geotiff';
import { develop } from './demosaic';

// Decodes one original image off the main thread.

export interface DecodeRequest {
  id: number;
  from: string | Blob;
  bayer: boolean;
  edge: number; // the longer edge wanted [px]; 0: all pixels
}
export type DecodeAnswer = { id: number; width: number; height: number; bitmap: ImageBitmap } | { id: number; error: string };

self.onmessage = async ({ data }: MessageEvent<DecodeRequest>) => {
  try {
    const tiff = await (typeof data.from === 'string' ? fromUrl(data.from, { allowFullFile: true }) : fromBlob(data.from));
    const image = await tiff.getImage();
    const [width, height] = [image.getWidth(), image.getHeight()];
    const bands = image.getSamplesPerPixel();
    const samples = (await image.readRasters({ interleave: true })) as unknown as Uint16Array;
    const shrink = data.edge > 0 ? Math.max(1, Math.floor(Math.max(width, height) / data.edge)) : 1;
    let picture;
    if (bands >= 3) {
      const rgba = new Uint8ClampedArray(width * height * 4);
      const scale = samples instanceof Uint8Array ? 1 : 1 / 257;
      for (let i = 0; i < width * height; ++i) {
        for (let c = 0; c < 3; ++c) rgba[4 * i + c] = samples[bands * i + c]! * scale;
        rgba[4 * i + 3] = 255;
      }
      picture = { width, height, rgba };
    } else picture = develop(samples, width, height, data.bayer, shrink);
    const bitmap = await createImageBitmap(new ImageData(picture.rgba, picture.width, picture.height));
    postMessage({ id: data.id, width, height, bitmap } satisfies DecodeAnswer, { transfer: [bitmap] });
  } catch (error) {
    postMessage({ id: data.id, error: error instanceof Error ? error.message : String(error) } satisfies DecodeAnswer);
  }
};
