// What a report holds, as the program writes it into the page. Numbers in tables are text already, with the digits that count.

export interface Series {
  label: string;
  kind: 'line' | 'dots';
  colour: string;
  x: number[];
  y: number[];
}
export interface Plot {
  title: string;
  x: string; // label of the axis, with its unit
  y: string;
  equal?: boolean; // a metre is as long either way, as on a map
  series: Series[];
}
export type Part =
  | { text: string; strong?: boolean }
  | { list: string[] }
  | { table: { head?: string[]; rows: string[][] } }
  | { picture: { source: string; caption: string } }
  | { plot: Plot };
export interface Content {
  title: string;
  about: string;
  sections: { title: string; parts: Part[] }[];
}
