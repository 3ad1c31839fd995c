import Papa from 'papaparse';

// Comma, semicolon or tab separated text with quotes (RFC 4180), first line the names of the columns.

export interface Table {
  columns: string[];
  rows: string[][];
}

export function readCsv(text: string): Table {
  const { data } = Papa.parse<string[]>(text, { skipEmptyLines: 'greedy', transform: (field) => field.trim() });
  const [columns = [], ...rows] = data;
  return { columns, rows };
}

export const writeCsv = (rows: (string | number)[][]): string => Papa.unparse(rows, { newline: '\n' }) + '\n';
