import { duration, niceBelow, number } from './format';
import { MAGMA, VIRIDIS, cssGradient } from './ramps';
import type { ColourMode, Ranges } from './seafloor';

// What lies over the picture: buttons, legend, scale, north, banner.

export const element = (id: string): HTMLElement => document.getElementById(id)!;

export function segments(id: string, choices: [value: string, label: string][], choose: (value: string) => void): void {
  for (const [value, label] of choices) {
    const button = document.createElement('button');
    button.textContent = label;
    button.dataset.value = value;
    button.onclick = () => choose(value);
    element(id).append(button);
  }
}

export function mark(id: string, chosen: string | null, disabled: string[] = []): void {
  for (const button of element(id).querySelectorAll('button')) {
    button.setAttribute('aria-pressed', String(button.dataset.value === chosen));
    button.disabled = disabled.includes(button.dataset.value ?? '');
  }
}

export function drawLegend(mode: ColourMode, ranges: Ranges): void {
  const rows: Record<ColourMode, [title: string, gradient: string, from: string, to: string]> = {
    depth: ['Depth of the seafloor', cssGradient([...VIRIDIS].reverse()),
      number(ranges.depth[0], 1, 'm'), number(ranges.depth[1], 1, 'm')],
    sigma: ['Uncertainty of depth (1 σ, per tile)', cssGradient(MAGMA), '0 cm', number(ranges.sigma[1] * 100, 1, 'cm')],
    age: ['Time since the tile arrived', cssGradient([...MAGMA].reverse()), '0 s', duration(ranges.age[1])],
    photo: ['Colour from the camera, as sent', '', '', ''],
  };
  const [title, gradient, from, to] = rows[mode];
  const legend = element('legend');
  legend.replaceChildren();
  const head = document.createElement('div');
  head.textContent = title;
  legend.append(head);
  if (!gradient) return;
  const bar = document.createElement('div');
  bar.className = 'ramp';
  bar.style.background = gradient;
  const ends = document.createElement('div');
  ends.className = 'ends';
  for (const text of [from, to]) {
    const end = document.createElement('span');
    end.textContent = text;
    ends.append(end);
  }
  legend.append(bar, ends);
}

const LONGEST_SCALE = 160; // [px]

export function drawScale(metresPerPixel: number): void {
  const length = niceBelow(LONGEST_SCALE * metresPerPixel);
  element('scale').querySelector<HTMLElement>('.bar')!.style.width = `${length / metresPerPixel}px`;
  element('scale').querySelector('.label')!.textContent = length < 1 ? `${Math.round(length * 100)} cm` : `${length} m`;
}

export function drawNorth(angle: number): void {
  element('compass').querySelector('svg')!.style.transform = `rotate(${angle}deg)`;
}

export function banner(text: string | null): void {
  element('banner').hidden = text === null;
  element('banner').textContent = text ?? '';
}
