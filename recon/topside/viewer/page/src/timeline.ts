import type { Series, Track } from './dive';
import { clock, number } from '#kit/format';
import type { Marks } from './marks';
import { element } from '#kit/overlay';
import { TimelineChart } from './timeline_chart';
import type { View } from './view';

// The vehicle over time: altitude and one more series, the stages of the dive, and where it was at the time pointed at.

export class Timeline {
  time: number | null = null; // [s]
  private chart = new TimelineChart(element('timeline'));
  private second: string | null = null;

  constructor(private track: Track, private marks: Marks, private view: View) {
    this.chart.onScrub = (index) => this.go(index);
    const choose = element('timeline-series') as HTMLSelectElement;
    const [first, ...rest] = track.series;
    choose.replaceChildren(...rest.map((s) => new Option(first ? `${first.title} and ${s.title.toLowerCase()}` : s.title, s.key)));
    choose.hidden = rest.length < 2;
    this.second = rest[0]?.key ?? null;
    choose.onchange = () => {
      this.second = choose.value;
      this.draw();
    };
    this.text(null);
  }

  private get shown(): Series[] {
    const [first] = this.track.series;
    const second = this.track.series.find((s) => s.key === this.second && s !== first);
    return [first, second].filter((s): s is Series => s !== undefined);
  }

  draw(): void {
    this.chart.set(this.track, this.shown);
    this.chart.setMarker(this.time);
  }

  goToTime(utc: number): void {
    let [low, high] = [0, this.track.utc.length - 1];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.track.utc[middle]! < utc) low = middle + 1;
      else high = middle;
    }
    this.go(low);
  }

  private go(index: number): void {
    const { utc, north, east, depth, heading } = this.track;
    const [n, e, d] = [north[index], east[index], depth[index]];
    this.time = utc[index] ?? null;
    this.marks.setVehicle(n !== null && n !== undefined && e !== null && e !== undefined ? { north: n, east: e, depth: d ?? 0 } : null, heading[index] ?? null);
    this.chart.setMarker(this.time);
    this.text(index);
    document.body.dataset.time = String(this.time);
    this.view.draw();
  }

  private text(index: number | null): void {
    const { utc, stage, series, heading } = this.track;
    element('timeline-text').textContent = index === null
      ? (this.track.timed ? `${clock(utc[0]!)} to ${clock(utc.at(-1)!)} UTC` : 'nobody says when: seconds from the first image')
      : [this.track.timed ? clock(utc[index]!) : `${utc[index]!.toFixed(1)} s`, stage[index] ?? null, ...series.filter((s) => s.key === 'altitude' || s.key === 'depth' || s.key === this.second)
          .map((s) => `${s.title.toLowerCase()} ${number(s.values[index], s.unit === '°' ? 0 : 2, s.unit)}`),
        heading[index] === null ? null : `heading ${number(heading[index], 0, '°').replace(' ', '')}`].filter((t) => t !== null).join(' · ');
  }
}
