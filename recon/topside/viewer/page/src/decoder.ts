import type { DecodeAnswer, DecodeRequest } from './decode_worker';
import type { Source } from './source';

// Hands images to two workers, one at a time each; what nobody wants any more is dropped before it starts.

const WORKERS = 2;

export interface Decoded {
  bitmap: ImageBitmap;
  width: number; // of the original
  height: number;
}
interface Job {
  request: Omit<DecodeRequest, 'id' | 'from'>;
  address: string;
  wanted: () => boolean;
  done: (d: Decoded | null) => void;
  failed: (e: Error) => void;
}

export class Decoder {
  private idle: Worker[] = [];
  private made = 0;
  private queue: Job[] = [];
  private running = new Map<number, Job>();
  private next = 1;
  constructor(private source: () => Source) {}

  // null when no longer wanted. Rejects with one line of text for an absent or broken file.
  decode(address: string, format: string, edge: number, wanted: () => boolean = () => true): Promise<Decoded | null> {
    return new Promise((done, failed) => {
      this.queue.push({ request: { format, edge }, address, wanted, done, failed });
      void this.pump();
    });
  }

  private worker(): Worker | null {
    const free = this.idle.pop();
    if (free) return free;
    if (this.made >= WORKERS) return null;
    ++this.made;
    const worker = new Worker(new URL('./decode_worker.ts', import.meta.url), { type: 'module' });
    worker.onmessage = ({ data }: MessageEvent<DecodeAnswer>) => {
      const job = this.running.get(data.id);
      this.running.delete(data.id);
      this.idle.push(worker);
      if ('error' in data) job?.failed(new Error(data.error));
      else if (job) job.done(data);
      void this.pump();
    };
    return worker;
  }

  private async pump(): Promise<void> {
    while (this.queue.length > 0) {
      if (!this.queue[0]!.wanted()) {
        this.queue.shift()!.done(null);
        continue;
      }
      const worker = this.worker();
      if (!worker) return;
      const job = this.queue.shift()!;
      const id = this.next++;
      try {
        const from = await this.source().blob(job.address);
        this.running.set(id, job);
        worker.postMessage({ id, from, ...job.request } satisfies DecodeRequest);
      } catch (error) {
        this.idle.push(worker);
        job.failed(error as Error);
      }
    }
  }
}
