import type { Tables } from "./design";

/** Limit of a requirement file. */
export interface Limit {
  quantity: string;
  at_least?: number | null;
  at_most?: number | null;
  omega_deg?: [number, number] | null;
  /** Spatial frequency of an MTF limit. */
  cycles_per_px?: number | null;
}

export const limitsOf = (requirements: Tables | null): Limit[] =>
  (requirements?.limit as Limit[] | undefined) ?? [];

/** Return the requirements with other limits, without empty entries. */
export const withLimits = (requirements: Tables, limits: readonly Limit[]): Tables => ({
  ...requirements,
  limit: limits.map(clean),
});

const clean = (limit: Limit): Limit =>
  Object.fromEntries(
    Object.entries(limit).filter(([, v]) => v !== null && v !== undefined),
  ) as unknown as Limit;
