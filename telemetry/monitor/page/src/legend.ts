import { duration, number, spacingText } from '#kit/format';
import { element, make, rampBar, swatch } from '#kit/overlay';
import { MAGMA, VIRIDIS, type Rgb } from '#kit/ramps';
import { COVERAGE_COLOURS, type ColourMode } from './material';
import type { Ranges } from './seafloor';

// What the colours of the map mean.

export interface CoverageKey {
  finest: number; // spacing [m]
  received: number; // [m2]
  pending: number;
  changed: number;
}

export function drawLegend(mode: ColourMode, ranges: Ranges, key: CoverageKey): void {
  const show = (title: string, ...parts: HTMLElement[]): void => element('legend').replaceChildren(make('div', '', title), ...parts);
  const ramp = (title: string, stops: Rgb[], from: string, to: string): void => show(title, ...rampBar(stops, [from, to]));
  switch (mode) {
    case 'coverage':
      return show('What has been received',
        swatch(COVERAGE_COLOURS.fine, `Received at ${spacingText(key.finest)}`, ''), swatch(COVERAGE_COLOURS.coarse, 'Received coarser', ''),
        swatch(COVERAGE_COLOURS.changed, 'Moved in the last 10 min', number(key.changed, 0, 'm²')),
        swatch(COVERAGE_COLOURS.pending, 'Seen, not received', number(key.pending, 0, 'm²')));
    case 'depth':
      return ramp('Depth of the seafloor', [...VIRIDIS].reverse(), number(ranges.depth[0], 1, 'm'), number(ranges.depth[1], 1, 'm'));
    case 'sigma':
      return ramp('Uncertainty of depth (1 σ)', MAGMA, '0 cm', number(ranges.sigma[1] * 100, 1, 'cm'));
    case 'age':
      return ramp('Time since received', [...MAGMA].reverse(), '0 s', duration(ranges.age[1]));
    case 'photo':
      return show('Colour from the camera, as sent');
  }
}
