import { duration, niceBelow, number, spacingText } from './format';
import { COVERAGE_COLOURS, type ColourMode } from './material';
import { MAGMA, VIRIDIS, cssGradient, type Rgb } from './ramps';
import type { Ranges } from './seafloor';

// What lies over the picture: buttons, legend, scale, north, banner.

export const element = (id: string): HTMLElement => document.getElementById(id)!;

export function make(tag: string, className = '', text = ''): HTMLElement {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text) node.textContent = text;
  return node;
}

export function segments(id: string, choices: [value: string, label: string, title?: string][], choose: (value: string) => void): void {
  for (const [value, label, title] of choices) {
    const button = document.createElement('button');
    button.textContent = label;
    button.dataset.value = value;
    if (title) button.title = title;
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

export interface CoverageKey {
  finest: number; // spacing [m]
  received: number; // [m2]
  pending: number;
  changed: number;
}

function swatches(key: CoverageKey): HTMLElement[] {
  const rows: [Rgb, string, string][] = [
    [COVERAGE_COLOURS.fine, `Received at ${spacingText(key.finest)}`, ''],
    [COVERAGE_COLOURS.coarse, 'Received coarser', ''],
    [COVERAGE_COLOURS.changed, 'Moved in the last 10 min', number(key.changed, 0, 'm²')],
    [COVERAGE_COLOURS.pending, 'Seen, not received', number(key.pending, 0, 'm²')],
  ];
  return rows.map(([colour, label, value]) => {
    const row = make('div', 'swatch');
    const box = make('i');
    box.style.background = `rgb(${colour.join(',')})`;
    row.append(box, make('span', '', label), make('b', '', value));
    return row;
  });
}

export function drawLegend(mode: ColourMode, ranges: Ranges, key: CoverageKey): void {
  const legend = element('legend');
  if (mode === 'coverage') {
    legend.replaceChildren(make('div', '', 'What has been received'), ...swatches(key));
    return;
  }
  const rows: Record<Exclude<ColourMode, 'coverage'>, [title: string, gradient: string, from: string, to: string]> = {
    depth: ['Depth of the seafloor', cssGradient([...VIRIDIS].reverse()),
      number(ranges.depth[0], 1, 'm'), number(ranges.depth[1], 1, 'm')],
    sigma: ['Uncertainty of depth (1 σ)', cssGradient(MAGMA), '0 cm', number(ranges.sigma[1] * 100, 1, 'cm')],
    age: ['Time since received', cssGradient([...MAGMA].reverse()), '0 s', duration(ranges.age[1])],
    photo: ['Colour from the camera, as sent', '', '', ''],
  };
  const [title, gradient, from, to] = rows[mode];
  legend.replaceChildren(make('div', '', title));
  if (!gradient) return;
  const bar = make('div', 'ramp');
  bar.style.background = gradient;
  const ends = make('div', 'ends');
  ends.append(make('span', '', from), make('span', '', to));
  legend.append(bar, ends);
}

const LONGEST_SCALE = 140; // [px]

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
