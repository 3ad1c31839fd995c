// How coarse the picture must be so that what it needs fits: the bytes in use and the draw calls decide a factor on the
// allowed screen error and on texture sizes. Above 1 the page says that resolution is reduced; it never stops loading.

export interface Load {
  used: number; // bytes of tiles that the present view uses
  limit: number; // bytes that may be held
  calls: number; // draw calls of the last frame
}

export const MOST_CALLS = 300;
const CALLS_ALARM = 0.93; // of the most: tiles come in groups, so the answer is early
const CALLS_EASY = 0.6;
const FULL = 0.9; // of the limit in use
const EASY = 0.55; // hysteresis: well below FULL over the step, or it would swing
const STEP = 1.2;
const MOST_FACTOR = 32;
const HOLD = 12; // updates in a row that must be easy before the picture sharpens again
const MOST_HOLD = 400;

export class Budget {
  factor = 1;
  private easy = 0; // updates in a row
  private hold = HOLD;
  private sharpened = false; // since the last coarsening

  // Gives whether the factor changed. `refused`: a tile was turned away since the last time because nothing more fits.
  update({ used, limit, calls }: Load, refused: boolean): boolean {
    const before = this.factor;
    if (refused || used > FULL * limit || calls > CALLS_ALARM * MOST_CALLS) {
      this.factor = Math.min(this.factor * STEP, MOST_FACTOR);
      // Sharpening did not last: the next try waits longer, or the picture would swing for ever.
      if (this.sharpened) this.hold = Math.min(2 * this.hold, MOST_HOLD);
      this.sharpened = false;
      this.easy = 0;
    } else if (used < EASY * limit && calls < CALLS_EASY * MOST_CALLS) {
      if (++this.easy >= this.hold && this.factor > 1) {
        this.factor = Math.max(this.factor / STEP, 1);
        this.sharpened = true;
        this.easy = 0;
      }
    } else this.easy = 0;
    return this.factor !== before;
  }

  // Another view: what did not fit before may fit now.
  moved(): void {
    this.hold = HOLD;
  }

  get reduced(): boolean {
    return this.factor > 1;
  }
}

const MEBIBYTE = 2 ** 20;
const SHARE_OF_DEVICE = 1 / 8;

// Browsers tell the device's memory in GiB, capped at 8, and some not at all.
export function defaultLimit(deviceGibibytes: number | undefined): number {
  return Math.round(Math.min(Math.max((deviceGibibytes ?? 4) * 1024 * SHARE_OF_DEVICE, 192), 1024)) * MEBIBYTE;
}

// How many times a texture of `width` x `height` texels may be halved so that a texel still is no larger than a pixel:
// `texel` its size on the ground and `pixel` the ground's size of a pixel where the tile is nearest [m].
export const LEAST_TEXTURE_EDGE = 32;
export function halvings(texel: number, pixel: number, width: number, height: number): number {
  const room = Math.floor(Math.log2(Math.max(Math.min(width, height) / LEAST_TEXTURE_EDGE, 1)));
  if (!(texel > 0) || !Number.isFinite(pixel)) return Number.isFinite(pixel) ? 0 : room;
  return Math.min(Math.max(Math.floor(Math.log2(pixel / texel)), 0), room);
}

// What a texture costs on the graphics card with its mipmaps [bytes].
export const textureBytes = (width: number, height: number): number => Math.ceil((width * height * 4 * 4) / 3);
