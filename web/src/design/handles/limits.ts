import { h, reveal } from "../../shared/dom";
import type { RequirementResult, QuantityInfo } from "../../shared/messages";
import { clamp, words } from "../../shared/numbers";
import type { Tables } from "../model/design";
import { unitWords } from "../labels";
import { type Limit, limitsOf } from "../model/requirements";
import type { Area, Curves, Over } from "../plots/charts";
import { handle, place } from "./handle";

type Side = "at_least" | "at_most";

/** One side of a limit: index of the requirement and quantity. */
interface Line {
  limit: number;
  side: Side;
  value: number;
  title: string;
  part: [number, number] | null;
  isMet: boolean;
}

/** Set one side of a limit, and commit it. */
export interface LimitCallbacks {
  set: (limit: number, side: Side, value: number) => void;
  settle: (control: string | null) => void;
}

const SIGNS: Record<Side, string> = { at_least: "≥", at_most: "≤" };
const FINE_PX = 0.2; // rounding of dragged values

/** Limits of one quantity as draggable lines in its plot. */
export class LimitLines implements Over {
  isHeld = false;
  private lines: Line[] = [];
  private elements: HTMLElement[] = [];
  private area: Area | null = null;
  private readonly start = { top: 0 };

  constructor(private readonly callbacks: LimitCallbacks) {}

  /** Select the limits whose quantity is a column of the plot. */
  take(lines: Line[]): void {
    this.lines = lines;
    if (lines.length === this.elements.length) return;
    for (const element of this.elements) element.remove();
    this.elements = lines.map((_, i) => this.handleOf(i));
  }

  reach(): number[] {
    return this.lines.map((l) => l.value);
  }

  layOut(area: Area, first: Curves | null): void {
    this.area = area;
    for (const element of this.elements) reveal(element, first !== null);
    this.draw();
  }

  private draw(): void {
    const { layer, left, top: highest, width, height, across, down } = this.area!;
    this.lines.forEach((line, i) => {
      const element = this.elements[i];
      if (!element.isConnected) layer.append(element);
      const at = down(line.value);
      const top = clamp(at, highest, highest + height);
      const [from, to] = line.part
        ? line.part.map((omega) => clamp(across(omega), left, left + width))
        : [left, left + width];
      const text = `${line.title} ${SIGNS[line.side]} ${words(line.value)}`;
      place(element, from, top, line.value, text);
      element.style.width = `${Math.max(24, to - from)}px`;
      element.title = `${text}: drag up or down`;
      element.setAttribute(
        "aria-label",
        `${line.title}, ${line.side === "at_least" ? "at least" : "at most"}`,
      );
      for (const [name, is] of [
        ["at_least", line.side === "at_least"],
        ["at_most", line.side === "at_most"],
        ["missed", !line.isMet],
      ] as const)
        element.classList.toggle(name, is);
      const beyond = at < highest - 1 ? "↑ " : at > highest + height + 1 ? "↓ " : "";
      element.firstElementChild!.textContent = `${beyond}${SIGNS[line.side]} ${words(line.value)} ${line.isMet ? "✓" : "✗"}`;
    });
  }

  private handleOf(i: number): HTMLElement {
    const element = handle("limit-line", "", {
      begin: () => {
        this.start.top = parseFloat(element.style.top);
        this.isHeld = true;
      },
      move: (_, down) => this.move(i, down),
      end: (isByKey) => {
        this.isHeld = false;
        this.callbacks.settle(isByKey ? element.getAttribute("aria-label") : null);
      },
    });
    element.append(h("span", {}));
    element.addEventListener("mousemove", (e) => !this.isHeld && this.area?.read(e));
    return element;
  }

  private move(i: number, down: number): void {
    const { lines } = this;
    const { top, height, value: valueAt } = this.area!;
    const at = clamp(this.start.top + down, top, top + height);
    const perPx = Math.abs(valueAt(1) - valueAt(0));
    const places = clamp(Math.ceil(-Math.log10(FINE_PX * perPx)), 0, 12);
    const value = Number(valueAt(at).toFixed(places));
    lines[i] = { ...lines[i], value };
    this.draw();
    this.callbacks.set(lines[i].limit, lines[i].side, value);
  }
}

/** Return the lines of the limits of a named result, which is also the name of their column. */
export function linesOf(
  requirements: Tables | null,
  rows: readonly RequirementResult[],
  name: string,
  vocabulary: readonly QuantityInfo[],
): Line[] {
  return limitsOf(requirements).flatMap((limit, i) => {
    const row = rows.find((r) => r.limit === i);
    if (row?.name !== name) return [];
    const sides = (["at_least", "at_most"] as const).filter(
      (side) => typeof limit[side] === "number",
    );
    return sides.map((side): Line => ({
      limit: i,
      side,
      value: limit[side]!,
      title: titleOf(limit, vocabulary),
      part: limit.omega_deg ?? null,
      isMet: row.is_met,
    }));
  });
}

function titleOf(
  { quantity, cycles_per_px: cycles }: Limit,
  vocabulary: readonly QuantityInfo[],
): string {
  const { title, unit } = vocabulary.find((q) => q.name === quantity)!;
  return `${title}${cycles ? ` at ${words(cycles)} cycles/px` : ""}${unit ? `, ${unitWords(unit)},` : ""}`;
}
