/** Data of the 3-D view, and its interface to the page. */

/** Named columns of numbers; NaN where undefined. */
export interface Columns {
  name: string;
  rows: number;
  column: (name: string) => Float32Array;
}

/** Evaluation of a design, as far as the 3-D view requires it. */
export interface EvaluationBlocks {
  blocks: { name: string }[];
  block: (name: string) => Columns | null;
}

export interface Host {
  place: HTMLElement;
  /** A ray is selected: its field angle, which all plots display; null for none. */
  read: (omega: number | null) => void;
}
