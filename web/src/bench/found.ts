import type { Answer, Ask } from "../shared/messages";
import type { Design } from "./designs/design";

/** What was answered about a design: words, and blocks of numbers by their names. */
export interface Found extends Answer {
  block: (name: string) => Table | null;
  /** When the question was asked, for whoever measures. */
  asked: number;
}

/** Named columns of numbers; not a number where there is nothing. */
export interface Table {
  name: string;
  rows: number;
  column: (name: string) => Float32Array;
}

export type Wish = Omit<Ask, "number" | "slot">;

/** The question about a design, and which plots need more than the curves. */
export const wishOf = (
  design: Design,
  plots: Pick<Ask, "section" | "squares" | "space">,
): Wish => ({
  tables: design.tables,
  follows: design.follows,
  object_distance_mm: design.distance,
  ...plots,
  requirements: design.requirements,
  bend: null,
});

/** Blocks whose names begin so. */
export const blocksLike = (found: Found, start: string): Table[] =>
  found.blocks.filter((b) => b.name.startsWith(start)).map((b) => found.block(b.name)!);
