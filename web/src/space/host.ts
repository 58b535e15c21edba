/** What is drawn in space, and what the view may ask of the page around it. */

/** Named columns of numbers; not a number where there is nothing. */
export interface Columns {
  name: string;
  rows: number;
  column: (name: string) => Float32Array;
}

/** What the server answered about a design, as far as it is of space. */
export interface Answered {
  blocks: { name: string }[];
  block: (name: string) => Columns | null;
}

export interface Host {
  place: HTMLElement;
  /** A ray is read: its field angle, which the plots then show too; null when none is. */
  read: (omega: number | null) => void;
}
