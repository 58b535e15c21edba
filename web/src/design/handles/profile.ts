import { reveal } from "../../shared/dom";
import { words } from "../../shared/numbers";
import type { Evaluation } from "../evaluation";
import { interpolated } from "../plots/cursor";
import { type EditCallbacks, handle, place } from "./handle";

/** Interface of a drawing to scale. */
interface Drawing {
  readonly scale: number;
  at: (point: [z: number, x: number]) => [left: number, top: number];
}

const AT = [0.5, 1]; // fractions of the rim radius
const APART = 25; // minimum spacing of handles, px

/** Handles on the mirror in the cross-section; the profile is deformed to pass through them. */
export class ProfileHandles {
  isHeld = false;
  private readonly elements: HTMLElement[];
  private scale = 1;
  private places: [z: number, x: number][] = [];
  private from: readonly [z: number, x: number] = [0, 0];

  constructor(over: HTMLElement, callbacks: EditCallbacks) {
    this.elements = AT.map((_, i) =>
      handle("profile", "Mirror: drag along the axis to bend its profile", {
        begin: () => {
          this.from = this.places[i];
          this.isHeld = true;
        },
        move: (right) =>
          callbacks.editCurve({
            of: "profile",
            at: this.from[1],
            to: this.from[0] + right / this.scale,
          }),
        end: (isByKey) => {
          this.isHeld = false;
          callbacks.release(isByKey);
        },
      }),
    );
    for (const element of this.elements) reveal(element, false); // until the first evaluation
    over.append(...this.elements);
  }

  layOut(drawing: Drawing, result: Evaluation): void {
    this.scale = drawing.scale;
    const { rim_radius_mm: rim, not_optimised: reason } = result.summary!;
    const table = result.block("mirror");
    const canBend = reason === null && table !== null;
    let next: [left: number, top: number] = [Infinity, Infinity];
    for (const [i, element] of [...this.elements.entries()].reverse()) {
      if (!canBend) {
        reveal(element, false);
        continue;
      }
      const x = AT[i] * rim;
      this.places[i] = [interpolated(table.column("x_mm"), table.column("z_mm"), x), x];
      const [left, top] = drawing.at(this.places[i]);
      reveal(element, Math.max(Math.abs(left - next[0]), Math.abs(top - next[1])) >= APART);
      if (!element.hidden) next = [left, top];
      place(
        element,
        left,
        top,
        this.places[i][0],
        `z ${words(this.places[i][0])} mm at x ${words(x)} mm`,
      );
    }
  }
}
