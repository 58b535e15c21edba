import type { DesignResponse, DesignRequest } from "../shared/messages";
import type { Design } from "./designs/design";

/** Evaluation of a design: header, and blocks of numbers by name. */
export interface Found extends DesignResponse {
  block: (name: string) => Table | null;
  /** Time of the request, for benchmarks. */
  asked: number;
}

/** Named columns of numbers; NaN where undefined. */
export interface Table {
  name: string;
  rows: number;
  column: (name: string) => Float32Array;
}

export type Wish = Omit<DesignRequest, "number" | "slot">;

/** Evaluation request of a design, with the plots that require more than curves. */
export const wishOf = (
  design: Design,
  plots: Pick<DesignRequest, "section" | "squares" | "space">,
): Wish => ({
  tables: design.tables,
  follows: design.follows,
  object_distance_mm: design.distance,
  ...plots,
  requirements: design.requirements,
  bend: null,
});

/** Return the blocks with a name prefix. */
export const blocksLike = (found: Found, start: string): Table[] =>
  found.blocks.filter((b) => b.name.startsWith(start)).map((b) => found.block(b.name)!);
