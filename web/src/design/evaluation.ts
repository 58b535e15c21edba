import type { DesignResponse, DesignRequest } from "../shared/messages";
import type { Design } from "./model/design";

/** Evaluation of a design: header, and blocks of numbers by name. */
export interface Evaluation extends DesignResponse {
  block: (name: string) => Table | null;
  /** Time of the request, for benchmarks. */
  request: number;
}

/** Named columns of numbers; NaN where undefined. */
export interface Table {
  name: string;
  rows: number;
  column: (name: string) => Float32Array;
}

export type EvaluationOptions = Omit<DesignRequest, "number" | "slot">;

/** Evaluation request of a design, with the plots that require more than curves. */
export const optionsOf = (
  design: Design,
  plots: Pick<DesignRequest, "include_section" | "include_squares" | "include_3d">,
): EvaluationOptions => ({
  tables: design.tables,
  follows_mapping: design.follows_mapping,
  object_distance_mm: design.distance,
  ...plots,
  requirements: design.requirements,
  edit: null,
});

/** Return the blocks with a name prefix. */
export const blocksLike = (evaluation: Evaluation, start: string): Table[] =>
  evaluation.blocks.filter((b) => b.name.startsWith(start)).map((b) => evaluation.block(b.name)!);
