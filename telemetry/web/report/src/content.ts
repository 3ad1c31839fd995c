// What a report holds, as the program writes it into the page. Numbers in tables are text already, with the digits that count.

export interface Series {
  label: string; // empty: not in the legend
  kind: 'line' | 'dots' | 'areas'; // areas: the inside of polygons
  colour: string;
  dashed?: boolean;
  size?: number; // a line's width, a dot's radius [px]
  x: (number | null)[]; // null interrupts: the next point begins another line or polygon
  y: (number | null)[];
}
export interface Plot {
  title: string;
  x: string; // label of the axis, with its unit
  y: string;
  width?: number; // [px]
  equal?: boolean; // units have the same length on both axes, as on a map
  down?: boolean; // y grows downwards, as in an image
  logX?: boolean; // logarithmic axes
  logY?: boolean;
  series: Series[];
}
export type Cell = string | { text: string; shade: number }; // shade: from blue (-1) over none (0) to red (1)
export type Part =
  | { text: string; strong?: boolean }
  | { list: string[] }
  | { table: { head?: string[]; rows: Cell[][] } }
  | { picture: { source: string; caption: string } }
  | { plot: Plot };
export interface Content {
  title: string;
  about: string;
  sections: { title: string; parts: Part[] }[];
}
