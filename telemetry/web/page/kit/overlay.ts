import { niceBelow, spacingText } from './format';
import { cssColour, cssGradient, type Rgb } from './ramps';

// What is over and beside the picture: buttons, rows, legend, scale, north.

export const element = (id: string): HTMLElement => document.getElementById(id)!;
export const input = (id: string): HTMLInputElement => element(id) as HTMLInputElement;

export function make<K extends keyof HTMLElementTagNameMap>(tag: K, className = '', text = ''): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text) node.textContent = text;
  return node;
}

export function segments(id: string, choices: [value: string, label: string, title?: string][], choose: (value: string) => void): void {
  for (const [value, label, title] of choices) {
    const button = make('button', '', label);
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

// Whether keys belong to what has the focus: text is typed there, or a value is chosen by them.
export const takesKeys = (target: EventTarget | null): boolean => target instanceof HTMLElement
  && (/^(TEXTAREA|SELECT)$/.test(target.tagName) || (target instanceof HTMLInputElement && !/^(checkbox|radio|button|file|color)$/.test(target.type)));

export function row(label: string, value: string): HTMLElement {
  const line = make('div', 'row');
  line.append(make('span', '', label), make('b', '', value));
  return line;
}

export function swatch(colour: Rgb, label: string, value: string): HTMLElement {
  const line = make('div', 'swatch');
  const box = make('i');
  box.style.background = cssColour(colour);
  line.append(box, make('span', '', label), make('b', '', value));
  return line;
}

// A colour ramp with the values under it, from its left end to its right.
export function rampBar(stops: Rgb[], values: string[]): HTMLElement[] {
  const bar = make('div', 'ramp');
  bar.style.background = cssGradient(stops);
  const ends = make('div', 'ends');
  ends.append(...values.map((value) => make('span', '', value)));
  return [bar, ends];
}

export function scaleLength(metresPerPixel: number, longest: number): { pixels: number; text: string } {
  const length = niceBelow(longest * metresPerPixel);
  return { pixels: length / metresPerPixel, text: spacingText(length) };
}

const LONGEST_SCALE = 140; // [px]
const COMPASS = `<svg viewBox="-50 -50 100 100" width="48" height="48" aria-hidden="true">
  <circle r="46" class="ring" /><path d="M0,-40 L12,4 L0,-4 Z" class="north" /><path d="M0,-40 L-12,4 L0,-4 Z" class="north-shade" />
  <text y="32" text-anchor="middle">N</text></svg>`;

// The scale bar and the compass; `north`: where north points on the screen, clockwise from up [deg].
export function drawScale(metresPerPixel: number, north: number): void {
  const [scale, compass] = [element('scale'), element('compass')];
  if (!compass.firstElementChild) compass.innerHTML = COMPASS;
  if (!scale.firstElementChild) scale.append(make('span', 'bar'), make('span', 'label'));
  const { pixels, text } = scaleLength(metresPerPixel, LONGEST_SCALE);
  scale.querySelector<HTMLElement>('.bar')!.style.width = `${pixels}px`;
  scale.querySelector('.label')!.textContent = text;
  compass.querySelector('svg')!.style.transform = `rotate(${north}deg)`;
}

export function save(name: string, content: Blob | string, type = 'text/plain'): void {
  const link = make('a');
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
