import { post, type PlaybackState } from './api';
import { dateAndClock } from '#kit/format';
import { element, input } from '#kit/overlay';

// The time slider of a recording.

const SPEEDS: [value: number, label: string][] = [[1, '1×'], [10, '10×'], [60, '60×'], [300, '300×'], [0, 'at once']];

export class PlaybackBar {
  private slider = input('time-slider');
  private speed = element('play-speed') as HTMLSelectElement;
  private button = element('play') as HTMLButtonElement;
  private dragging = false;
  private state: PlaybackState | null = null;

  constructor() {
    for (const [value, label] of SPEEDS) this.speed.add(new Option(label, String(value)));
    this.slider.oninput = () => {
      this.dragging = true;
      this.showTime(Number(this.slider.value));
    };
    this.slider.onchange = () => {
      this.dragging = false;
      void this.wish({ seek_utc_s: Number(this.slider.value), playing: false });
    };
    this.button.onclick = () => {
      const s = this.state;
      if (!s) return;
      const atEnd = s.at_utc_s >= s.last_utc_s;
      // "At once" would end before anyone saw it.
      const speed = s.speed === 0 ? { speed: 60 } : {};
      if (atEnd) void this.wish({ seek_utc_s: s.first_utc_s, playing: true, ...speed });
      else void this.wish({ playing: !s.playing, ...(s.playing ? {} : speed) });
    };
    this.speed.onchange = () => void this.wish({ speed: Number(this.speed.value) });
  }

  private async wish(body: unknown): Promise<void> {
    try {
      await post('api/playback', body);
    } catch (error) {
      console.warn(error);
    }
  }

  private showTime(seconds: number): void {
    element('play-time').textContent = dateAndClock(seconds);
  }

  update(state: PlaybackState | null): void {
    this.state = state;
    element('playback').hidden = state === null;
    if (!state) return;
    this.slider.min = String(Math.floor(state.first_utc_s));
    this.slider.max = String(Math.ceil(state.last_utc_s));
    if (!this.dragging) {
      this.slider.value = String(state.at_utc_s);
      this.showTime(state.at_utc_s);
    }
    const runs = state.playing && state.at_utc_s < state.last_utc_s;
    this.button.textContent = runs ? '❚❚' : '▶';
    this.button.title = runs ? 'Pause' : 'Play';
    if (document.activeElement !== this.speed) {
      if (![...this.speed.options].some((o) => Number(o.value) === state.speed)) this.speed.add(new Option(`${state.speed}×`, String(state.speed)));
      this.speed.value = String(state.speed);
    }
  }
}
