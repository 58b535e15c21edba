import type { DesignSummary } from "../../shared/messages";

/** Parsed TOML; the server checks its entries. */
// eslint-disable-next-line @typescript-eslint/no-explicit-any
export type Tables = Record<string, any>;

/** Complete definition of a design. */
export interface Design {
  /** Sensor as the tables of its file. */
  tables: Tables;
  /** Whether the lens position follows the mapping of the mirror. */
  follows_mapping: boolean;
  /** Object distance, mm; null: infinite. */
  distance: number | null;
  /** Requirements as the tables of their file. */
  requirements: Tables | null;
}

/** Pinned design. */
export interface Pin {
  name: string;
  design: Design;
}

const MAX_UNDONE = 100;

/** Current design with its undo history. */
export class History {
  private past: Design[] = [];
  private future: Design[] = [];
  /** Last committed design; slider moves start from it. */
  private settled: Design;
  /** Control of the last commit by a key press; null after other commits. */
  private lastKey: string | null = null;

  constructor(public now: Design) {
    this.settled = now;
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  get isHeld(): boolean {
    return this.now !== this.settled;
  }

  /** Commit the current design; return whether it changed. Successive key presses on one `control` are one undo step; null for other changes, and if the control loses the focus. */
  settle(control: string | null = null): boolean {
    const isNew = JSON.stringify(this.now) !== JSON.stringify(this.settled);
    const isSameStep = control !== null && control === this.lastKey;
    if (isNew && !isSameStep) this.past = [...this.past, this.settled].slice(-MAX_UNDONE);
    if (isNew) this.future = [];
    if (isNew || control === null) this.lastKey = control;
    this.settled = this.now;
    return isNew;
  }

  /** Replace the design by its completed form without an undo step. */
  complete(design: Design): void {
    const wasHeld = this.isHeld;
    this.now = design;
    if (!wasHeld) this.settled = design;
  }

  undo(): void {
    this.settle();
    const before = this.past.pop();
    if (before) this.go(before, this.future);
  }

  redo(): void {
    this.settle();
    const after = this.future.pop();
    if (after) this.go(after, this.past);
  }

  stacks(): { past: Design[]; future: Design[] } {
    return { past: this.past, future: this.future };
  }

  restore(stacks: { past: Design[]; future: Design[] }): void {
    this.past = stacks.past;
    this.future = stacks.future;
  }

  private go(to: Design, left: Design[]): void {
    left.push(this.settled);
    this.now = this.settled = to;
  }
}

/** Return the design with one changed entry; `index` selects an element of a list. */
export function withEntry(
  design: Design,
  section: string,
  name: string,
  value: unknown,
  index?: number,
): Design {
  const table = { ...design.tables[section] };
  if (index === undefined) table[name] = value;
  else table[name] = (table[name] as number[]).map((old, i) => (i === index ? value : old));
  return { ...design, tables: { ...design.tables, [section]: table } };
}

/** Return the design with the lens distance computed by the server. */
export function placed(design: Design, summary: DesignSummary): Design {
  const distance = summary.mirror_distance_mm;
  const own = design.tables.mount?.mirror_distance_mm as number | undefined;
  if (!design.follows_mapping || distance === null || own === distance) return design;
  return withEntry(design, "mount", "mirror_distance_mm", distance);
}

export const nameOf = (design: Design): string =>
  (design.tables.name as string | undefined) ?? "design";
