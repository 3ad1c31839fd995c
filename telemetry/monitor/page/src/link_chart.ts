import uPlot from 'uplot';
import { Chart, axis } from '#kit/charts';
import type { History } from './api';
import { linkSeries, thinned } from './link_series';

// The acoustic link over time: bits a second and the share of lost frames.

const HEIGHT = 132; // [px]
const POINT_WIDTH = 5; // [px]
const STEPS = uPlot.paths.stepped!({ align: 1 });
const minutes = (seconds: number): string => new Date(seconds * 1000).toISOString().slice(11, 16);

export class LinkChart {
  private chart: Chart;
  constructor(private box: HTMLElement) {
    this.chart = new Chart(box, HEIGHT);
    this.chart.show({
      padding: [8, 4, 0, 0],
      scales: { x: { time: true }, rate: { range: (_, __, max) => [0, Math.max(100, (max || 0) * 1.15)] }, loss: { range: [0, 100] } },
      axes: [
        axis({ size: 22, values: (_, ticks) => ticks.map(minutes), space: 60 }),
        axis({ scale: 'rate', space: 28, size: 40, values: (_, ticks) => ticks.map((t) => (t >= 1000 ? `${t / 1000}k` : String(t))) }),
        axis({ scale: 'loss', side: 1, grid: { show: false }, space: 28, size: 38, values: (_, ticks) => ticks.map((t) => `${t}%`) }),
      ],
      series: [
        {},
        { label: 'bit/s', scale: 'rate', stroke: '#6fb7c9', fill: 'rgb(111 183 201 / 22%)', width: 1.5, points: { show: false }, paths: STEPS },
        { label: 'lost', scale: 'loss', stroke: '#e8866a', width: 1.2, points: { show: false }, paths: STEPS },
      ],
    }, [[], [], []]);
  }
  set(history: History): void {
    this.chart.plot!.setData(linkSeries(thinned(history, Math.max(40, Math.floor(this.box.clientWidth / POINT_WIDTH)))));
  }
}
